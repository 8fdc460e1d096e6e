# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Have robots ask all maps of a folder: `convseq fleet serve MAPS`."""

import argparse
from pathlib import Path
from threading import Event

from convseq_ros.cli.fleet_options import add_cluster, chosen_cluster
from convseq_ros.cli.fleet_replay import maps_in
from convseq_ros.fleet.cluster import connected
from convseq_ros.fleet.link import serve


def describe(parser: argparse.ArgumentParser) -> None:
    """Declare the command's arguments."""
    parser.add_argument('maps', type=Path, help='folder of maps, which answer as one would')
    add_cluster(parser)


def run(chosen: argparse.Namespace) -> int:
    """Tell a scheduler its maps; without one, be it until Ctrl-C."""
    paths = maps_in(chosen.maps)
    with connected(chosen_cluster(chosen)) as client:
        serve(client, paths)
        address = client.scheduler.address
        print(f'{address}: {len(paths)} maps; vpr_node --ros-args -p fleet:={address}', flush=True)
        if not chosen.scheduler:
            Event().wait()
    return 0
