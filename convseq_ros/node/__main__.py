# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The process of `vpr_node`, also `python -m convseq_ros.node`."""

import sys
from typing import NoReturn

from convseq_ros.node.process import end_on_signal, run_node

_USAGE = """\
usage: vpr_node [--ros-args [-p NAME:=VALUE]... [--params-file FILE] [-r image:=TOPIC]...]

Recognises the places of a map in the images of a camera, or maps as it goes.

  vpr_node --ros-args -p map_path:=map.db -r image:=/camera/image_raw
  vpr_node --ros-args -p map_path:=home.db -p mode:=online -r odom:=/odom

Topics to remap: image, camera_info, odom. Parameters:
"""


def main() -> NoReturn:
    """Run the node; a signal ends it cleanly, also while it starts."""
    end_on_signal(0)  # before anything else is imported
    if {'-h', '--help'} & set(sys.argv[1:]):
        print(_help())
        sys.exit(0)
    if sys.argv[1:] and sys.argv[1] != '--ros-args':  # ROS would ignore it silently
        print(f'vpr_node: {sys.argv[1]}: parameters and remaps follow --ros-args', file=sys.stderr)
        sys.exit(2)
    from importlib.util import find_spec

    if find_spec('rclpy') is None:
        from convseq_ros.errors import NEEDS_ROS

        sys.exit(f'vpr_node: {NEEDS_ROS}')
    run_node('convseq_ros.node.vpr_node')


def _help() -> str:
    import textwrap

    from convseq_ros.config import core_parameters
    from convseq_ros.config.node_config import NodeConfig
    from convseq_ros.config.parameter import parameters

    lines = [_USAGE]
    for item in (*parameters(NodeConfig), *core_parameters()):
        about = ', '.join(part for part in (item.bounds, item.unit) if part)
        lines.append(f'  {item.name} = {item.default!r}{f"  ({about})" if about else ""}')
        lines.append(textwrap.indent(textwrap.fill(item.doc, 90), 6 * ' '))
    return '\n'.join(lines)


if __name__ == '__main__':
    main()
