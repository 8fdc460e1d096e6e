# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The input of every method: images, encodings and the ground truth of a data set."""

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import asdict, dataclass, field, replace
from functools import cached_property
import hashlib
import json
from pathlib import Path
import time
from typing import Any

from convseq_ros.config import Config, EncodingConfig, EVERY_FRAME, KeyframeConfig
from convseq_ros.config.reading_config import ReadingConfig
from convseq_ros.core.encoding.brightness import brightness
from convseq_ros.core.encoding.descriptor import blank_descriptor, describe, visible_cells
from convseq_ros.core.encoding.first_stage import FirstStage, identity_of
from convseq_ros.core.encoding.keypoints import detect
from convseq_ros.core.encoding.view import upright
from convseq_ros.core.map.image_coding import thumbnail
from convseq_ros.core.map.reference_map import ReferenceMap
from convseq_ros.core.types import Descriptor, Frame
from convseq_ros.errors import SourceError
from convseq_ros.evaluation.data_set import DataSet, Part
from convseq_ros.evaluation.truth import (
    from_pairs,
    past_only,
    read_pairs,
    read_positions,
    same_index,
    Truth,
    within_radius,
)
from convseq_ros.models.onnx_model import open_model
from convseq_ros.sources import open_source
from convseq_ros.sources.folder import pictures_in
from convseq_ros.sources.pose_track import PoseTrack
from convseq_ros.sources.recording import read_poses
import numpy as np
import numpy.typing as npt


@dataclass(frozen=True)
class Images:
    """The images of a drive, which can be read repeatedly."""

    part: Part  # location
    reading: ReadingConfig = ReadingConfig()  # size limits

    @cached_property
    def sha256(self) -> str:
        """Digest of the images (see `content_digest`), or of the settings of drawn images."""
        if self.part.simulated:
            facts = json.dumps(asdict(self.part.simulated), sort_keys=True)
            return hashlib.sha256(facts.encode()).hexdigest()
        try:
            return content_digest(self.part.path)
        except OSError as error:
            raise SourceError(f'{self.part.path}: {error.strerror}; check the path') from None

    @property
    def in_color(self) -> 'Images':
        """The same images in colour."""
        return replace(self, reading=replace(self.reading, keeps_color=True))

    def __iter__(self) -> Iterator[Frame]:
        part = self.part
        source = part.simulated or open_source(part.path, part.topic, self.reading)
        if not part.backwards:
            yield from source
            return
        frames = list(source)
        first_ns, step_ns = frames[0].stamp_ns, 0
        if len(frames) > 1:
            step_ns = frames[1].stamp_ns - first_ns
        for index, frame in enumerate(reversed(frames)):
            yield replace(frame, stamp_ns=first_ns + index * step_ns)


@dataclass(frozen=True)
class Drive:
    """The descriptors of a drive's images; entry i belongs to frame i."""

    encoding: EncodingConfig
    stamps_ns: Sequence[int]
    names: Sequence[str]  # file name or topic
    readable: Sequence[bool]  # whether the image could be decoded
    descriptors: Sequence[Descriptor]  # blank for an unreadable image
    encode_ms: float  # median time to describe an image
    thumbnails: Sequence[bytes] = ()  # JPEG; empty for an unreadable image

    def __len__(self) -> int:
        return len(self.stamps_ns)

    @cached_property
    def informative(self) -> npt.NDArray[np.bool_]:
        """Flags of the informative frames, (N,)."""
        return np.array([item.informative for item in self.descriptors], np.bool_)

    @property
    def described(self) -> Iterator[tuple[Frame, Descriptor | None]]:
        """Frames without images, with their descriptors; None for an unreadable image."""
        columns = self.stamps_ns, self.readable, self.descriptors
        for stamp_ns, readable, descriptor in zip(*columns, strict=True):
            yield Frame(stamp_ns, None), descriptor if readable else None

    @cached_property
    def reference_map(self) -> ReferenceMap:
        """The drive as a map without poses; unreadable frames become blank places."""
        reference_map = ReferenceMap(self.encoding, keyframes=EVERY_FRAME)
        for index, descriptor in enumerate(self.descriptors):
            frame = Frame(self.stamps_ns[index], None, self.names[index])
            small = self.thumbnails[index] if self.thumbnails else b''
            reference_map.add_frame(frame, descriptor, small=small)
        return reference_map


