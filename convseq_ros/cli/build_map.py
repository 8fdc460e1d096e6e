# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Build a reference map: `convseq build-map RECORDING MAP`."""

import argparse
from collections.abc import Iterable, Iterator
from dataclasses import asdict, dataclass
import json
from pathlib import Path
import sys
import time

from convseq_ros.cli.options import add_parameters, given
from convseq_ros.cli.progress import progress
from convseq_ros.config import EncodingConfig, KeyframeConfig, make_group
from convseq_ros.core.encoding.descriptor import describe as describe_image
from convseq_ros.core.keyframes import KeyframeSelector
from convseq_ros.core.map.map_writer import MapWriter
from convseq_ros.core.map.reference_map import pack_cells, Place
from convseq_ros.core.map.thumbnail import thumbnail
from convseq_ros.core.types import Frame
from convseq_ros.errors import SourceError
from convseq_ros.parameter import Parameter, parameters
from convseq_ros.sources import open_source
from convseq_ros.sources.pose_track import PoseTrack
from convseq_ros.sources.recording import read_poses

_COMMIT_EVERY_S = 0.5


@dataclass(frozen=True, slots=True)
class Built:
    """What a build did."""

    map: str
    frames: int
    added: int
    references: int
    unreadable: int
    with_pose: int
    seconds: float
    bytes: int
    interrupted: bool


def describe(parser: argparse.ArgumentParser) -> None:
    """Declare the command's arguments."""
    parser.add_argument('recording', type=Path, help='recording or folder of images')
    parser.add_argument('map', type=Path, help='map file to make')
    parser.add_argument('--topic', default='', help='image topic, if there are several')
    parser.add_argument('--odom', default='', metavar='TOPIC', help='topic that gives poses')
    parser.add_argument('--append', action='store_true', help='add to an existing map')
    parser.add_argument('--json', action='store_true', help='print the result as JSON')
    add_parameters(parser, 'keyframes', parameters(KeyframeConfig))
    add_parameters(parser, 'encoding', [_image_size()])


def run(chosen: argparse.Namespace) -> int:
    """Build, and say what was built."""
    built = build(
        chosen.recording,
        chosen.map,
        topic=chosen.topic,
        odom=chosen.odom,
        append=chosen.append,
        keyframes=make_group(KeyframeConfig, given(chosen, parameters(KeyframeConfig))),
        encoding=make_group(EncodingConfig, given(chosen, [_image_size()])),
    )
    if chosen.json:
        print(json.dumps(asdict(built)))
    else:
        print(
            f'{built.map}: {built.references} references, {built.with_pose} with a pose, '
            f'{built.bytes / 1e6:.1f} MB; {built.added} added from {built.frames} frames '
            f'at {built.frames / max(built.seconds, 1e-9):.0f} frames/s'
        )
    if built.interrupted:
        print('convseq build-map: interrupted; the map holds what was added', file=sys.stderr)
    return int(built.interrupted)


def build(
    recording: Path,
    path: Path,
    *,
    topic: str = '',
    odom: str = '',
    append: bool = False,
    keyframes: KeyframeConfig = KeyframeConfig(),
    encoding: EncodingConfig = EncodingConfig(),
) -> Built:
    """
    Build a map file, or add to one.

    Raises
    ------
    SourceError
        If the recording cannot be read or holds no readable image; a new map is then not made.
    MapError
        If the map cannot be written.

    """
    source = open_source(recording, topic)
    track = PoseTrack(read_poses(recording, odom) if odom else [])
    started = time.monotonic()
    writer = MapWriter(path, encoding, append, keyframes)
    before = len(writer)
    frames = unreadable = with_pose = 0
    interrupted = False
    try:
        with writer:
            frames_shown = progress(source, len(source), path.name)
            for frame, kept in _add_places(frames_shown, writer, track, keyframes):
                frames += 1
                unreadable += frame.gray is None
                with_pose += kept is not None and kept.pose is not None
    except KeyboardInterrupt:
        interrupted = True
    finally:
        if not len(writer):
            path.unlink(missing_ok=True)
    for warning in source.warnings:
        print(f'warning: {warning}', file=sys.stderr)
    added = len(writer) - before
    if not added:
        raise SourceError(f'{recording}: none of its {frames} images could be used')
    return Built(
        str(path),
        frames,
        added,
        len(writer),
        unreadable,
        with_pose,
        time.monotonic() - started,
        path.stat().st_size,
        interrupted,
    )


def _add_places(
    frames: Iterable[Frame], writer: MapWriter, track: PoseTrack, keyframes: KeyframeConfig
) -> Iterator[tuple[Frame, Place | None]]:
    """Add what is worth keeping; yield every frame with the place that it became."""
    selector = KeyframeSelector(keyframes, writer.encoding)
    committed = time.monotonic()
    for frame in frames:
        place, pose = None, track.at(frame.stamp_ns)
        if frame.gray is None:
            print(f'warning: {frame.problem}', file=sys.stderr)
        elif selector.is_due(frame.stamp_ns, pose):
            found = describe_image(frame.gray, writer.encoding)
            if selector.wants(frame.stamp_ns, found, pose):
                small = thumbnail(frame.gray, keyframes.thumbnail_width_px)
                place = Place(frame.stamp_ns, frame.source, pose)
                writer.add(place, pack_cells(found.cells), small)
        yield frame, place
        if time.monotonic() - committed > _COMMIT_EVERY_S:
            writer.commit()
            committed = time.monotonic()


def _image_size() -> Parameter:
    return next(item for item in parameters(EncodingConfig) if item.name == 'image_size_px')
