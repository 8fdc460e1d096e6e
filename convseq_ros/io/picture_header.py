# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The size that an encoded picture declares, read before anything is decoded."""

from collections.abc import Callable
import re
import struct
from typing import NamedTuple

from convseq_ros.config.reading_config import ReadingConfig

_JPEG_FRAMES = frozenset(range(0xC0, 0xD0)) - {0xC4, 0xC8, 0xCC}  # ITU T.81, table B.1: SOFn
_JPEG_ALONE = frozenset({0x01, *range(0xD0, 0xD9)})  # ibid.: markers without a length
_USUAL_SCANS = 16  # that together count as one; libjpeg writes at most 10 (jcparam.c, 9e)
_JPEG_SCAN = b'\xff\xda'
_CHUNK_HEAD_BYTES = 8  # of a PNG: length, kind
_CHUNK_BYTES = _CHUNK_HEAD_BYTES + 4  # without its content: also the checksum
_MOST_CHUNKS = 100_000  # encoders write chunks of 8 kB or more, except for some of text
# TIFF 6.0, section 8; types of a tag's value that are numbers: SHORT and LONG.
_TIFF_WIDTH, _TIFF_HEIGHT, _TIFF_BITS, _TIFF_SAMPLES = 256, 257, 258, 277
_TIFF_TILE_WIDTH, _TIFF_TILE_HEIGHT = 322, 323
_TIFF_TYPES = {3: 'H', 4: 'I'}
_COLOUR_BITS = 24
_NETPBM_SIZE = re.compile(rb'\s+(\d{1,10})\s+(\d{1,10})\s')  # numbers of 32 bits


class DeclaredSize(NamedTuple):
    """Size of a picture, as its header declares it."""

    pixels: int  # that a decoder allocates, at 3 bytes each
    passes: int = 1  # of the decoder over all pixels: the scans of a JPEG


def refuse_large(size: DeclaredSize, reading: ReadingConfig, what: str) -> None:
    """Raise an ImageError if a picture is too large to be decoded, or has too many scans."""
    mpx, scanned = size.pixels / 1e6, size.pixels * size.passes // _USUAL_SCANS
    reading.refuse_image(size.pixels, f'{what}: a picture of {mpx:.3g} Mpx')
    reading.refuse_image(scanned, f'{what}: {size.passes} scans of {mpx:.3g} Mpx')


def declared_size(data: bytes) -> DeclaredSize | None:
    """Return the declared size; None if the picture's kind is unknown or its header is damaged."""
    for magic, read in _READERS:
        if re.match(magic, data, re.DOTALL):
            try:
                return read(data)
            except (struct.error, LookupError, OverflowError, ValueError):
                return None
    return None


def _jpeg(data: bytes) -> DeclaredSize:
    at = 2
    while True:
        # Like libjpeg, skip bytes that are not a marker.
        at = data.index(b'\xff', at)
        while data[at] == 0xFF:
            at += 1
        marker = data[at]
        at += 1
        if marker in _JPEG_FRAMES:
            height, width = struct.unpack_from('>HH', data, at + 3)
            return DeclaredSize(width * height, max(1, data.count(_JPEG_SCAN, at)))
        if marker and marker not in _JPEG_ALONE:
            at += struct.unpack_from('>H', data, at)[0]


def _png(data: bytes) -> DeclaredSize:
    at = 8
    for _ in range(_MOST_CHUNKS):
        if at + _CHUNK_HEAD_BYTES > len(data):
            break
        length, kind = struct.unpack_from('>I4s', data, at)
        at += _CHUNK_BYTES + length
        if at > len(data):
            # OpenCV allocates this length before it checks the file, even for an IEND chunk.
            raise ValueError('a chunk is longer than the file')
        if kind == b'IEND':
            break
    else:
        raise ValueError('more chunks than any picture has')
    width, height = struct.unpack_from('>II', data, 16)
    return DeclaredSize(width * height)


def _bmp(data: bytes) -> DeclaredSize:
    (head,) = struct.unpack_from('<I', data, 14)
    width, height = struct.unpack_from('<HH' if head == 12 else '<ii', data, 18)
    return DeclaredSize(abs(width * height))


def _netpbm(data: bytes) -> DeclaredSize:
    size = _NETPBM_SIZE.match(re.sub(rb'#[^\n]*', b'', data[2:1024]))
    if not size:
        raise ValueError('its size is not two numbers')
    return DeclaredSize(int(size[1]) * int(size[2]))


def _webp(data: bytes) -> DeclaredSize:
    kind, at = data[12:16], 20
    if kind == b'VP8X':
        width = int.from_bytes(data[at + 4 : at + 7], 'little') + 1
        height = int.from_bytes(data[at + 7 : at + 10], 'little') + 1
    elif kind == b'VP8L':
        (bits,) = struct.unpack_from('<I', data, at + 1)
        width, height = (bits & 0x3FFF) + 1, (bits >> 14 & 0x3FFF) + 1
    else:
        width, height = (side & 0x3FFF for side in struct.unpack_from('<HH', data, at + 6))
    return DeclaredSize(width * height)


def _tiff(data: bytes) -> DeclaredSize:
    order = '<' if data[:2] == b'II' else '>'
    (at,) = struct.unpack_from(order + 'I', data, 4)
    (entries,) = struct.unpack_from(order + 'H', data, at)
    tags: dict[int, int] = {}
    for start in range(at + 2, at + 2 + min(entries, 4096) * 12, 12):
        tag, kind, values, where = struct.unpack_from(order + 'HHII', data, start)
        if kind in _TIFF_TYPES:
            is_inside = struct.calcsize(order + _TIFF_TYPES[kind]) * values <= 4
            value_at = start + 8 if is_inside else where
            (tags[tag],) = struct.unpack_from(order + _TIFF_TYPES[kind], data, value_at)
    bits = tags.get(_TIFF_BITS, 1) * tags.get(_TIFF_SAMPLES, 1)
    tile = tags.get(_TIFF_TILE_WIDTH, 0) * tags.get(_TIFF_TILE_HEIGHT, 0)
    pixels = max(tags[_TIFF_WIDTH] * tags[_TIFF_HEIGHT], tile)
    return DeclaredSize(max(pixels, pixels * bits // _COLOUR_BITS))


_READERS: tuple[tuple[bytes, Callable[[bytes], DeclaredSize]], ...] = (
    (rb'\xff\xd8', _jpeg),
    (rb'\x89PNG\r\n\x1a\n.{4}IHDR', _png),
    (rb'BM', _bmp),
    (rb'P[1-6]\s', _netpbm),
    (rb'RIFF.{4}WEBP', _webp),
    (rb'II\*\0|MM\0\*', _tiff),
)
