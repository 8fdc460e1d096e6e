# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The sessions of a map: what is known of each drive, and which places are its own."""

from bisect import bisect_right
from dataclasses import asdict, dataclass
import json
import sys

from convseq_ros.core.types import Camera, Indices, Pose
import numpy as np
import numpy.typing as npt

_MOST_CHARACTERS = 100  # of an id, which goes into every answer; a UUID has 36

Row = tuple[object, ...]


@dataclass(frozen=True, slots=True)
class MapSession:
    """A drive that made places of a map."""

    id: str  # a UUID
    name: str  # what people call it; may be empty
    start_ns: int  # stamp of its first place
    camera: Camera | None = None  # if it was known then
    frame: str | None = None  # of the poses, if it is known

    @property
    def row(self) -> Row:
        """Return what is stored of it."""
        camera = json.dumps(_described(self.camera)) if self.camera else None
        return self.id, self.name, self.start_ns, camera, self.frame

    @classmethod
    def of_row(cls, row: Row) -> 'MapSession':
        """Return what was stored; ValueError or TypeError if it is no session."""
        ident, name, start_ns, camera, frame = row
        described = None if frame is None else str(frame)
        return cls(checked_id(ident), str(name), int(str(start_ns)), _camera(camera), described)


def _described(camera: Camera) -> dict[str, object]:
    """Return what is stored of a camera; what is unknown is left out."""
    return {name: value for name, value in asdict(camera).items() if value or value == 0}


def _camera(stored: object) -> Camera | None:
    """Return a camera that was stored; ValueError or TypeError if it is none."""
    if stored is None:
        return None
    fields = {'distortion_model': '', 'distortion': [], 'mount': None, **json.loads(str(stored))}
    model, distortion = (
        str(fields.pop('distortion_model')),
        tuple(map(float, fields.pop('distortion'))),
    )
    mount = None if (given := fields.pop('mount')) is None else Pose(**dict(given))
    if mount:
        x, y, z = map(float, mount.position)
        qx, qy, qz, qw = map(float, mount.orientation)
        mount = Pose((x, y, z), (qx, qy, qz, qw))
    if not all(isinstance(value, int | float) for value in fields.values()):
        raise ValueError('camera: what should be numbers is not')
    return Camera(**fields, distortion_model=model, distortion=distortion, mount=mount)


def checked_id(stored: object) -> str:
    """Return an id that was stored; ValueError if it is none."""
    if not isinstance(stored, str) or len(stored) > _MOST_CHARACTERS:
        raise ValueError('an id that is none')
    return stored


class SessionBounds:
    """
    The bounds of a map's sessions, which lie one after another; at first one that begins at 0.

    Places of different sessions are not near each other, whatever their numbers. One thread may
    begin sessions while others ask.
    """

    def __init__(self, starts: tuple[int, ...] = ()) -> None:
        self._starts, self.starts = [0], np.zeros(1, np.int64)  # (S,), ascending
        for start in starts:
            self.begin(start)

    def begin(self, start: int) -> None:
        """Have a session begin at a place that comes after all sessions so far."""
        if start > self._starts[-1]:
            self._starts.append(start)
            self.starts = np.array(self._starts, np.int64)

    def span(self, index: int) -> tuple[int, int]:
        """Return the first place of a place's session, and the next one's; the last has no end."""
        after = bisect_right(self._starts, index)
        end = self._starts[after] if after < len(self._starts) else sys.maxsize
        return self._starts[after - 1], end

    def spans(self, indices: Indices) -> tuple[Indices, Indices] | tuple[int, int]:
        """Return the same of places (n,)."""
        if len(self._starts) == 1:
            return 0, sys.maxsize
        after = np.searchsorted(self.starts, indices, 'right')
        return self.starts[after - 1], np.append(self.starts, sys.maxsize)[after]

    def around(self, index: int, distance: int) -> range:
        """Return the places of the same session within a distance, and perhaps beyond the map."""
        first, end = self.span(index)
        return range(max(first, index - distance), min(end, index + distance + 1))

    def near(self, indices: Indices, index: int, distance: int) -> npt.NDArray[np.bool_]:
        """Return which of some places (n,) are of the same session, within a distance."""
        there = self.around(index, distance)
        return (indices >= there.start) & (indices < there.stop)

    def nearness(self, indices: Indices, others: Indices, distance: int) -> npt.NDArray[np.bool_]:
        """Return the same of some places (n,) for each of others (m,), as (m, n)."""
        apart = abs(indices - others[:, None])
        first, end = (np.broadcast_to(one, others.shape)[:, None] for one in self.spans(others))
        return (apart <= distance) & (indices >= first) & (indices < end)