def describe_drive(images: Images, encoding: EncodingConfig) -> Drive:
    """Return the described drive; uses the descriptor model of the encoding, if there is one."""
    model = open_model(Config(encoding=encoding, reading=images.reading))
    blank = blank_descriptor(encoding)
    if model:
        encoding = replace(encoding, descriptor_model=identity_of(model))
        images = images.in_color if model.wants_color else images
        blank = replace(blank, vector=np.zeros(model.numbers, np.float16))
    first_stage = FirstStage(model, encoding)
    kept = KeyframeConfig()
    visible = visible_cells(encoding.image_mask, blank.cells.shape[0])
    stamps_ns, names, readable, descriptors, durations = [], [], [], [], []
    thumbnails: list[bytes] = []
    for raw in images:
        frame = upright(raw, encoding)
        started = time.perf_counter()
        if frame.gray is None:
            descriptors.append(blank)
        else:
            descriptor = first_stage.add(frame, describe(frame.gray, encoding))
            durations.append((time.perf_counter() - started) * 1e3)
            corners = detect(frame.gray, visible, kept.keypoints)
            light = brightness(frame.gray)
            descriptors.append(replace(descriptor, keypoints=corners, brightness=light))
        gray = frame.gray
        thumbnails.append(b'' if gray is None else thumbnail(gray, kept.thumbnail_width_px))
        stamps_ns.append(frame.stamp_ns)
        names.append(frame.source)
        readable.append(frame.gray is not None)
    if not durations:
        raise SourceError(f'{images.part}: none of its {len(names)} images can be read')
    encode_ms = float(np.median(durations))
    return Drive(encoding, stamps_ns, names, readable, descriptors, encode_ms, thumbnails)


def described(
    frames: Iterable[Frame], describe: Callable[[npt.NDArray[np.uint8]], Any]
) -> tuple[list[Any], float]:
    """Return a descriptor per image, None if unreadable, and the median time in ms."""
    rows, durations_ms = [], []
    for frame in frames:
        started = time.perf_counter()
        image = frame.gray if frame.color is None else frame.color
        rows.append(None if image is None else describe(image))
        durations_ms.append((time.perf_counter() - started) * 1e3)
    return rows, float(np.median(durations_ms))


def content_digest(path: Path) -> str:
    """
    Return the SHA-256 of the list of images in a folder, or of a single file.

    The list has a line per file, in frame order, as `sha256sum` prints it: the SHA-256 of the
    content, two spaces, the name. A folder without images is listed with all its files.
    """
    images = [path] if path.is_file() else pictures_in(path)
    files = images or sorted(file_path for file_path in path.iterdir() if file_path.is_file())
    lines = hashlib.sha256()
    for file_path in files:
        with file_path.open('rb') as file:
            content = hashlib.file_digest(file, 'sha256').hexdigest()
        lines.update(f'{content}  {file_path.name}\n'.encode())
    return lines.hexdigest()


@dataclass(frozen=True)
class Material:
    """An opened data set."""

    data_set: DataSet
    query: Images
    reference: Images  # equals `query` for a drive against its own past
    truth: Truth  # for a drive against its own past, without the recent frames
    _drives: dict[EncodingConfig, tuple[Drive, Drive]] = field(
        default_factory=dict, compare=False, repr=False
    )

    def drives(self, encoding: EncodingConfig) -> tuple[Drive, Drive]:
        """Return the described query and reference."""
        if encoding not in self._drives:
            query = describe_drive(self.query, encoding)
            own_past = self.reference == self.query
            reference = query if own_past else describe_drive(self.reference, encoding)
            self._drives[encoding] = query, reference
        return self._drives[encoding]


def open_material(
    data_set: DataSet, encoding: EncodingConfig, reading: ReadingConfig = ReadingConfig()
) -> Material:
    """Return a set with images and truth read; SourceError if they do not fit together."""
    parts = data_set.query, data_set.reference or data_set.query
    images = [_images(part, data_set, reading) for part in parts]
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
    return from_pairs(pairs, shape, source.tolerance, str(source.path))


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
