# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Recognise a recording in all maps of a folder: `convseq fleet replay MAPS RECORDING`."""

import argparse
from dataclasses import replace
import json
from pathlib import Path

from convseq_ros.cli.fleet_options import add_cluster, chosen_cluster
from convseq_ros.cli.options import chosen_config
from convseq_ros.cli.replay import add_replay, in_words, replay_chosen, warn
from convseq_ros.core.session import warm_up
from convseq_ros.errors import MapError
from convseq_ros.fleet.cluster import connected
from convseq_ros.fleet.session import FleetSession
from convseq_ros.onnx_model import open_model
from convseq_ros.sources.natural_order import natural_key


def describe(parser: argparse.ArgumentParser) -> None:
    """Declare the command's arguments."""
    parser.add_argument('maps', type=Path, help='folder of maps, which answer as one would')
    parser.add_argument('recording', type=Path, help='recording or folder of images')
    add_cluster(parser)
    add_replay(parser)


def run(chosen: argparse.Namespace) -> int:
    """Replay, write the table, and sum it up."""
    paths, told = maps_in(chosen.maps), set[str]()
    # Without a scheduler, workers are of this process: messages are not pickled, and cost half.
    with connected(replace(chosen_cluster(chosen), are_threads=True)) as client:
        sources, config = chosen.topic.split(), chosen_config(chosen)
        model = open_model(config)
        session = FleetSession(client, paths, config, sources=sources, describe=model)

        def tell() -> None:
            for line in session.missing:
                if line not in told:
                    warn(f'{line}; the other maps answer')
            told.update(session.missing)

        tell()
        for one in session.cameras.each:
            warm_up(one)
        summary = replay_chosen(chosen, session.cameras, chosen.maps, tell)
    fleet = session.fleet
    if chosen.json:
        about = {'output': str(chosen.output), 'slow': session.slow, 'missing': session.missing}
        print(json.dumps(about | summary))
    else:
        lost = f', {len(session.missing)} of {len(paths)} maps missing' if session.missing else ''
        print(f'{chosen.maps}: {fleet.count} places of {len(fleet.offsets)} maps{lost}')
        print(f'{chosen.output}: {in_words(summary, session.slow)}')
    return 0


def maps_in(folder: Path) -> list[Path]:
    """Return the maps in a folder, map2 before map10; MapError if there are none."""
    found = sorted((one for one in folder.glob('*.db') if one.is_file()), key=natural_key)
    if not found:
        raise MapError(f'{folder}: no map in it (*.db); make some with convseq fleet build')
    return found
