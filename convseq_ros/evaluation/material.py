# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The input of every method: both drives of a data set, and their ground truth."""

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import TypeVar

from convseq_ros.config import EncodingConfig
from convseq_ros.config.reading_config import ReadingConfig
from convseq_ros.errors import SourceError
from convseq_ros.evaluation.cache import Cache
from convseq_ros.evaluation.data_set import DataSet, Part
from convseq_ros.evaluation.drive import describe_drive, DescribedDrive
from convseq_ros.evaluation.images import Images
from convseq_ros.evaluation.truth import (
    from_pairs,
    past_only,
    positions_in,
    read_pairs,
    read_positions,
    same_index,
    Truth,
    within_radius,
)
from convseq_ros.sources.pose_track import PoseTrack
from convseq_ros.sources.recording import read_poses
import numpy as np
import numpy.typing as npt

Made = TypeVar('Made')


@dataclass(frozen=True)
class Material:
    """An opened data set."""

    data_set: DataSet
    query: Images
    reference: Images  # equals `query` for a drive against its own past
    truth: Truth  # for a drive against its own past, without the recent frames
    _drives: dict[EncodingConfig, tuple[DescribedDrive, DescribedDrive]] = field(
        default_factory=dict, compare=False, repr=False
    )

    @property
    def unmissable(self) -> int:
        """How many queries have every place that they are compared with as a right one."""
        queries, places = self.truth.right.shape
        asked = np.full(queries, places)
        if self.data_set.online:
            asked = np.arange(queries) + 1 - max(1, self.data_set.exclude_recent)
        right = self.truth.right.sum(axis=1)
        return int((self.truth.known & (right == asked)).sum())

    def drives(self, encoding: EncodingConfig) -> tuple[DescribedDrive, DescribedDrive]:
        """Return the described query and reference."""
        if encoding not in self._drives:
            self._drives[encoding] = self.each(lambda images: describe_drive(images, encoding))
        return self._drives[encoding]

    def each(self, make: Callable[[Images], Made]) -> tuple[Made, Made]:
        """Return what is made of query and reference: of equal ones, made once."""
        query = make(self.query)
        return query, query if self.reference == self.query else make(self.reference)


def open_material(
    data_set: DataSet,
    encoding: EncodingConfig,
    reading: ReadingConfig = ReadingConfig(),
    cache: Cache | None = None,
) -> Material:
    """Return a set with images and truth read; SourceError if they do not fit together."""
    parts = data_set.query, data_set.reference or data_set.query
    images = [_images(part, data_set, reading, cache) for part in parts]
    no_truth = Truth(np.zeros((0, 0), np.bool_))
    material = Material(data_set, images[0], images[1], no_truth)
    drives = material.drives(encoding)
    for part, drive in zip(parts, drives, strict=True):
        if part.count and part.count != len(drive):
            raise SourceError(
                f'{data_set.name}: {len(drive)} images in {part}, expected {part.count}; '
                f'{data_set.where or "complete them"}'
            )
    truth = _truth(data_set, *drives, reading)
    if data_set.online:
        truth = past_only(truth, data_set.exclude_recent)
    if not truth.known.any() and data_set.truth.kind != 'none':
        raise SourceError(
            f'{data_set.name}: no query has a right reference in the truth; nothing could be '
            'measured (for a drive without revisits, set truth: {kind: none})'
        )
    return replace(material, truth=truth, _drives={encoding: drives})


def _images(part: Part, data_set: DataSet, reading: ReadingConfig, cache: Cache | None) -> Images:
    if not part.path.exists():
        raise SourceError(
            f'{data_set.name}: {part.path} is missing; '
            f'{data_set.where or "correct the path in its file"}'
        )
    return Images(part, reading, cache)


def _truth(
    data_set: DataSet, query: DescribedDrive, reference: DescribedDrive, reading: ReadingConfig
) -> Truth:
    source, shape = data_set.truth, (len(query), len(reference))
    if source.kind == 'none':
        return Truth(np.zeros(shape, np.bool_))
    if source.kind == 'identity':
        try:
            return same_index(*shape, source.tolerance)
        except SourceError as error:
            raise SourceError(f'{data_set.name}: {error}') from None
    if source.kind == 'poses':
        queries = _positions(data_set, data_set.query, query, 'query', reading)
        references = queries
        if data_set.reference is not None:
            references = _positions(data_set, data_set.reference, reference, 'reference', reading)
        truth = within_radius(queries, references, source.radius_m)
        known = (np.isfinite(drive).all(axis=1) for drive in (queries, references))
        if (all_right := truth.right[np.ix_(*known)]).size and all_right.all():
            raise SourceError(
                f'{data_set.name}: all positions lie within radius_m, {source.radius_m:g}, of '
                'each other, so every place would be right; give a smaller radius_m, or name the '
                'columns lat, lon if they are degrees'
            )
        return truth
    assert source.path is not None
    names = query.names, reference.names
    pairs = read_pairs(source.path, *names, source.first_index, reading)
    return from_pairs(pairs, shape, source.tolerance, str(source.path), source.first_index)


def _positions(
    data_set: DataSet, part: Part, drive: DescribedDrive, name: str, reading: ReadingConfig
) -> npt.NDArray[np.float64]:
    if part.backwards:
        raise SourceError(f'{data_set.name}: {name}: poses cannot go backwards; give a table')
    if data_set.truth.path is not None:
        return read_positions(data_set.truth.path, name, drive.names, reading)
    if (told := positions_in(drive.names)) is not None:
        return told
    track = PoseTrack(read_poses(part.path, part.odom, reading))
    poses = [track.at(stamp_ns) for stamp_ns in drive.stamps_ns]
    return np.array([pose.position if pose else (np.nan,) * 3 for pose in poses])
