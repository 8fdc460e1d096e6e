# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""One drive, ready to be matched: its images on demand, and what was computed of each."""

from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass, fields, replace
from functools import cached_property
import json
from pathlib import Path
import time
from typing import Any

from convseq_ros.config import Config, EncodingConfig, EVERY_FRAME
from convseq_ros.core.encoding.descriptor import blank_descriptor, describe
from convseq_ros.core.encoding.first_stage import FirstStage, identity_of
from convseq_ros.core.encoding.view import upright
from convseq_ros.core.map.reference_map import ReferenceMap
from convseq_ros.core.types import Camera, Descriptor, Frame, Pose
from convseq_ros.errors import SourceError
from convseq_ros.evaluation.cache import Cache, content_digest, digest
from convseq_ros.evaluation.simulated import SimulatedDrive
from convseq_ros.onnx_model import OnnxModel, open_model
from convseq_ros.reading_config import ReadingConfig
from convseq_ros.sources import open_source
import numpy as np
import numpy.typing as npt


@dataclass(frozen=True)
class Images:
    """The images of a drive, which can be read again and again."""

    path: Path  # folder, recording or video
    topic: str = ''
    simulated: SimulatedDrive | None = None  # what is drawn instead
    backwards: bool = False  # the last one first, at an even pace
    reading: ReadingConfig = ReadingConfig()  # which images are too large

    @cached_property
    def sha256(self) -> str:
        """Of the list of images (see `content_digest`), or of what they are drawn by."""
        if self.simulated:
            return digest(self.simulated.content)
        try:
            return content_digest(self.path)
        except OSError as error:
            raise SourceError(f'{self.path}: {error.strerror}; check the path') from None

    @property
    def content(self) -> list[Any]:
        """What determines these images, for a cache."""
        return [self.sha256, self.topic, self.backwards, asdict(self.reading)]

    @property
    def in_color(self) -> 'Images':
        """The same, with colours."""
        return replace(self, reading=replace(self.reading, keeps_color=True))

    def __iter__(self) -> Iterator[Frame]:
        source = self.simulated or open_source(self.path, self.topic, self.reading)
        if not self.backwards:
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
    poses: Sequence[Pose | None]  # where the robot's base was, if known
    camera: Camera | None  # what took the first image, as it came, if known

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

    @property
    def flipped(self) -> 'Drive':
        """The same frames, the last one first, at the same distances in time."""
        return replace(
            self,
            stamps_ns=[self.stamps_ns[-1] - stamp_ns for stamp_ns in self.stamps_ns[::-1]],
            names=self.names[::-1],
            readable=self.readable[::-1],
            descriptors=self.descriptors[::-1],
            poses=self.poses[::-1],
        )

    @cached_property
    def reference_map(self) -> ReferenceMap:
        """The drive as a map, of images alone; frames that could not be read hold places."""
        return self._map([None] * len(self), None)

    @cached_property
    def posed_map(self) -> ReferenceMap | None:
        """The same with poses; None if none is known."""
        if not any(self.poses):
            return None
        camera = upright(Frame(0, None, camera=self.camera), self.encoding).camera
        return self._map(self.poses, camera)

    def _map(self, poses: Sequence[Pose | None], camera: Camera | None) -> ReferenceMap:
        made = ReferenceMap(self.encoding, keyframes=EVERY_FRAME)
        columns = self.stamps_ns, self.names, poses, self.descriptors
        for stamp_ns, name, pose, one in zip(*columns, strict=True):
            made.add_frame(Frame(stamp_ns, None, name, pose, camera=camera), one)
        return made


def describe_drive(images: Images, encoding: EncodingConfig, kept_in: Cache) -> Drive:
    """
    Describe every image of a drive, or recall it, by the model of the encoding if it names one.

    SourceError if images cannot be read, ModelError if the model cannot be used.
    """
    if model := open_model(Config(encoding=encoding, reading=images.reading)):
        encoding = replace(encoding, descriptor_model=identity_of(model))
        images = images.in_color if model.wants_color else images
    facts = [images.content, asdict(encoding)]
    kept = kept_in.get('drives', facts)
    if kept is None:
        kept = _described(images, encoding, model)
        kept_in.put('drives', facts, kept)
    columns = [kept[item.name] for item in fields(Descriptor)]
    rows = zip(*columns, strict=True)
    return Drive(
        encoding=encoding,
        stamps_ns=kept['stamps_ns'].tolist(),
        names=kept['names'].tolist(),
        readable=kept['readable'].tolist(),
        descriptors=[_descriptor(row) for row in rows],
        encode_ms=float(kept['encode_ms']),
        poses=[None if np.isnan(one).any() else _pose(one.tolist()) for one in kept['poses']],
        camera=_camera(str(kept['camera'])),
    )


def pose_rows(poses: Sequence[Pose | None]) -> npt.NDArray[np.float64]:
    """Return positions and quaternions, (N, 7); NaN where they are not known."""
    unknown = (np.nan,) * 7
    return np.array([(*one.position, *one.orientation) if one else unknown for one in poses])


def _descriptor(columns: Sequence[Any]) -> Descriptor:
    cells, salient, cell_entropy, entropy, vector = columns
    known = vector if vector.size else None
    return Descriptor(cells, salient, cell_entropy, entropy.item(), known)


def _described(
    images: Images, encoding: EncodingConfig, model: OnnxModel | None
) -> dict[str, npt.NDArray[Any]]:
    first_stage = FirstStage(model, encoding)
    numbers = model.numbers if model else 0
    stamps_ns, names, readable, descriptors, durations = [], [], [], [], []
    poses, camera = [], None
    for raw in images:
        frame, camera = upright(raw, encoding), camera or raw.camera
        started = time.perf_counter()
        if frame.gray is None:
            nothing = np.zeros(numbers, np.float16)
            descriptors.append(replace(blank_descriptor(encoding), vector=nothing))
        else:
            own = first_stage.add(frame, describe(frame.gray, encoding))
            none = np.zeros(0, np.float16)
            descriptors.append(own if model else replace(own, vector=none))
            durations.append((time.perf_counter() - started) * 1e3)
        stamps_ns.append(frame.stamp_ns)
        names.append(frame.source)
        readable.append(frame.gray is not None)
        poses.append(frame.pose)
    if not durations:
        raise SourceError(f'{images.path}: none of its {len(names)} images can be read')
    return {
        'stamps_ns': np.array(stamps_ns, np.int64),
        'names': np.array(names),
        'readable': np.array(readable),
        'encode_ms': np.array(np.median(durations)),
        'poses': pose_rows(poses),
        'camera': np.array(json.dumps(camera and asdict(camera))),
        **{
            item.name: np.array([getattr(one, item.name) for one in descriptors])
            for item in fields(Descriptor)
        },
    }


def _pose(numbers: Sequence[float]) -> Pose:
    x, y, z, qx, qy, qz, qw = numbers
    return Pose((x, y, z), (qx, qy, qz, qw))


def _camera(stored: str) -> Camera | None:
    known = json.loads(stored)
    if known is None:
        return None
    mount = known['mount'] and _pose([*known['mount']['position'], *known['mount']['orientation']])
    return Camera(**{**known, 'distortion': tuple(known['distortion']), 'mount': mount})
