# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Many maps on many processes or machines: `convseq fleet build` and so on."""

import argparse
from importlib import import_module

COMMANDS = {
    'build': 'build a map of each recording in a folder, in parallel',
    'link': 'recognise each session of the maps in a folder in the others',
    'replay': 'recognise the frames of a recording in all maps of a folder',
    'serve': 'have robots ask all maps of a folder',
}


def describe(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments of each command."""
    commands = parser.add_subparsers(dest='work', required=True, metavar='|'.join(COMMANDS))
    for name, text in COMMANDS.items():
        own = commands.add_parser(name, help=text, description=text.capitalize() + '.')
        import_module(f'convseq_ros.cli.fleet_{name}').describe(own)


def run(chosen: argparse.Namespace) -> int:
    """Run the one that was chosen."""
    return int(import_module(f'convseq_ros.cli.fleet_{chosen.work}').run(chosen))
