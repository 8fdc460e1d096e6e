# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What becomes of map files: `convseq map merge` and so on."""

import argparse
from importlib import import_module

COMMANDS = {
    'link': 'link the places of a map that show the same, and solve its poses',
    'unlink': 'take links out of a map',
    'merge': 'put the sessions of several maps into one',
    'split': 'make a map of each session of a map',
    'remove': 'take sessions, or more looks of a place than a number, out of a map',
    'rename': 'call a session of a map by another name',
}


def describe(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments of each command."""
    commands = parser.add_subparsers(dest='verb', required=True, metavar='|'.join(COMMANDS))
    for name, text in COMMANDS.items():
        own = commands.add_parser(name, help=text, description=text.capitalize() + '.')
        import_module(f'convseq_ros.cli.{name}').describe(own)


def run(chosen: argparse.Namespace) -> int:
    """Run the one that was chosen."""
    return int(import_module(f'convseq_ros.cli.{chosen.verb}').run(chosen))
