# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""One drive, ready to be matched: its images on demand, and what was computed of each."""

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import asdict, dataclass, field, fields, replace
from functools import cached_property
import json
from pathlib import Path
import time
from typing import Any

from convseq_ros.config import EncodingConfig, EVERY_FRAME
from convseq_ros.core.encoding.descriptor import blank_descriptor, describe
from convseq_ros.core.encoding.view import upright
from convseq_ros.core.map.reference_map import ReferenceMap
from convseq_ros.core.types import Camera, Descriptor, Frame, Pose
from convseq_ros.errors import SourceError
from convseq_ros.evaluation.cache import Cache, content_digest
from convseq_ros.evaluation.geometry import pose_rows
from convseq_ros.evaluation.simulated import SimulatedDrive
from convseq_ros.reading_config import ReadingConfig
from convseq_ros.sources import open_source
import numpy as np
import numpy.typing as npt

Changed = Callable[[Frame, int], Frame]


@dataclass(frozen=True)
class Images:
    """
    The images of a drive, which can be read again and again.

    Parameters
    ----------
    path, topic : Path, str
        Folder, recording or video, and image topic.
    simulated : SimulatedDrive, optional
        What is drawn instead.
    order : tuple of int, optional
        Which frames, in which order; all of them if left out.
    restamp : bool
        Whether frames out of the common order take the stamps of an even pace.
    reading : ReadingConfig
        Which images are too large.
    change : callable, optional
        Alters a frame, given its index.
    changed_by : object
        What JSON can say of `change`; part of `content`.

    """

    path: Path
    topic: str = ''
    simulated: SimulatedDrive | None = None
    order: tuple[int, ...] | None = None
    restamp: bool = True
    reading: ReadingConfig = ReadingConfig()
    change: Changed | None = field(default=None, compare=False)
    changed_by: Any = None

    @cached_property
    def content(self) -> list[Any]:
        """What determines these images, for a cache."""
        order = list(self.order) if self.order is not None else None
        try:
            images = self.simulated.content if self.simulated else content_digest(self.path)
        except OSError as error:
            raise SourceError(f'{self.path}: {error.strerror}; check the path') from None
        return [images, self.topic, order, self.restamp, asdict(self.reading), self.changed_by]

    def __iter__(self) -> Iterator[Frame]:
        source = self.simulated or open_source(self.path, self.topic, self.reading)
        frames: Iterable[Frame] = source
        if self.order is not None:
            whole = list(source)
            stamps_ns = self.stamps_ns([frame.stamp_ns for frame in whole])
            frames = (
                replace(whole[index], stamp_ns=stamp_ns)
                for index, stamp_ns in zip(self.order, stamps_ns, strict=True)
            )
        for index, frame in enumerate(frames):
            yield self.change(frame, index) if self.change else frame

    def stamps_ns(self, whole: Sequence[int]) -> list[int]:
        """Return the stamps of the frames in their order, given those of all frames."""
        if self.order is None or not self.restamp:
            return [whole[index] for index in self.order or range(len(whole))]
        step_ns = whole[1] - whole[0] if len(whole) > 1 else 0
        return [whole[0] + place * step_ns for place in range(len(self.order))]

    def reversed(self, count: int) -> 'Images':
        """Return the same images, so many of them, the last one first."""
        return replace(self, order=tuple(range(count - 1, -1, -1)))

    @property
    def whole(self) -> 'Images':
        """The same images, all of them in the common order."""
        return replace(self, order=None)


