# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Many maps side by side, on processes of Dask: `convseq fleet RECORDINGS -o MAPS`."""

import argparse
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import asdict
import json
from pathlib import Path
import sys
import time
from typing import Any

from convseq_ros.cli.build_map import add_no_links, add_settings, build, Built, chosen_settings
from convseq_ros.cli.options import add_images, chosen_images, progress, warn
from convseq_ros.config import Config
from convseq_ros.core.encoding.first_stage import with_first_stage
from convseq_ros.core.map.lock import MapLock
from convseq_ros.core.map.reader import open_map
from convseq_ros.core.map.reference_map import ReferenceMap
from convseq_ros.core.map.writer import replaced
from convseq_ros.core.similarity.feature_cache import usable_cores
from convseq_ros.errors import ConvseqError, FleetError, MapError, SourceError
from convseq_ros.fleet.cluster import finished_jobs, started
from convseq_ros.io.output_file import make_folder
from convseq_ros.models.onnx_model import open_model
from convseq_ros.sources.recording_names import recordings_in

Job = tuple[Path, Path, Config, bool, dict[str, Any]]  # the arguments of `build_one`


def describe(parser: argparse.ArgumentParser) -> None:
    parser.add_argument('folder', type=Path, help='folder of recordings, one map each')
    help_ = 'folder for the maps, made if there is none; finished maps in it are kept'
    parser.add_argument('-o', '--output', type=Path, required=True, metavar='MAPS', help=help_)
    help_ = 'processes that build (as many as there are cores)'
    parser.add_argument('--workers', type=int, default=usable_cores(), metavar='N', help=help_)
    add_images(parser, poses=False)
    add_no_links(parser)
    parser.add_argument('--json', action='store_true', help='print the result as JSON')
    add_settings(parser)


def run(chosen: argparse.Namespace) -> int:
    """Build the missing maps, and print the result of each recording."""
    if chosen.workers < 1:
        raise FleetError(f'--workers {chosen.workers}: needs at least 1')
    config, maps = chosen_settings(chosen), _maps(chosen.folder, chosen.output)
    kept, failed, jobs = dict[str, int](), dict[str, str](), dict[str, Job]()
    make_folder(chosen.output)
    for path, recording in maps.items():
        try:
            if path.exists() and (places := len(_opened(path, config))):
                kept[str(path)] = places
                continue
        except MapError as error:
            failed[str(path)] = str(error)
            continue
        job = recording.resolve(), path.resolve(), config, not chosen.no_links
        jobs[str(path)] = *job, chosen_images(chosen)
    started_s, built = time.monotonic(), dict[str, Built]()
    if jobs:
        try:
            with started(min(chosen.workers, len(jobs))) as client:
                for name, result in progress(
                    finished_jobs(client, build_one, jobs), len(jobs), chosen.output.name, 'maps'
                ):
                    if isinstance(result, ConvseqError):
                        failed[name] = str(result)
                        continue
                    built[name], warnings = result
                    for warning in warnings:
                        warn(warning)
        finally:
            for _, path, *_ in jobs.values():
                with suppress(MapError), MapLock(path):  # which deletes what killed workers left
                    pass
    for name, why in failed.items():
        print(f'convseq fleet: {name}: {why.removeprefix(f"{name}: ")}', file=sys.stderr)
    seconds = time.monotonic() - started_s
    if chosen.json:
        done_now = [asdict(result) | {'map': name} for name, result in built.items()]
        about = {'built': done_now, 'kept': [*kept], 'failed': failed, 'seconds': seconds}
        print(json.dumps(about))
    else:
        places = sum(new.references for new in built.values()) + sum(kept.values())
        print(
            f'{chosen.output}: {len(built) + len(kept)} maps, {places} places; {len(built)} built '
            f'in {seconds:.1f} s, {len(kept)} kept, {len(failed)} failed'
        )
    return int(bool(failed))


def build_one(
    recording: Path,
    path: Path,
    config: Config,
    links: bool = True,
    images: Mapping[str, Any] | None = None,
) -> tuple[Built, list[str]]:
    """Build a map, which is complete or absent; return the result, and warnings."""
    warnings, images = list[str](), images or {}
    with MapLock(path), replaced(path) as part:
        built = build(recording, part, config, links=links, on_warning=warnings.append, **images)
    return built, [f'{recording.name}: {warning}' for warning in warnings]


def _maps(folder: Path, output: Path) -> dict[Path, Path]:
    """Return the recordings of a folder by their maps; SourceError if two maps share a name."""
    maps: dict[Path, Path] = {}
    for recording in recordings_in(folder):
        name = recording.name if recording.is_dir() else recording.name.partition('.')[0]
        other = maps.setdefault(output / f'{name}.db', recording)
        if other != recording:
            raise SourceError(
                f'{recording}: its map would have the name of that of {other.name}; rename one'
            )
    return maps


def _opened(path: Path, config: Config) -> ReferenceMap:
    completed = with_first_stage(config, open_model(config))
    return open_map(path, completed.encoding, config.keyframes)
