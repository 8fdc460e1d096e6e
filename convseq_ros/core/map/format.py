# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
The layout of a map's SQLite file, format 8.

`about` holds the map's id and the settings it was made with. `sessions` are its drives; the places
of a session follow each other in order. `places` and `links` are read when a map is opened, the
other tables when a place is needed. Cells are float16, divided by 64. Every row has a CRC-32 of
all its values, so that a flipped bit is an error and never changes an answer.
"""

from dataclasses import asdict, dataclass
import json
import math
import operator
from pathlib import Path
from typing import Any
import zlib

from convseq_ros.config import EncodingConfig, KeyframeConfig
from convseq_ros.core.encoding.descriptor import cell_shape, visible_cells
from convseq_ros.core.encoding.first_stage import model_name
from convseq_ros.core.graph.packed_pose import NUMBERS, packed_pose, unpacked_pose
from convseq_ros.core.graph.trail import Keyframe
from convseq_ros.core.types import Anchor, Camera, Halves, Pose, RelativePose
from convseq_ros.errors import ConfigError
import numpy as np

FORMAT_VERSION = 8  # PRAGMA user_version
APPLICATION_ID = 0x43565351  # PRAGMA application_id; CVSQ
PAGE_BYTES = 16_384  # the cells of a place fill a page; what else 6 rows hold shares another
TABLES = {
    'about': '(name TEXT PRIMARY KEY, value TEXT NOT NULL, crc32 INTEGER NOT NULL) WITHOUT ROWID',
    # Camera: JSON of its intrinsics. Frame: the reference frame of the poses. Both may be NULL.
    'sessions': '(session INTEGER PRIMARY KEY, id TEXT NOT NULL, name TEXT NOT NULL, '
    'start_ns INTEGER NOT NULL, camera TEXT, frame TEXT, crc32 INTEGER NOT NULL)',
    'places': '(reference_index INTEGER PRIMARY KEY, stamp_ns INTEGER NOT NULL, '
    'source TEXT NOT NULL, x REAL, y REAL, z REAL, qx REAL, qy REAL, qz REAL, qw REAL, '
    'session INTEGER NOT NULL, pooled BLOB NOT NULL, crc32 INTEGER NOT NULL)',
    'pictures': '(reference_index INTEGER PRIMARY KEY, cells BLOB NOT NULL, '
    'thumbnail BLOB NOT NULL, keypoints BLOB NOT NULL, crc32 INTEGER NOT NULL)',
    # The image of a place as a JPEG; NULL if it was not kept.
    'images': '(reference_index INTEGER PRIMARY KEY, jpeg BLOB, crc32 INTEGER NOT NULL)',
    # Places that were looked up among earlier ones; without a result, all other columns are NULL,
    # but confidence is 0 if a person took the link out.
    # Relative: the 33 float64 of a `RelativePose`; NULL if it was not measured.
    'links': '(place INTEGER PRIMARY KEY, other INTEGER, anchor INTEGER, confidence REAL, '
    'inliers INTEGER, relative BLOB, crc32 INTEGER NOT NULL)',
    # Of drives with odometry, whether they became places or not: variances NULL if they are not
    # finite; the other place of a closure by session and stamp, or NULL if none was published;
    # relative as in `links`.
    'keyframes': '(number INTEGER PRIMARY KEY, session TEXT NOT NULL, stamp_ns INTEGER NOT NULL, '
    'x REAL NOT NULL, y REAL NOT NULL, z REAL NOT NULL, qx REAL NOT NULL, qy REAL NOT NULL, '
    'qz REAL NOT NULL, qw REAL NOT NULL, metres2 REAL, radians2 REAL, other_session TEXT, '
    'other_ns INTEGER, relative BLOB, crc32 INTEGER NOT NULL)',
    # The descriptor model's vector, float16 of unit length; no row without a model.
    'vectors': '(reference_index INTEGER PRIMARY KEY, numbers BLOB NOT NULL, '
    'crc32 INTEGER NOT NULL)',
}
SCHEMA = {name: f'CREATE TABLE {name} {columns}' for name, columns in TABLES.items()}
# Settings of an encoding that a map stores, and those that must be the same for its queries.
_LEFT_OUT = {'descriptor_model': ''}  # a default, which is not stored
_ENCODING = ('image_size_px', 'resize', 'image_mask', 'image_rotation_deg', *_LEFT_OUT)
_COMPARED = ('image_size_px', 'resize', 'image_rotation_deg')
# The bits of a float16 as an integer: from here on it is infinite, not a number or negative.
_FIRST_NOT_FINITE = 0x7C00

_MAGIC, _ID_BYTES = b'SQLite format 3\0', slice(68, 72)  # https://sqlite.org/fileformat.html
_TOLERANCE = 1e-6  # by which the length of an orientation may differ from 1
_MAX_CHARACTERS = 100  # of an id, which is part of every answer; a UUID has 36

Row = tuple[object, ...]


def stored_settings(encoding: EncodingConfig) -> dict[str, Any]:
    """Return the settings of an encoding that a map stores, by name."""
    return {name: getattr(encoding, name) for name in _ENCODING}


def is_map_or_empty(path: Path) -> bool:
    """Return whether a file is empty or begins like a map of any format."""
    with path.open('rb') as file:
        head = file.read(_ID_BYTES.stop)
    has_our_id = head[_ID_BYTES] == APPLICATION_ID.to_bytes(4, 'big')
    return not head or (head.startswith(_MAGIC) and has_our_id)


@dataclass(frozen=True, slots=True)
class Settings:
    """The id of a map and the settings it was made with."""

    map_id: str  # a UUID
    encoding: EncodingConfig
    keyframes: KeyframeConfig
    position_sigma_m: float = 0.0  # standard deviation of its positions; 0 if not told

    @property
    def rows(self) -> dict[str, str]:
        """The rows of the table `about`: values by name."""
        settings = stored_settings(self.encoding).items()
        encoding = {name: value for name, value in settings if _LEFT_OUT.get(name) != value}
        told = {'position_sigma_m': repr(self.position_sigma_m)} if self.position_sigma_m else {}
        return {
            'map_id': self.map_id,
            'encoding': json.dumps(encoding),
            'keyframes': json.dumps(self.keyframes.spacing),
            **told,
        }

    @classmethod
    def from_rows(cls, stored: dict[str, str]) -> 'Settings':
        """Return the settings of stored rows; ValueError if they are invalid."""
        try:
            values = {**_LEFT_OUT, **json.loads(stored['encoding'])}
            encoding = EncodingConfig(**{name: values[name] for name in _ENCODING})
            model = encoding.descriptor_model
            if model and not model.startswith('#'):
                raise ValueError('settings: invalid descriptor_model')
            visible_cells(encoding.image_mask, cell_shape(encoding.image_size_px)[0])
            keyframes = KeyframeConfig(**json.loads(stored['keyframes']))
            sigma_m = float(stored.get('position_sigma_m', 0.0))
            if not 0 <= sigma_m < math.inf:
                raise ValueError('settings: invalid position_sigma_m')
            return cls(checked_id(stored['map_id']), encoding, keyframes, sigma_m)
        except (KeyError, TypeError, AttributeError, RecursionError, ConfigError) as error:
            raise ValueError(f'settings: {error}') from error

    def mismatch(self, wanted: EncodingConfig, keyframes: KeyframeConfig | None) -> str | None:
        """Return why other settings do not fit this map, with both values; None if they do."""
        if wanted.image_mask not in ('', self.encoding.image_mask):
            return 'made with another image_mask; leave it out, or build the map again'
        if line := self._other_model(wanted, grows=keyframes is not None):
            return line
        requested = {name: getattr(wanted, name) for name in _COMPARED}
        requested |= (keyframes or self.keyframes).spacing
        of_map = {name: getattr(self.encoding, name) for name in _COMPARED}
        for name, value in (of_map | self.keyframes.spacing).items():
            if value != requested[name]:
                return (
                    f'made with {name} {value}, asked for {requested[name]}; set {name} to '
                    f'{value} or build the map again'
                )
        return None

    def _other_model(self, wanted: EncodingConfig, grows: bool) -> str | None:
        """Return why the descriptor model does not fit; None if it does."""
        made, requested = self.encoding.descriptor_model, wanted.descriptor_model
        # A map can be read without its model, by the built-in descriptor.
        if made != requested and (requested or grows):
            return (
                f'made with {model_name(made)}, asked for {model_name(requested)}; set '
                'descriptor_model to the file that it was made with, or build the map again'
            )
        return None


@dataclass(frozen=True, slots=True)
class MapSession:
    """A drive that added places to a map."""

    id: str  # a UUID
    name: str  # for people; may be empty
    start_ns: int  # stamp of its first place
    camera: Camera | None = None
    frame: str | None = None  # reference frame of the poses

    @property
    def row(self) -> Row:
        """The row of the table `sessions`, without its number."""
        fields = asdict(self.camera).items() if self.camera else ()
        # Unknown fields of a camera are left out.
        known = {name: value for name, value in fields if value or value == 0}
        if 'mount' in known:
            del known['mount']['variances']
        camera = json.dumps(known)
        return self.id, self.name, self.start_ns, camera if fields else None, self.frame

    @classmethod
    def from_row(cls, row: Row) -> 'MapSession':
        """Return the session of a stored row; ValueError or TypeError if it is invalid."""
        session_id, name, start_ns, camera, frame = row
        frame = None if frame is None else str(frame)
        return cls(checked_id(session_id), str(name), int(str(start_ns)), _camera(camera), frame)


def _camera(stored: object) -> Camera | None:
    """Return a stored camera; ValueError or TypeError if it is invalid."""
    if stored is None:
        return None
    fields = {'distortion_model': '', 'distortion': [], 'mount': None, **json.loads(str(stored))}
    model = str(fields.pop('distortion_model'))
    distortion = tuple(map(float, fields.pop('distortion')))
    mount = None if (given := fields.pop('mount')) is None else Pose(**dict(given))
    if mount:
        x, y, z = map(float, mount.position)
        qx, qy, qz, qw = map(float, mount.orientation)
        mount = Pose((x, y, z), (qx, qy, qz, qw))
    if not all(isinstance(value, int | float) for value in fields.values()):
        raise ValueError('camera: a field is not a number')
    return Camera(**fields, distortion_model=model, distortion=distortion, mount=mount)


def checked_id(stored: object) -> str:
    """Return a stored id; ValueError if it is not text, or too long."""
    if not isinstance(stored, str) or len(stored) > _MAX_CHARACTERS:
        raise ValueError('invalid id')
    return stored


def row_crc(values: Row) -> int:
    """Return the CRC-32 of a row: of its numbers and texts first, then of its blobs."""
    *plain, last = values
    if type(last) is bytes and type(plain[-1]) is not bytes:  # a fast path for most rows
        return zlib.crc32(last, zlib.crc32(repr([*plain, len(last)]).encode()))
    count = len(values)
    while count and type(values[count - 1]) is bytes:  # blobs come last
        count -= 1
    blobs: Any = values[count:]
    crc = zlib.crc32(repr([*values[:count], *map(len, blobs)]).encode())
    for blob in blobs:
        crc = zlib.crc32(blob, crc)
    return crc


def decode_cells(stored: bytes, cell_shape: tuple[int, int, int]) -> Halves:
    """Return stored cells, packed; ValueError if the shape is wrong or a value is invalid."""
    bits = np.frombuffer(stored, '<u2').reshape(cell_shape)
    if bits.max() >= _FIRST_NOT_FINITE:
        raise ValueError('its cells are not finite, or negative')
    return bits.view(np.float16)


def keyframe_row(one: Keyframe) -> Row:
    """Return the row of the table `keyframes`, without its number."""
    # SQLite stores no -0.0; a checksum is of Python's numbers, not of NumPy's.
    told = [
        float(value) + 0.0 if math.isfinite(value) else None for value in one.pose.variances or ()
    ]
    other = (one.other.session_id, one.other.stamp_ns) if one.other else (None, None)
    relative = one.relative and packed_pose(one.relative)
    pose = (float(value) + 0.0 for value in (*one.pose.position, *one.pose.orientation))
    return one.session_id, one.stamp_ns, *pose, *(told or (None, None)), *other, relative


def keyframe_of(row: tuple[Any, ...]) -> Keyframe:
    """Return the keyframe of a stored row; ValueError or TypeError if it is invalid."""
    session, stamp_ns, x, y, z, qx, qy, qz, qw, metres2, radians2, other, other_ns, relative = row
    numbers = np.array([x, y, z, qx, qy, qz, qw], float)
    if not np.isfinite(numbers).all() or abs(np.linalg.norm(numbers[3:]) - 1) > _TOLERANCE:
        raise ValueError('invalid pose of a keyframe')
    metres2, radians2 = (math.nan if told is None else told for told in (metres2, radians2))
    x, y, z, qx, qy, qz, qw = numbers.tolist()
    return Keyframe(
        checked_id(session),
        operator.index(stamp_ns),
        Pose((x, y, z), (qx, qy, qz, qw), (float(metres2), float(radians2))),
        None if other is None else Anchor(checked_id(other), operator.index(other_ns)),
        None if relative is None else checked_pose(relative),
    )


def checked_pose(stored: bytes) -> RelativePose:
    """Return a stored relative pose; ValueError or TypeError if it is invalid."""
    numbers = np.frombuffer(stored, '<f8')
    if len(numbers) != NUMBERS or not np.isfinite([*numbers[:4], *numbers[10:]]).all():
        raise ValueError('invalid relative pose')
    if abs(math.hypot(*numbers[:4]) - 1) > _TOLERANCE:
        raise ValueError('invalid orientation of a relative pose')
    return unpacked_pose(stored)
