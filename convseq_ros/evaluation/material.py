# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What a data set gives to every method: images, encodings and the truth."""

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import asdict, dataclass, field, replace
from functools import cached_property
import hashlib
import json
from pathlib import Path
import time
from typing import Any

from convseq_ros.config import Config, EncodingConfig, EVERY_FRAME
from convseq_ros.core.encoding.descriptor import blank_descriptor, describe
from convseq_ros.core.encoding.first_stage import FirstStage, identity_of
from convseq_ros.core.encoding.view import upright
from convseq_ros.core.map.reference_map import ReferenceMap
from convseq_ros.core.types import Descriptor, Frame
from convseq_ros.errors import SourceError
from convseq_ros.evaluation.data_set import DataSet, Part
from convseq_ros.evaluation.truth import (
    listed,
    of_the_past,
    read_pairs,
    read_positions,
    same_index,
    Truth,
    within_radius,
)
from convseq_ros.onnx_model import open_model
from convseq_ros.reading_config import ReadingConfig
from convseq_ros.sources import open_source
from convseq_ros.sources.folder import pictures_in
from convseq_ros.sources.pose_track import PoseTrack
from convseq_ros.sources.recording import read_poses
import numpy as np
import numpy.typing as npt


@dataclass(frozen=True)
class Images:
    """The images of a drive, which can be read again and again."""

    part: Part  # where they are
    reading: ReadingConfig = ReadingConfig()  # which images are too large

    @cached_property
    def sha256(self) -> str:
        """Of the list of images (see `content_digest`), or of what they are drawn by."""
        if self.part.simulated:
            facts = json.dumps(asdict(self.part.simulated), sort_keys=True)
            return hashlib.sha256(facts.encode()).hexdigest()
        try:
            return content_digest(self.part.path)
        except OSError as error:
            raise SourceError(f'{self.part.path}: {error.strerror}; check the path') from None

    @property
    def in_color(self) -> 'Images':
        """The same, with colours."""
        return replace(self, reading=replace(self.reading, keeps_color=True))

    def __iter__(self) -> Iterator[Frame]:
        part = self.part
        source = part.simulated or open_source(part.path, part.topic, self.reading)
        if not part.backwards:
            yield from source
            return
        whole = list(source)
        first_ns, step_ns = whole[0].stamp_ns, 0
        if len(whole) > 1:
            step_ns = whole[1].stamp_ns - first_ns
        for index, frame in enumerate(reversed(whole)):
            yield replace(frame, stamp_ns=first_ns + index * step_ns)


@dataclass(frozen=True)
class Drive:
    """What was computed of the images of a drive; entry i belongs to frame i."""

    encoding: EncodingConfig
    stamps_ns: Sequence[int]
    names: Sequence[str]  # file name or topic
    readable: Sequence[bool]  # whether the image could be decoded
    descriptors: Sequence[Descriptor]  # one that shows nothing if it could not
    encode_ms: float  # median time to describe an image

    def __len__(self) -> int:
        return len(self.stamps_ns)

    @cached_property
    def informative(self) -> npt.NDArray[np.bool_]:
        """Which frames show anything, shape (N,)."""
        return np.array([one.informative for one in self.descriptors], np.bool_)

    @property
    def described(self) -> Iterator[tuple[Frame, Descriptor | None]]:
        """Frames without images, and their descriptors; None if the image was not readable."""
        columns = self.stamps_ns, self.readable, self.descriptors
        for stamp_ns, readable, descriptor in zip(*columns, strict=True):
            yield Frame(stamp_ns, None), descriptor if readable else None

    @cached_property
    def reference_map(self) -> ReferenceMap:
        """The drive as a map, without poses; frames that could not be read hold places."""
        made = ReferenceMap(self.encoding, keyframes=EVERY_FRAME)
        columns = self.stamps_ns, self.names, self.descriptors
        for stamp_ns, name, one in zip(*columns, strict=True):
            made.add_frame(Frame(stamp_ns, None, name), one)
        return made


