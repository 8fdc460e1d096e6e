# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The processes of the nodes; `vpr_node` is also `python -m convseq_ros.node`."""

import os
import signal
import sys
from typing import NoReturn

_ENDING = signal.SIGINT, signal.SIGTERM

_USAGE = """\
usage: vpr_node [--ros-args [-p NAME:=VALUE]... [--params-file FILE] [-r image:=TOPIC]...]

Recognises the places of a map in the images of a camera, or maps as it goes.

  vpr_node --ros-args -p map_path:=map.db -r image:=/camera/image_raw
  vpr_node --ros-args -p map_path:=home.db -p mode:=online -r odom:=/odom

Topics to remap: image, camera_info, odom. Parameters:
"""


_GRAPH_USAGE = """\
usage: pose_graph_node [--ros-args [-p NAME:=VALUE]... [--params-file FILE] [-r odom:=TOPIC]...]

Corrects odometry with the closures of vpr_node, and publishes map -> odom.

  pose_graph_node --ros-args -p map_path:=home.db -p tum_file:=path.txt

Topics to remap: odom, vpr_node/closure_odometry, vpr_node/loop_closure, vpr_node/pose,
vpr_node/map_info. Parameters:
"""


def main() -> NoReturn:
    """Run `vpr_node`; a signal ends it cleanly, also while it starts."""
    _start('vpr_node', _USAGE)


def pose_graph_main() -> NoReturn:
    """Run `pose_graph_node` in the same way."""
    _start('pose_graph_node', _GRAPH_USAGE)


def _start(name: str, usage: str) -> NoReturn:
    # Until the node handles them: while NumPy is imported, an exception would become its own.
    for number in _ENDING:
        signal.signal(number, lambda *_: os._exit(0))
    if {'-h', '--help'} & set(sys.argv[1:]):
        print(usage)
        _describe(name)
        sys.exit(0)
    if sys.argv[1:] and sys.argv[1] != '--ros-args':  # ROS would ignore it silently
        print(f'{name}: {sys.argv[1]}: parameters and remaps follow --ros-args', file=sys.stderr)
        sys.exit(2)
    from importlib import import_module
    from importlib.util import find_spec

    if find_spec('rclpy') is None:
        from convseq_ros.errors import NEEDS_ROS

        sys.exit(f'{name}: {NEEDS_ROS}')
    from convseq_ros.node.running import leave

    leave(import_module(f'convseq_ros.node.{name}').main())


def _describe(name: str) -> None:
    """Print the parameters of a node."""
    import textwrap

    from convseq_ros.config import core_parameters
    from convseq_ros.config.node_config import NodeConfig
    from convseq_ros.config.parameter import parameters
    from convseq_ros.config.pose_graph_config import PoseGraphConfig

    of_vpr = *parameters(NodeConfig), *core_parameters()
    for item in of_vpr if name == 'vpr_node' else parameters(PoseGraphConfig):
        about = ', '.join(part for part in (item.bounds, item.unit) if part)
        print(f'  {item.name} = {item.default!r}{f"  ({about})" if about else ""}')
        print(textwrap.indent(textwrap.fill(item.doc, 90), 6 * ' '))


if __name__ == '__main__':
    main()
