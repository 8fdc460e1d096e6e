# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What a data set gives to every method: images, encodings and the truth."""

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path

from convseq_ros.config import EncodingConfig
from convseq_ros.errors import SourceError
from convseq_ros.evaluation.cache import Cache
from convseq_ros.evaluation.data_set import DataSet, Part
from convseq_ros.evaluation.drive import describe_drive, Drive, Images
from convseq_ros.evaluation.simulated import SimulatedDrive
from convseq_ros.evaluation.truth import listed, of_the_past, same_index, Truth, within_radius
from convseq_ros.evaluation.truth_file import read_npy, read_pairs, read_positions
from convseq_ros.reading_config import ReadingConfig
from convseq_ros.simulation.drive import Drive as DrawnDrive
from convseq_ros.sources.pose_track import PoseTrack
from convseq_ros.sources.recording import read_poses
import numpy as np
import numpy.typing as npt

# A street that no ready-made set has, a place every 2 m.
DISTRACTORS_STREET = 7_000_000
DISTRACTORS = DrawnDrive(seed=7, frame_rate_hz=5.0, width_px=320, height_px=240)


@dataclass(frozen=True)
class Material:
    """
    A data set, opened.

    Parameters
    ----------
    data_set : DataSet
        What was asked for.
    query, reference : Images
        The drives; the same for a drive against its own past.
    truth : Truth
        The right answers; for a drive against its own past, those that are past.
    cache : Cache
        Where encodings and results are kept.
    way_m : ndarray of float64, shape (Q,), or None
        How far along its way each query was taken, if that is known.
    distractors : Images or None
        Places that no query shows, added to the end of the map.

    """

    data_set: DataSet
    query: Images
    reference: Images
    truth: Truth
    cache: Cache
    way_m: npt.NDArray[np.float64] | None = None
    distractors: Images | None = None
    _drives: dict[EncodingConfig, tuple[Drive, Drive]] = field(
        default_factory=dict, compare=False, repr=False
    )

    def drives(self, encoding: EncodingConfig) -> tuple[Drive, Drive]:
        """Return query and reference, described."""
        if encoding not in self._drives:
            query = describe_drive(self.query, encoding, self.cache)
            own_past = self.reference == self.query
            reference = query if own_past else describe_drive(self.reference, encoding, self.cache)
            if self.distractors:
                others = describe_drive(self.distractors, encoding, self.cache)
                reference = reference.followed_by(others)
            self._drives[encoding] = query, reference
        return self._drives[encoding]

    @cached_property
    def content(self) -> list[object]:
        """What determines the images, for a cache."""
        others = [self.distractors.content] if self.distractors else []
        return [self.query.content, self.reference.content, *others]


def open_material(
    data_set: DataSet,
    cache: Cache,
    encoding: EncodingConfig,
    reading: ReadingConfig = ReadingConfig(),
) -> Material:
    """
    Read the images and the truth of a data set, and check one against the other.

    Raises
    ------
    SourceError
        If images are missing, counts disagree, or no query has a right reference.

    """
    query = _images(data_set.query, data_set, cache, encoding, reading)
    reference = query
    if data_set.reference is not None:
        reference = _images(data_set.reference, data_set, cache, encoding, reading)
    nothing = Truth(np.zeros((0, 0), np.bool_))
    material = Material(data_set, query, reference, nothing, cache)
    drives = material.drives(encoding)
    for part, drive in zip((data_set.query, data_set.reference), drives, strict=True):
        if part and part.count and part.count != len(drive):
            raise SourceError(
                f'{data_set.name}: {len(drive)} images in {part}, expected {part.count}; '
                f'{data_set.where or "complete them"}'
            )
    truth = _TRUTHS[data_set.truth.kind](data_set, *drives, reading)
    if data_set.online:
        truth = of_the_past(truth, data_set.exclude_recent)
    if not truth.known.any() and data_set.truth.kind != 'none':
        raise SourceError(
            f'{data_set.name}: the truth gives no query a right reference; nothing could be '
            'measured (for a drive without revisits, say truth: {kind: none})'
        )
    way_m = _way_m(data_set, drives[0], reading)
    return replace(material, truth=truth, way_m=way_m, _drives={encoding: drives})