def describe_drive(images: Images, encoding: EncodingConfig) -> Drive:
    """Describe every image of a drive, by the model of the encoding if it names one."""
    model = open_model(Config(encoding=encoding, reading=images.reading))
    blank = blank_descriptor(encoding)
    if model:
        encoding = replace(encoding, descriptor_model=identity_of(model))
        images = images.in_color if model.wants_color else images
        blank = replace(blank, vector=np.zeros(model.numbers, np.float16))
    first_stage = FirstStage(model, encoding)
    stamps_ns, names, readable, descriptors, durations = [], [], [], [], []
    for raw in images:
        frame = upright(raw, encoding)
        started = time.perf_counter()
        if frame.gray is None:
            descriptors.append(blank)
        else:
            descriptors.append(first_stage.add(frame, describe(frame.gray, encoding)))
            durations.append((time.perf_counter() - started) * 1e3)
        stamps_ns.append(frame.stamp_ns)
        names.append(frame.source)
        readable.append(frame.gray is not None)
    if not durations:
        raise SourceError(f'{images.part}: none of its {len(names)} images can be read')
    return Drive(encoding, stamps_ns, names, readable, descriptors, float(np.median(durations)))


def described(
    frames: Iterable[Frame], describe: Callable[[npt.NDArray[np.uint8]], Any]
) -> tuple[list[Any], float]:
    """Return what describes each image, None of an unreadable one, and the median ms of one."""
    rows, durations_ms = [], []
    for frame in frames:
        started = time.perf_counter()
        image = frame.gray if frame.color is None else frame.color
        rows.append(None if image is None else describe(image))
        durations_ms.append((time.perf_counter() - started) * 1e3)
    return rows, float(np.median(durations_ms))


def content_digest(path: Path) -> str:
    """
    Return the SHA-256 of the list of images of a folder, or of the only file that there is.

    The list has a line for each, in the order of the frames, as `sha256sum` prints it: the SHA-256
    of its content, two spaces, its name. In a folder without images all files count.
    """
    found = [path] if path.is_file() else pictures_in(path)
    files = found or sorted(item for item in path.iterdir() if item.is_file())
    lines = hashlib.sha256()
    for item in files:
        with item.open('rb') as file:
            content = hashlib.file_digest(file, 'sha256').hexdigest()
        lines.update(f'{content}  {item.name}\n'.encode())
    return lines.hexdigest()


@dataclass(frozen=True)
class Material:
    """A data set, opened."""

    data_set: DataSet
    query: Images
    reference: Images  # the same for a drive against its own past
    truth: Truth  # for a drive against its own past, those right answers that are past
    _drives: dict[EncodingConfig, tuple[Drive, Drive]] = field(
        default_factory=dict, compare=False, repr=False
    )

    def drives(self, encoding: EncodingConfig) -> tuple[Drive, Drive]:
        """Return query and reference, described."""
        if encoding not in self._drives:
            query = describe_drive(self.query, encoding)
            own_past = self.reference == self.query
            reference = query if own_past else describe_drive(self.reference, encoding)
            self._drives[encoding] = query, reference
        return self._drives[encoding]


def open_material(
    data_set: DataSet, encoding: EncodingConfig, reading: ReadingConfig = ReadingConfig()
) -> Material:
    """Read the images and the truth of a set; SourceError if they do not fit together."""
    parts = data_set.query, data_set.reference or data_set.query
    images = [_images(part, data_set, reading) for part in parts]
    nothing = Truth(np.zeros((0, 0), np.bool_))
    material = Material(data_set, images[0], images[1], nothing)
    drives = material.drives(encoding)
    for part, drive in zip(parts, drives, strict=True):
        if part.count and part.count != len(drive):
            raise SourceError(
                f'{data_set.name}: {len(drive)} images in {part}, expected {part.count}; '
                f'{data_set.where or "complete them"}'
            )
    truth = _truth(data_set, *drives, reading)
    if data_set.online:
        truth = of_the_past(truth, data_set.exclude_recent)
    if not truth.known.any() and data_set.truth.kind != 'none':
        raise SourceError(
            f'{data_set.name}: the truth gives no query a right reference; nothing could be '
            'measured (for a drive without revisits, say truth: {kind: none})'
        )
    return replace(material, truth=truth, _drives={encoding: drives})


def _images(part: Part, data_set: DataSet, reading: ReadingConfig) -> Images:
    if not part.path.exists():
        raise SourceError(
            f'{data_set.name}: {part.path} is missing; '
            f'{data_set.where or "correct the path in its file"}'
        )
    return Images(part, reading)


def _truth(data_set: DataSet, query: Drive, reference: Drive, reading: ReadingConfig) -> Truth:
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
        return within_radius(queries, references, source.radius_m)
    assert source.path is not None
    names = query.names, reference.names
    pairs = read_pairs(source.path, *names, source.first_index, reading)
    return listed(pairs, shape, source.tolerance, str(source.path))


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