@dataclass(frozen=True)
class Drive:
    """
    What was computed of the images of a drive; entry i belongs to frame i.

    Parameters
    ----------
    images : Images
        Where it came from.
    stamps_ns, names, readable : sequences
        Stamp, file name or topic, and whether the image could be decoded.
    descriptors : sequence of Descriptor
        One that shows nothing where the image could not be decoded.
    encode_ms : float
        Median time to describe an image.
    poses : sequence of Pose or None
        Where the robot's base was, if that is known.
    camera : Camera or None
        What took the first image, as it came, if that is known.
    others : tuple of int
        Frames at which other drives begin.

    """

    images: Images
    encoding: EncodingConfig
    stamps_ns: Sequence[int]
    names: Sequence[str]
    readable: Sequence[bool]
    descriptors: Sequence[Descriptor]
    encode_ms: float
    poses: Sequence[Pose | None]
    camera: Camera | None
    others: tuple[int, ...] = ()

    def __len__(self) -> int:
        return len(self.stamps_ns)

    @cached_property
    def informative(self) -> npt.NDArray[np.bool_]:
        """Which frames show anything, shape (N,)."""
        return np.array([one.informative for one in self.descriptors], np.bool_)

    def followed_by(self, other: 'Drive') -> 'Drive':
        """Return these frames and those of another drive, a second after them: two sessions."""
        later = self.stamps_ns[-1] - other.stamps_ns[0] + 1_000_000_000
        return replace(
            self,
            stamps_ns=[*self.stamps_ns, *(one + later for one in other.stamps_ns)],
            names=[*self.names, *other.names],
            readable=[*self.readable, *other.readable],
            descriptors=[*self.descriptors, *other.descriptors],
            poses=[*self.poses, *(None for _ in other.poses)],  # of another frame
            others=(*self.others, len(self)),
        )

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
        for index, (stamp_ns, name, pose, one) in enumerate(zip(*columns, strict=True)):
            if index in self.others:
                made.begin_session(stamp_ns)
            made.add_frame(Frame(stamp_ns, None, name, pose, camera=camera), one)
        return made


def describe_drive(images: Images, encoding: EncodingConfig, cache: Cache) -> Drive:
    """
    Describe every image of a drive, or recall what an earlier run found.

    Raises
    ------
    SourceError
        If the images cannot be read.

    """
    if images.order is not None and images.change is None:
        return _paced(describe_drive(images.whole, encoding, cache), images, images.order)
    facts = [images.content, asdict(encoding)]
    kept = cache.get('drives', facts)
    if kept is None:
        kept = _described(images, encoding)
        cache.put('drives', facts, kept)
    columns = [kept[item.name] for item in fields(Descriptor)]
    descriptors = [Descriptor(*map(_value, row)) for row in zip(*columns, strict=True)]
    return Drive(
        images,
        encoding,
        kept['stamps_ns'].tolist(),
        kept['names'].tolist(),
        kept['readable'].tolist(),
        descriptors,
        float(kept['encode_ms']),
        [None if np.isnan(one).any() else _pose(one.tolist()) for one in kept['poses']],
        _camera(str(kept['camera'])),
    )


def _paced(whole: Drive, images: Images, order: Sequence[int]) -> Drive:
    return replace(
        whole,
        images=images,
        stamps_ns=images.stamps_ns(whole.stamps_ns),
        names=[whole.names[index] for index in order],
        readable=[whole.readable[index] for index in order],
        descriptors=[whole.descriptors[index] for index in order],
        poses=[whole.poses[index] for index in order],
    )


def _described(images: Images, encoding: EncodingConfig) -> dict[str, npt.NDArray[Any]]:
    stamps_ns, names, readable, descriptors, durations = [], [], [], [], []
    poses, camera = [], None
    for raw in images:
        frame, camera = upright(raw, encoding), camera or raw.camera
        started = time.perf_counter()
        if frame.gray is None:
            descriptors.append(blank_descriptor(encoding))
        else:
            descriptors.append(describe(frame.gray, encoding))
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


def _value(stored: Any) -> Any:
    return stored if np.ndim(stored) else stored.item()


def _pose(numbers: Sequence[float]) -> Pose:
    x, y, z, *orientation = numbers
    qx, qy, qz, qw = orientation
    return Pose((x, y, z), (qx, qy, qz, qw))


def _camera(stored: str) -> Camera | None:
    said = json.loads(stored)
    if said is None:
        return None
    mount = said['mount'] and _pose([*said['mount']['position'], *said['mount']['orientation']])
    return Camera(**{**said, 'distortion': tuple(said['distortion']), 'mount': mount})
