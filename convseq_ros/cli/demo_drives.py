# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The two drives that a demo shows, drawn or given in a folder, and the folder of its results."""

import argparse
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
import shutil
from typing import NamedTuple

from convseq_ros.cli.terminal import warn
from convseq_ros.errors import ConvseqError, SourceError
from convseq_ros.evaluation.truth import listed
from convseq_ros.evaluation.truth_file import read_pairs
from convseq_ros.reading_config import ReadingConfig
from convseq_ros.simulation.drive import draw, Drive
from convseq_ros.simulation.recording import nearest_reference, write_recording
from convseq_ros.simulation.street import Street
from convseq_ros.sources import open_source
from convseq_ros.sources.recording import read_camera, read_poses, Recording
from convseq_ros.sources.topics import CAMERA_TYPES, ODOMETRY_TYPES
import numpy as np
import numpy.typing as npt


def make_empty(folder: Path, marker: str) -> None:
    """Make a folder anew; ConvseqError if it is not empty and no demo, by its marker, made it."""
    mark = folder / marker
    if folder.exists() and any(folder.iterdir()) and not mark.is_file():
        raise ConvseqError(f'{folder}: exists and is not of an earlier demo; choose another')
    shutil.rmtree(folder, ignore_errors=True)
    folder.mkdir(parents=True)
    mark.touch()


class SideTopics(NamedTuple):
    """Topics of odometry and of the camera's description; empty for none."""

    odom: str = ''
    camera_info: str = ''


def side_topics(path: Path, reading: ReadingConfig = ReadingConfig()) -> SideTopics:
    """
    Return the topics of a recording that say where its frames were taken, and by which camera.

    One is left out, with a line on standard error, if several could be meant or what it says
    cannot be used. A folder of pictures has none.
    """
    source = open_source(path, reading=reading)
    if not isinstance(source, Recording):
        return SideTopics()
    return SideTopics(
        _usable(path, source.topics_of(ODOMETRY_TYPES), read_poses, reading),
        _usable(path, source.topics_of(CAMERA_TYPES), read_camera, reading),
    )


def _usable(
    path: Path,
    topics: list[str],
    read: Callable[[Path, str, ReadingConfig], object],
    reading: ReadingConfig,
) -> str:
    if len(topics) > 1:
        warn(f'{path}: left out {", ".join(topics)}: several could be meant')
    if len(topics) != 1:
        return ''
    try:
        read(path, topics[0], reading)
    except SourceError as error:
        warn(f'left out {topics[0]}: {error}')
        return ''
    return topics[0]


@dataclass(frozen=True, slots=True)
class Drives:
    """Two drives along the same places."""

    reference: Path  # recording or folder of images
    query: Path
    truth: npt.NDArray[np.int64]  # (Q,), the right reference of each query; -1 where not known
    told: str  # where they come from, for the heading


def drawn_drives(chosen: argparse.Namespace, folder: Path) -> Drives:
    """Draw a street and drive along it twice, as the command asks."""
    street = Street(length_m=chosen.frames * max(1.0, chosen.speed / 10) + 60, seed=7)
    first = Drive(num_frames=chosen.frames + 10)
    second = Drive(
        num_frames=chosen.frames,
        start_m=3.4,
        speed_mps=chosen.speed,
        seed=5,
        lane_offset_m=chosen.lane_offset,
        light=chosen.light,
        start_ns=first.start_ns + 3600 * 10**9,
    )
    distances = []
    for name, drive in (('first', first), ('second', second)):
        shots = draw(street, drive)
        write_recording(folder / name, shots, info_topic='/camera/camera_info')
        distances.append([drive.distance_m(index) for index in range(drive.num_frames)])
    truth = nearest_reference(np.array(distances[1]), np.array(distances[0]))
    told = (
        f'A drawn street: mapped by day, driven again in the {chosen.light}, '
        f'{abs(first.lane_offset_m - chosen.lane_offset):.1f} m to the side.'
    )
    return Drives(folder / 'first', folder / 'second', truth, told)


def given_drives(data: Path, reading: ReadingConfig) -> Drives:
    """Return the two drives of a folder, the query first by name."""
    if not data.is_dir():
        raise SourceError(f'{data}: no such folder')
    found = []
    for path in sorted(data.iterdir()):
        try:
            found.append((path, len(open_source(path, reading=reading))))
        except ConvseqError:
            continue
    if len(found) != 2:
        names = ', '.join(path.name for path, _ in found) or 'none'
        raise SourceError(
            f'{data}: needs two drives (folders of images or recordings); found {names}'
        )
    (query, queries), (reference, references) = found
    told = (
        f'{data}: {query.name} ({queries} images) recognised in {reference.name} ({references}).'
    )
    return Drives(reference, query, _given_truth(data, queries, references), told)


def _given_truth(data: Path, queries: int, references: int) -> npt.NDArray[np.int64]:
    """Read ground_truth.csv; without it, equally long drives are taken as frame by frame."""
    file = data / 'ground_truth.csv'
    if not file.is_file():
        known = np.arange(queries) if queries == references else np.full(queries, -1)
        return known.astype(np.int64)
    right = listed(read_pairs(file, (), ()), (queries, references), 0, str(file)).right
    return np.where(right.any(axis=1), right.argmax(axis=1), -1)
