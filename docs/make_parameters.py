# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Print the page of parameters: `python docs/make_parameters.py > docs/PARAMETERS.md`."""

from collections.abc import Iterable
import json

from convseq_ros.cli.config import all_parameters
from convseq_ros.config.parameter import Parameter, parameters
from convseq_ros.config.pose_graph_config import PoseGraphConfig

_PAGE = """\
# Parameters

Printed by `docs/make_parameters.py`. They are the same for the node (`-p NAME:=VALUE`,
`--params-file`), for `convseq replay --config FILE` and as options (`--min-margin 0.01`).
`convseq config > my.yaml` prints all of them, ready to edit. Those marked * may change while the
node runs; the others are read at the start.

"""
_TABLE = """\
| parameter | default | allowed | meaning |
|---|---|---|---|
"""
_GRAPH = """

## pose_graph_node

"""


def page() -> str:
    """Return the page: the parameters of vpr_node, then those of pose_graph_node."""
    return _PAGE + _table(all_parameters()) + _GRAPH + _table(parameters(PoseGraphConfig))


def _table(declared: Iterable[Parameter]) -> str:
    lines = []
    for item in declared:
        allowed = f'{item.bounds} {item.unit}'.replace('|', 'or').strip()
        live = ' *' if item.dynamic else ''
        lines.append(
            f'| `{item.name}`{live} | `{json.dumps(item.default)}` | {allowed} | {item.doc} |'
        )
    return _TABLE + '\n'.join(lines)


if __name__ == '__main__':
    print(page())
