# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Many maps on many processes or machines: `convseq fleet build` and so on."""

import argparse
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import asdict, replace
import json
from pathlib import Path
import sys
import time
from typing import Any

from convseq_ros.cli.build_map import add_no_links, add_settings, build, Built, chosen_settings
from convseq_ros.cli.options import (
    add_images,
    add_verb,
    chosen_config,
    chosen_images,
    progress,
    warn,
)
from convseq_ros.cli.replay import add_replay, in_words, replay_chosen
from convseq_ros.config import Config
from convseq_ros.core.encoding.first_stage import with_first_stage
from convseq_ros.core.map.lock import MapLock
from convseq_ros.core.map.reader import MapReader
from convseq_ros.core.map.writer import replaced
from convseq_ros.core.similarity.threads import usable_cores
from convseq_ros.errors import ConvseqError, FleetError, MapError, SourceError
from convseq_ros.fleet.cluster import Cluster, connected, finished_jobs
from convseq_ros.fleet.fleet import Fleet
from convseq_ros.models.onnx_model import open_model
from convseq_ros.sources.folder import natural_key
from convseq_ros.sources.recording_names import recordings_in

Job = tuple[Path, Path, Config, bool, dict[str, Any]]  # the arguments of `build_one`


def describe(parser: argparse.ArgumentParser) -> None:
    verbs = parser.add_subparsers(dest='work', required=True, metavar='build|replay')
    verb = add_verb(
        verbs, 'build', _build, 'build a map of each recording in a folder, in parallel'
    )
    verb.add_argument('folder', type=Path, help='folder of recordings, one map each')
    help_ = 'folder for the maps, made if there is none; finished maps in it are kept'
    verb.add_argument('-o', '--output', type=Path, required=True, metavar='MAPS', help=help_)
    add_images(verb, poses=False)
    add_no_links(verb)
    verb.add_argument('--json', action='store_true', help='print the result as JSON')
    _add_cluster(verb)
    add_settings(verb)
    folder = 'folder of maps, which are searched like one map'
    verb = add_verb(
        verbs, 'replay', _replay, 'recognise the frames of a recording in all maps of a folder'
    )
    verb.add_argument('maps', type=Path, help=folder)
    verb.add_argument('recording', type=Path, help='recording or folder of images')
    _add_cluster(verb)
    add_replay(verb)


def run(chosen: argparse.Namespace) -> int:
    return int(chosen.act(chosen))


def _add_cluster(parser: argparse.ArgumentParser) -> None:
    add = parser.add_argument_group('cluster').add_argument
    help_ = 'workers on this machine (as many as it has cores); not with a scheduler'
    add('--workers', type=int, metavar='N', help=help_)
    help_ = (
        'a running scheduler of Dask, whose workers see the same files, instead; on another '
        'machine tls://HOST:PORT, with the certificates in the configuration of Dask'
    )
    add('--scheduler', default='', metavar='tcp://HOST:PORT', help=help_)


def _chosen_cluster(chosen: argparse.Namespace) -> Cluster:
    """Return the cluster that the options select; FleetError if they contradict each other."""
    workers = chosen.workers
    if workers is not None and chosen.scheduler:
        raise FleetError('--workers is for this machine; a scheduler has its own')
    if workers is not None and workers < 1:
        raise FleetError(f'--workers {workers}: needs at least 1')
    return Cluster(chosen.scheduler, workers or usable_cores())


def _build(chosen: argparse.Namespace) -> int:
    """Build the missing maps, and print the result of each recording."""
    cluster, config = _chosen_cluster(chosen), chosen_settings(chosen)
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
        job = recording.resolve(), path.resolve(), config, not chosen.no_links
        jobs[str(path)] = *job, chosen_images(chosen)
    started, built = time.monotonic(), dict[str, Built]()
    if jobs:
        try:
            with connected(cluster) as client:
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
    seconds = time.monotonic() - started
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


def _opened(path: Path, config: Config) -> MapReader:
    completed = with_first_stage(config, open_model(config))
    return MapReader(path, completed.encoding, config.keyframes)


def _replay(chosen: argparse.Namespace) -> int:
    """Replay, write the table, and print a summary."""
    paths, reported = maps_in(chosen.maps), set[str]()
    # Without a scheduler, workers run in this process: unpickled messages cost half.
    with connected(replace(_chosen_cluster(chosen), are_threads=True)) as client:
        sources, config = chosen.topic.split(), chosen_config(chosen)
        model = open_model(config)
        fleet = Fleet(client, paths, config, sources=sources, describe=model)

        def warn_of_missing() -> None:
            for line in fleet.missing:
                if line not in reported:
                    warn(f'{line}; the other maps answer')
            reported.update(fleet.missing)

        warn_of_missing()
        for line in fleet.ignored:
            warn(line)
        fleet.cameras.warm_up()
        summary = replay_chosen(chosen, fleet.cameras, chosen.maps, warn_of_missing)
    if chosen.json:
        about = {'output': str(chosen.output), 'slow': fleet.slow, 'missing': fleet.missing}
        print(json.dumps(about | summary))
    else:
        lost = f', {len(fleet.missing)} of {len(paths)} maps missing' if fleet.missing else ''
        print(f'{chosen.maps}: {fleet.count} places of {len(fleet.offsets)} maps{lost}')
        print(f'{chosen.output}: {in_words(summary, fleet.slow)}')
    return 0


def maps_in(folder: Path) -> list[Path]:
    """Return the maps in a folder, map2 before map10; MapError if there are none."""
    maps = sorted((path for path in folder.glob('*.db') if path.is_file()), key=natural_key)
    if not maps:
        raise MapError(f'{folder}: no map in it (*.db); make some with convseq fleet build')
    return maps
