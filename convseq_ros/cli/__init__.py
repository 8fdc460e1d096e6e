# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The command `convseq`; each sub-command is one file with `describe` and `run`."""

import argparse
from collections.abc import Iterator, Sequence
from contextlib import suppress
import importlib
import signal
import sys

from convseq_ros import __version__
from convseq_ros.cli.outputs import refuse_chosen_outputs
from convseq_ros.cli.streams import discard, OUTPUT
from convseq_ros.config.arguments import Parser, refuse_foreign, sentence
from convseq_ros.errors import ConvseqError, printable
from convseq_ros.node.process import use_one_thread

use_one_thread()

SIGNALS = signal.SIGINT, signal.SIGTERM
COMMANDS = {
    'build-map': 'build a reference map from a recording or a folder of images',
    'replay': 'recognise the frames of a recording in a map, without ROS',
    'locate': 'print where in a map images were taken',
    'info': 'print what a map or a recording holds, or what is installed',
    'map': 'link, merge or split maps; remove or rename their sessions',
    'fleet': 'build a map of each recording in a folder, in parallel',
    'evaluate': 'measure methods on data sets with known truth',
    'demo': 'drive a street twice: map, live node, table and page',
    'report': 'put the results of several evaluations in one table',
    'config': 'print every parameter with its default, ready to edit',
}


def main(args: Sequence[str] | None = None) -> int:
    """Run a sub-command; return 0 for success, 1 after an error in one line, 2 for wrong usage."""
    parser = Parser(
        prog='convseq',
        description='Training-free visual place recognition on a CPU.',
        epilog='\n'.join(f'  {name:10} {text}' for name, text in COMMANDS.items()),
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument('--version', action='version', version=__version__)
    parser.add_argument('command', choices=COMMANDS, metavar='command')
    parser.add_argument('arguments', nargs=argparse.REMAINDER)
    if not (sys.argv[1:] if args is None else args):
        parser.print_help(sys.stderr)
        return 2
    chosen = parser.parse_args(args)
    try:
        return _run(chosen.command, chosen.arguments)
    except ConvseqError as error:
        problem = str(error)
    except BrokenPipeError as error:
        if error.filename is None:  # the reader of the output has what it wants
            discard()
            return 0
        problem = f'{error.filename}: {error.strerror}'
    except OSError as error:
        if error.filename is None:
            discard()
        problem = f'{error.filename or OUTPUT}: {error.strerror}'
    except KeyboardInterrupt:
        problem = 'interrupted'
    for word in chosen.arguments:
        _, _, value = word.partition('=')
        for name in (word, value):
            problem = problem.replace(name, printable(name)) if name else problem
    with suppress(OSError):
        print(f'convseq {chosen.command}: {problem}', file=sys.stderr)
    return 1


def _run(name: str, arguments: list[str]) -> int:
    """Run the module of a sub-command with its arguments; return its exit code."""
    # An interruption waits: NumPy would turn it into an error of its own, while it is imported.
    signal.pthread_sigmask(signal.SIG_BLOCK, SIGNALS)
    command = importlib.import_module(f'convseq_ros.cli.{name.replace("-", "_")}')
    signal.pthread_sigmask(signal.SIG_UNBLOCK, SIGNALS)
    parser = Parser(prog=f'convseq {name}', description=sentence(COMMANDS[name]))
    command.describe(parser)
    options = parser.parse_args(arguments)
    refuse_foreign(_words_of(options))
    refuse_chosen_outputs(options)
    code = int(command.run(options))
    sys.stdout.flush()
    return code


def _words_of(options: argparse.Namespace) -> Iterator[str]:
    for value in vars(options).values():
        for word in value if isinstance(value, list) else [value]:
            if isinstance(word, str):
                yield word
