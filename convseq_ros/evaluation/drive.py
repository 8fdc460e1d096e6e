# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A drive whose images are described."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
import time

from convseq_ros.config import Config, EncodingConfig, EVERY_FRAME, KeyframeConfig
from convseq_ros.core.encoding.descriptor import (
    blank_descriptor,
    cell_shape,
    describe,
    visible_cells,
)
from convseq_ros.core.encoding.first_stage import FirstStage, identity_of
from convseq_ros.core.encoding.glance import brightness
from convseq_ros.core.encoding.keypoints import detect
from convseq_ros.core.geometry.map_view import upright
from convseq_ros.core.map.image_coding import thumbnail
from convseq_ros.core.map.reference_map import ReferenceMap
from convseq_ros.core.types import Descriptor, Frame
from convseq_ros.errors import SourceError
from convseq_ros.evaluation.cache import Made
from convseq_ros.evaluation.images import Images
from convseq_ros.models.onnx_model import OnnxModel, open_model
import numpy as np
import numpy.typing as npt

# Of a descriptor; only a model gives a vector.
_ARRAYS = 'cells', 'salient', 'cell_entropy', 'vector', 'keypoints', 'brightness'


@dataclass(frozen=True)
class DescribedDrive:
    """The descriptors of a drive's images; entry i belongs to frame i."""

    encoding: EncodingConfig
    stamps_ns: Sequence[int]
    names: Sequence[str]  # file name or topic
    readable: Sequence[bool]  # whether the image could be decoded
    descriptors: Sequence[Descriptor]  # blank for an unreadable image
    encode_ms: float  # median time to describe an image ...
    keypoints_ms: float  # ... and to detect its keypoints
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


def describe_drive(images: Images, encoding: EncodingConfig) -> DescribedDrive:
    """Return the described drive; uses the descriptor model of the encoding, if there is one."""
    model = open_model(Config(encoding=encoding, reading=images.reading))
    blank = blank_descriptor(encoding)
    if model:
        encoding = replace(encoding, descriptor_model=identity_of(model))
        blank = replace(blank, vector=np.zeros(model.numbers, np.float16))
    facts, rows = images.once(('drive', encoding), lambda: _described(images, encoding, model))
    images.warnings[:] = facts['warnings']
    arrays = {name: rows[name] for name in _ARRAYS if name in rows}
    found = iter(
        Descriptor(entropy=entropy, **dict(zip(arrays, row, strict=True)))
        for entropy, *row in zip(facts['entropies'], *arrays.values(), strict=True)
    )
    drive = facts['drive']
    descriptors = [next(found) if readable else blank for readable in drive['readable']]
    thumbnails = [small.tobytes() for small in rows['thumbnails']]
    return DescribedDrive(encoding, descriptors=descriptors, thumbnails=thumbnails, **drive)


def _described(images: Images, encoding: EncodingConfig, model: OnnxModel | None) -> Made:
    """Return what `describe_drive` makes of images; arrays only of those that can be read."""
    first_stage = FirstStage(model, encoding)
    kept = KeyframeConfig()
    visible = visible_cells(encoding.image_mask, cell_shape(encoding.image_size_px)[0])
    stamps_ns, names, readable, descriptors = [], [], [], []
    described_ms, detected_ms = [], []
    thumbnails: list[bytes] = []
    problems: list[str] = []
    for raw in images:
        frame = upright(raw, encoding)
        started = time.perf_counter()
        if frame.gray is not None:
            descriptor = first_stage.add(frame, describe(frame.gray, encoding))
            described_ms.append((time.perf_counter() - started) * 1e3)
            corners = detect(frame.gray, visible, kept.keypoints)
            detected_ms.append((time.perf_counter() - started) * 1e3 - described_ms[-1])
            light = brightness(frame.gray)
            descriptors.append(replace(descriptor, keypoints=corners, brightness=light))
        gray = frame.gray
        if frame.problem:
            problems.append(frame.problem)
        thumbnails.append(b'' if gray is None else thumbnail(gray, kept.thumbnail_width_px))
        stamps_ns.append(frame.stamp_ns)
        names.append(frame.source)
        readable.append(frame.gray is not None)
    if not described_ms:
        raise SourceError(f'{images.part}: none of its {len(names)} images can be read')
    if problems:
        told = f'{len(problems)} of {len(names)} images cannot be read, such as {problems[0]}'
        images.warnings.append(f'{images.part}: {told}')
    arrays = {name: [getattr(one, name) for one in descriptors] for name in _ARRAYS}
    if model is None:
        del arrays['vector']
    return Made(
        {
            'drive': {
                'stamps_ns': stamps_ns,
                'names': names,
                'readable': readable,
                'encode_ms': float(np.median(described_ms)),
                'keypoints_ms': float(np.median(detected_ms)),
            },
            'entropies': [one.entropy for one in descriptors],
            'warnings': [*images.warnings],
        },
        {'thumbnails': [np.frombuffer(small, np.uint8) for small in thumbnails], **arrays},
    )
