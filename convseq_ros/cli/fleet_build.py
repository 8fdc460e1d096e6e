# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Build a map of each recording in a folder: `convseq fleet build FOLDER -o MAPS`."""

import argparse
from contextlib import suppress
from dataclasses import asdict
import json
from pathlib import Path
import sys
import time

from convseq_ros.cli.build_map import add_no_links, add_settings, build, Built, chosen_settings
from convseq_ros.cli.fleet_options import add_cluster, chosen_cluster
from convseq_ros.cli.terminal import progress
from convseq_ros.config import Config
from convseq_ros.core.encoding.first_stage import with_first_stage
from convseq_ros.core.map.lock import MapLock
from convseq_ros.core.map.reader import MapReader
from convseq_ros.core.map.writer import replaced
from convseq_ros.errors import ConvseqError, MapError, SourceError
from convseq_ros.fleet.cluster import connected, done
from convseq_ros.onnx_model import open_model
from convseq_ros.sources import recordings_in

# Recording, map, four topics, settings, whether with links.
Job = tuple[Path, Path, str, str, str, str, Config, bool]


def describe(parser: argparse.ArgumentParser) -> None:
    """Declare the command's arguments."""
    parser.add_argument('folder', type=Path, help='folder of recordings, one map each')
    parser.add_argument(
        '-o',
        '--output',
        type=Path,
        required=True,
        metavar='MAPS',
        help='folder for the maps, made if there is none; finished maps in it are kept',
    )
    parser.add_argument(
        '--topic',
        default='',
        help='image topic, if there are several; of several cameras, in quotes with spaces '
        'between: each makes a session, and so are those of --camera-info',
    )
    parser.add_argument('--odom', default='', metavar='TOPIC', help='topic that gives poses')
    parser.add_argument(
        '--camera-info',
        default='',
        metavar='TOPIC|FILE',
        help='topic or file that describes the camera',
    )
    parser.add_argument(
        '--depth',
        default='',
        metavar='TOPIC',
        help='depth images registered to the camera, of several to the first',
    )
    add_no_links(parser)
    parser.add_argument('--json', action='store_true', help='print the result as JSON')
    add_cluster(parser)
    add_settings(parser)


def run(chosen: argparse.Namespace) -> int:
    """Build what is not there yet, and say what came of each recording."""
    cluster, config = chosen_cluster(chosen), chosen_settings(chosen)
    links = not chosen.no_links
    maps = _maps(chosen.folder, chosen.output)
    kept, failed, jobs = dict[str, int](), dict[str, str](), dict[str, Job]()
    chosen.output.mkdir(parents=True, exist_ok=True)
    for path, recording in maps.items():
        try:
            if path.exists() and (places := len(_opened(path, config))):
                kept[str(path)] = places
                continue
        except MapError as error:
            failed[str(path)] = str(error)
            continue
        topics = chosen.topic, chosen.odom, chosen.camera_info, chosen.depth
        jobs[str(path)] = recording.resolve(), path.resolve(), *topics, config, links
    started, built = time.monotonic(), dict[str, Built]()
    if jobs:
        try:
            with connected(cluster) as client:
                for name, result in progress(
                    done(client, build_one, jobs), len(jobs), chosen.output.name, 'maps'
                ):
                    if isinstance(result, ConvseqError):
                        failed[name] = str(result)
                        continue
                    built[name], warnings = result
                    for warning in warnings:
                        print(f'warning: {warning}', file=sys.stderr)
        finally:
            _clean(jobs)
    for name, why in failed.items():
        print(f'convseq fleet: {name}: {why.removeprefix(f"{name}: ")}', file=sys.stderr)
    seconds = time.monotonic() - started
    if chosen.json:
        print(
            json.dumps(
                {
                    'built': [asdict(one) | {'map': name} for name, one in built.items()],
                    'kept': [*kept],
                    'failed': failed,
                    'seconds': seconds,
                }
            )
        )
    else:
        places = sum(one.references for one in built.values()) + sum(kept.values())
        print(
            f'{chosen.output}: {len(built) + len(kept)} maps, {places} places; {len(built)} built '
            f'in {seconds:.1f} s, {len(kept)} kept, {len(failed)} failed'
        )
    return int(bool(failed))


def build_one(
    recording: Path,
    path: Path,
    topic: str,
    odom: str,
    camera_info: str,
    depth: str,
    config: Config,
    links: bool = True,
) -> tuple[Built, list[str]]:
    """Build a map, which is there whole or not at all; return what was built, and warnings."""
    warnings: list[str] = []
    with replaced(path) as part:
        built = build(
            recording,
            part,
            topic=topic,
            odom=odom,
            camera_info=camera_info,
            depth=depth,
            config=config,
            links=links,
            tell=warnings.append,
        )
    return built, [f'{recording.name}: {one}' for one in warnings]


def _maps(folder: Path, output: Path) -> dict[Path, Path]:
    """Return the recordings of a folder by their maps; SourceError if two want one name."""
    found: dict[Path, Path] = {}
    for recording in recordings_in(folder):
        name = recording.name if recording.is_dir() else recording.name.partition('.')[0]
        other = found.setdefault(output / f'{name}.db', recording)
        if other != recording:
            raise SourceError(
                f'{recording}: its map would have the name of that of {other.name}; rename one'
            )
    return found


def _opened(path: Path, config: Config) -> MapReader:
    asked = with_first_stage(config, open_model(config))
    return MapReader(path, asked.encoding, config.keyframes)


def _clean(jobs: dict[str, Job]) -> None:
    """Delete what workers that were killed left beside the maps."""
    for _, path, *_ in jobs.values():
        with suppress(MapError), MapLock(path):
            pass
