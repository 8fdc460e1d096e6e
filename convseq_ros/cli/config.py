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
from convseq_ros.config.pose_graph_config import PoseGraphConfig

_PAGE = """\
# Parameters

Printed by `convseq config --markdown`. They are the same for the node (`-p NAME:=VALUE`,
`--params-file`), for `convseq replay --config FILE` and as options (`--min-margin 0.01`).
`convseq config > my.yaml` prints all of them, ready to edit. Those marked * may change while the
node runs; the others are read at the start. `build-map` takes `keyframe_...`, `keypoints`,
`keep_images_px`, `stationary_m`, `image_size_px`, `resize`, `image_mask`, `image_rotation_deg`,
`descriptor_model`, `matching`, `camera_to_base`, `max_image_mpx` and `max_file_mb`.

"""
DEFAULTS = 'Every parameter of vpr_node with its default; printed by `convseq config`.'
PAPERS = (
    "The paper's method as released, for maps made with this file; printed by "
    '`convseq config --paper`.'
)
_TABLE = """\
| parameter | default | allowed | meaning |
|---|---|---|---|
"""
_GRAPH = """

## pose_graph_node

"""


def describe(parser: argparse.ArgumentParser) -> None:
    what = parser.add_mutually_exclusive_group()
    what.add_argument('--paper', action='store_true', help="print the paper's method instead")
    what.add_argument('--markdown', action='store_true', help='print docs/PARAMETERS.md')


def run(chosen: argparse.Namespace) -> int:
    """Print a ROS parameter file, or the table."""
    if chosen.markdown:
        print(markdown(all_parameters()))
    elif chosen.paper:
        print(yaml(paper_parameters(), PAPERS))
    else:
        print(yaml(all_parameters()))
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


def markdown(declared: Iterable[Parameter]) -> str:
    """Return the page: the parameters of vpr_node, then those of pose_graph_node."""
    graph = _table(parameters(PoseGraphConfig))
    return _PAGE + _table(declared) + _GRAPH + graph


def _table(declared: Iterable[Parameter]) -> str:
    lines = []
    for item in declared:
        allowed = f'{item.bounds} {item.unit}'.replace('|', 'or').strip()
        live = ' *' if item.dynamic else ''
        lines.append(
            f'| `{item.name}`{live} | `{json.dumps(item.default)}` | {allowed} | {item.doc} |'
        )
    return _TABLE + '\n'.join(lines)