def with_distractors(material: Material, count: int) -> Material:
    """Return a data set with so many drawn places in its map that no query shows, at its end."""
    whole = Truth(np.pad(material.truth.right, ((0, 0), (0, count))), material.truth.tolerance)
    drive = SimulatedDrive(DISTRACTORS_STREET, replace(DISTRACTORS, num_frames=count))
    return replace(material, truth=whole, distractors=Images(Path(), '', drive), _drives={})


def _images(
    part: Part, data_set: DataSet, cache: Cache, encoding: EncodingConfig, reading: ReadingConfig
) -> Images:
    if not part.path.exists():
        raise SourceError(
            f'{data_set.name}: {part.path} is missing; '
            f'{data_set.where or "correct the path in its file"}'
        )
    images = Images(part.path, part.topic, part.simulated, reading=reading)
    if part.backwards:
        return images.reversed(len(describe_drive(images, encoding, cache)))
    return images


def _identity(data_set: DataSet, query: Drive, reference: Drive, _: ReadingConfig) -> Truth:
    try:
        return same_index(len(query), len(reference), data_set.truth.tolerance)
    except SourceError as error:
        raise SourceError(f'{data_set.name}: {error}') from None


def _table(data_set: DataSet, query: Drive, reference: Drive, reading: ReadingConfig) -> Truth:
    said = data_set.truth
    assert said.path is not None
    pairs = read_pairs(said.path, query.names, reference.names, said.first_index, reading)
    return listed(pairs, (len(query), len(reference)), said.tolerance, str(said.path))


def _npy(data_set: DataSet, query: Drive, reference: Drive, reading: ReadingConfig) -> Truth:
    said = data_set.truth
    shape = len(query), len(reference)
    assert said.path is not None
    return listed(read_npy(said.path, shape, reading), shape, said.tolerance, str(said.path))


def _poses(data_set: DataSet, query: Drive, reference: Drive, reading: ReadingConfig) -> Truth:
    first = _positions(data_set, data_set.query, query, 'query', reading)
    second = (
        first
        if data_set.reference is None
        else _positions(data_set, data_set.reference, reference, 'reference', reading)
    )
    return within_radius(first, second, data_set.truth.radius_m)


def _positions(
    data_set: DataSet, part: Part, drive: Drive, name: str, reading: ReadingConfig
) -> npt.NDArray[np.float64]:
    if part.backwards:
        raise SourceError(f'{data_set.name}: {name}: poses cannot go backwards; give a table')
    if data_set.truth.path is not None:
        return read_positions(data_set.truth.path, name, len(drive), reading)
    track = PoseTrack(read_poses(part.path, part.odom, reading))
    poses = [track.at(stamp_ns) for stamp_ns in drive.stamps_ns]
    return np.array([pose.position if pose else (np.nan,) * 3 for pose in poses])


def _way_m(
    data_set: DataSet, query: Drive, reading: ReadingConfig
) -> npt.NDArray[np.float64] | None:
    """Return how far along its way each frame was taken, (N,), where poses or drawing tell it."""
    if simulated := data_set.query.simulated:
        return np.array([simulated.drive.distance_m(index) for index in range(len(query))])
    if data_set.truth.kind != 'poses':
        return None
    positions = _positions(data_set, data_set.query, query, 'query', reading)
    steps = np.linalg.norm(np.diff(positions, axis=0), axis=1)
    return np.concatenate(([0.0], np.nancumsum(steps)))


def _none(_: DataSet, query: Drive, reference: Drive, _reading: ReadingConfig) -> Truth:
    return Truth(np.zeros((len(query), len(reference)), np.bool_))


_TRUTHS: dict[str, Callable[[DataSet, Drive, Drive, ReadingConfig], Truth]] = {
    'identity': _identity,
    'table': _table,
    'npy': _npy,
    'poses': _poses,
    'none': _none,
}
