# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
How a map is laid out in its SQLite file, format 6.

`about` holds the map's id and the settings that made it. `sessions` are the drives that made it;
the places of one lie together, in order. `places` and `links` are read when a map is opened, the
others when a place is asked for. The cells are float16, divided by 64. Every row of every table
has a CRC-32 of all its values, so that a flipped bit refuses an answer and never changes one.
"""

from dataclasses import asdict, dataclass
import json
import math
from pathlib import Path
from typing import Any
import zlib

from convseq_ros.config import EncodingConfig, KeyframeConfig
from convseq_ros.core.encoding.descriptor import cell_shape, seen_cells
from convseq_ros.core.encoding.first_stage import model_name
from convseq_ros.core.rigid import vector
from convseq_ros.core.types import Camera, Halves, Pose, RelativePose
from convseq_ros.errors import ConfigError
import numpy as np

FORMAT_VERSION = 6  # PRAGMA user_version
APPLICATION_ID = 0x43565351  # PRAGMA application_id; CVSQ
PAGE_BYTES = 16_384  # of the file: the cells of a place fill one, and 6 rows share another
TABLES = {
    'about': '(name TEXT PRIMARY KEY, value TEXT NOT NULL, crc32 INTEGER NOT NULL) WITHOUT ROWID',
    # Camera: JSON of its intrinsics. Frame: what the poses are in. Both may be unknown.
    'sessions': '(session INTEGER PRIMARY KEY, id TEXT NOT NULL, name TEXT NOT NULL, '
    'start_ns INTEGER NOT NULL, camera TEXT, frame TEXT, crc32 INTEGER NOT NULL)',
    'places': '(reference_index INTEGER PRIMARY KEY, stamp_ns INTEGER NOT NULL, '
    'source TEXT NOT NULL, x REAL, y REAL, z REAL, qx REAL, qy REAL, qz REAL, qw REAL, '
    'session INTEGER NOT NULL, pooled BLOB NOT NULL, crc32 INTEGER NOT NULL)',
    'pictures': '(reference_index INTEGER PRIMARY KEY, cells BLOB NOT NULL, '
    'thumbnail BLOB NOT NULL, crc32 INTEGER NOT NULL)',
    # Of a place, as a JPEG; NULL if it was not kept.
    'images': '(reference_index INTEGER PRIMARY KEY, jpeg BLOB, crc32 INTEGER NOT NULL)',
    # Of places that were looked up in what came before them; of those not found all is NULL.
    # Relative: 33 float64, those of a `RelativePose`; NULL if it was not measured.
    'links': '(place INTEGER PRIMARY KEY, other INTEGER, anchor INTEGER, confidence REAL, '
    'inliers INTEGER, relative BLOB, crc32 INTEGER NOT NULL)',
    # Of places whose regions' depths are known.
    'depths': '(reference_index INTEGER PRIMARY KEY, metres BLOB NOT NULL, '
    'crc32 INTEGER NOT NULL)',
    # Of places with cells, of a map with a descriptor_model: float16, of unit length. Without
    # cells, `pooled` is that.
    'vectors': '(reference_index INTEGER PRIMARY KEY, numbers BLOB NOT NULL, '
    'crc32 INTEGER NOT NULL)',
}
SCHEMA = {name: f'CREATE TABLE {name} {columns}' for name, columns in TABLES.items()}
# Of an encoding: what a map keeps, and what is compared.
_LEFT_OUT = {'descriptor_model': '', 'keeps_cells': True}  # of files where it is so
_ENCODING = ('image_size_px', 'resize', 'image_mask', 'image_rotation_deg', *_LEFT_OUT)
_COMPARED = ('image_size_px', 'image_rotation_deg')
# Of float16, read as a number: what is negative, infinite or no number is no less than this.
_FIRST_NOT_FINITE = 0x7C00

_MAGIC, _ID_BYTES = b'SQLite format 3\0', slice(68, 72)  # https://sqlite.org/fileformat.html
_UPPER = np.triu_indices(6)  # of a covariance
_NUMBERS = 33  # of a relative pose: orientation, position, direction, covariance, and two more
_OFF_UNIT = 1e-6  # that the length of an orientation may be
_MOST_CHARACTERS = 100  # of an id, which goes into every answer; a UUID has 36

Row = tuple[object, ...]


def kept_of(encoding: EncodingConfig) -> dict[str, Any]:
    """Return what a map keeps of its encoding, by name."""
    return {name: getattr(encoding, name) for name in _ENCODING}


def is_map_or_empty(path: Path) -> bool:
    """Return whether a file begins as a map of any format does, or is empty."""
    with path.open('rb') as file:
        head = file.read(_ID_BYTES.stop)
    of_ours = head[_ID_BYTES] == APPLICATION_ID.to_bytes(4, 'big')
    return not head or (head.startswith(_MAGIC) and of_ours)


@dataclass(frozen=True, slots=True)
class Settings:
    """What made a map, and which one it is."""

    map_id: str  # a UUID
    encoding: EncodingConfig
    keyframes: KeyframeConfig

    @property
    def rows(self) -> dict[str, str]:
        """Return what is stored of them, by name."""
        kept = kept_of(self.encoding).items()
        said = {name: value for name, value in kept if _LEFT_OUT.get(name) != value}
        return {
            'map_id': self.map_id,
            'encoding': json.dumps(said),
            'keyframes': json.dumps(self.keyframes.spacing),
        }

    @classmethod
    def of_rows(cls, stored: dict[str, str]) -> 'Settings':
        """Return what was stored; ValueError if it is not what a map says."""
        try:
            made = {**_LEFT_OUT, **json.loads(stored['encoding'])}
            encoding = EncodingConfig(**{name: made[name] for name in _ENCODING})
            model = encoding.descriptor_model
            if (model and not model.startswith('#')) or type(encoding.keeps_cells) is not bool:
                raise ValueError('settings: a descriptor_model that is none')
            seen_cells(encoding.image_mask, cell_shape(encoding.image_size_px)[0])
            keyframes = KeyframeConfig(**json.loads(stored['keyframes']))
            return cls(checked_id(stored['map_id']), encoding, keyframes)
        except (KeyError, TypeError, AttributeError, RecursionError, ConfigError) as error:
            raise ValueError(f'settings: {error}') from error

    def refused(
        self, encoding: EncodingConfig | None, keyframes: KeyframeConfig | None
    ) -> str | None:
        """Return why what is asked for does not fit, naming both values; None if it does."""
        wanted = encoding or self.encoding
        if wanted.image_mask not in ('', self.encoding.image_mask):
            return 'made with another image_mask; leave it out, or build the map again'
        if line := self._other_model(wanted, grows=keyframes is not None):
            return line
        asked = {name: getattr(wanted, name) for name in _COMPARED}
        asked |= (keyframes or self.keyframes).spacing
        own = {name: getattr(self.encoding, name) for name in _COMPARED} | self.keyframes.spacing
        for name, made in own.items():
            if made != asked[name]:
                return (
                    f'made with {name} {made}, asked for {asked[name]}; set {name} to {made} or '
                    'build the map again'
                )
        return None

    def _other_model(self, wanted: EncodingConfig, grows: bool) -> str | None:
        """Return why a map of another model, or one without cells, does not fit, if so."""
        own, asked = self.encoding.descriptor_model, wanted.descriptor_model
        # What does not grow may be read by what is built in, as long as it has cells.
        if own != asked and (asked or grows or not self.encoding.keeps_cells):
            return (
                f'made with {model_name(own)}, asked for {model_name(asked)}; set '
                'descriptor_model to the file that it was made with, or build the map again'
            )
        if grows and self.encoding.keeps_cells != wanted.keeps_cells:
            way = 'with' if self.encoding.keeps_cells else 'without'
            return f'made {way} cells; set matching as it was built, or build the map again'
        return None


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
        known = asdict(self.camera).items() if self.camera else ()
        # What is unknown of a camera is left out.
        camera = json.dumps({name: value for name, value in known if value or value == 0})
        return self.id, self.name, self.start_ns, camera if known else None, self.frame

    @classmethod
    def of_row(cls, row: Row) -> 'MapSession':
        """Return what was stored; ValueError or TypeError if it is no session."""
        ident, name, start_ns, camera, frame = row
        described = None if frame is None else str(frame)
        return cls(checked_id(ident), str(name), int(str(start_ns)), _camera(camera), described)


def _camera(stored: object) -> Camera | None:
    """Return a camera that was stored; ValueError or TypeError if it is none."""
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
        raise ValueError('camera: what should be numbers is not')
    return Camera(**fields, distortion_model=model, distortion=distortion, mount=mount)


def checked_id(stored: object) -> str:
    """Return an id that was stored; ValueError if it is none."""
    if not isinstance(stored, str) or len(stored) > _MOST_CHARACTERS:
        raise ValueError('an id that is none')
    return stored


def row_crc(values: Row) -> int:
    """Return the checksum of a row: that of its numbers and texts, then of its blobs."""
    *plain, last = values
    if type(last) is bytes and type(plain[-1]) is not bytes:  # most rows, told sooner
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
    """Return stored cells, packed; ValueError if they are of another shape, or no strengths."""
    bits = np.frombuffer(stored, '<u2').reshape(cell_shape)
    if bits.max() >= _FIRST_NOT_FINITE:
        raise ValueError('its cells are not finite, or negative')
    return bits.view(np.float16)


def packed_pose(pose: RelativePose) -> bytes:
    """Return what is stored of a relative pose: 33 numbers, NaN for what is not known."""
    unknown = (math.nan,) * 3
    numbers = *pose.orientation, *(pose.position_m or unknown), *(pose.direction or unknown)
    return np.array(
        [*numbers, *pose.covariance[_UPPER], pose.inliers, pose.explains], '<f8'
    ).tobytes()


def unpacked_pose(stored: bytes) -> RelativePose:
    """Return a relative pose that was stored; ValueError or TypeError if it is none."""
    numbers = np.frombuffer(stored, '<f8')
    if len(numbers) != _NUMBERS or not np.isfinite([*numbers[:4], *numbers[10:]]).all():
        raise ValueError('a relative pose that is none')
    x, y, z, w = numbers[:4].tolist()
    if abs(math.hypot(x, y, z, w) - 1) > _OFF_UNIT:
        raise ValueError('a relative pose that is not turned')
    covariance = np.zeros((6, 6))
    covariance[_UPPER] = numbers[10:31]
    covariance.T[_UPPER] = numbers[10:31]
    position, direction = (
        vector(some) if np.isfinite(some).all() else None for some in numbers[4:10].reshape(2, 3)
    )
    inliers, explains = int(numbers[31]), bool(numbers[32])
    return RelativePose((x, y, z, w), position, direction, covariance, inliers, explains)
