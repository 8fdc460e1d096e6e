# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Print every parameter, ready to edit: `convseq config > my.yaml`."""

import argparse
from collections.abc import Iterable
import json
import textwrap

from convseq_ros.config import core_parameters
from convseq_ros.config.node_config import NodeConfig
from convseq_ros.config.paper import paper_parameters
from convseq_ros.config.parameter import Parameter, parameters

DEFAULTS = 'Every parameter of vpr_node with its default; printed by `convseq config`.'
PAPERS = (
    "The paper's method as released, for maps made with this file; printed by "
    '`convseq config --paper`.'
)


def describe(parser: argparse.ArgumentParser) -> None:
    help_ = "print the paper's method instead"
    parser.add_argument('--paper', action='store_true', help=help_)


def run(chosen: argparse.Namespace) -> int:
    """Print a ROS parameter file."""
    print(yaml(paper_parameters(), PAPERS) if chosen.paper else yaml(all_parameters()))
    return 0


def all_parameters() -> list[Parameter]:
    """Return the parameters of the node: those of matching first."""
    return [*core_parameters(), *parameters(NodeConfig)]


def yaml(declared: Iterable[Parameter], title: str = DEFAULTS) -> str:
    """Return a ROS parameter file with every default and its meaning."""
    lines = [f'# {title}']
    lines += ['/**:', '  ros__parameters:']
    for item in declared:
        unit = f'{item.bounds} {item.unit}'.strip()
        lines += textwrap.wrap(
            f'{item.doc} [{unit}]' if unit else item.doc,
            94,
            initial_indent='    # ',
            subsequent_indent='    # ',
        )
        lines.append(f'    {item.name}: {json.dumps(item.default)}')
    return '\n'.join(lines)
