# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Files that are small, and declare or hold much: gigabytes, or work without end."""

import binascii
from collections.abc import Callable
import os
from pathlib import Path
import random
import socket
import sqlite3
import struct
import zipfile
import zlib

from mcap.writer import CompressionType
import zstandard

from bench.torture.corpus import cdr, IMAGE, mcap_of, message, pictures, put, ROS2

Maker = Callable[[Path, random.Random], Path]
_ZEROS = bytes(1 << 20)
_MANY = (30_000, 40_000, 65_000)
_HUGE = (2**31 - 1, 2**32 - 1, 2**40, 2**62, 2**63 - 1)


def jpeg(folder: Path, draw: random.Random) -> Path:
    """Declare a side of tens of thousands of pixels, perhaps in very many scans."""
    data = pictures()[draw.choice(('jpeg', 'progressive'))][1]
    frame = next(data.index(mark) for mark in (b'\xff\xc0', b'\xff\xc2') if mark in data)
    sides = struct.pack('>HH', draw.choice(_MANY), draw.choice(_MANY))
    data = data[: frame + 5] + sides + data[frame + 9 :]
    scan = data.index(b'\xff\xda')
    return _picture(folder, 'jpg', data[:scan] + data[scan:-2] * draw.choice((1, 900)) + data[-2:])


def scans(folder: Path, draw: random.Random) -> Path:
    """Declare many scans of an allowed size."""
    data = pictures()['progressive'][1]
    frame = data.index(b'\xff\xc2')
    data = data[: frame + 5] + struct.pack('>HH', 7_900, 7_900) + data[frame + 9 :]
    scan = data.index(b'\xff\xda')
    return _picture(folder, 'jpg', data[:scan] + data[scan:-2] * draw.choice((1, 3, 900)))


def png(folder: Path, draw: random.Random) -> Path:
    """Hold a gigabyte of zeros, or declare more."""
    side = draw.choice((20_000, 30_000, 7_900, 2**31 - 1))
    squeezer = zlib.compressobj(9)
    rows = min(side * side, 64_000_000) >> 20
    packed = b''.join(squeezer.compress(_ZEROS) for _ in range(rows)) + squeezer.flush()
    head = struct.pack('>IIBBBBB', side, side, 8, draw.choice((0, 2)), 0, 0, draw.choice((0, 1)))
    chunks = ((b'IHDR', head), (b'IDAT', packed), (b'IEND', b''))
    body = b''.join(
        struct.pack('>I', len(data)) + kind + data + struct.pack('>I', binascii.crc32(kind + data))
        for kind, data in chunks
    )
    return _picture(folder, 'png', b'\x89PNG\r\n\x1a\n' + body)


def other_picture(folder: Path, draw: random.Random) -> Path:
    """Declare sides of any size where a BMP, a TIFF, a PPM or a WebP says them."""
    kind = draw.choice(('bmp', 'tiff', 'ppm', 'webp'))
    suffix, data = pictures()[kind]
    side = draw.choice((30_000, 7_900, 2**15 - 1, 2**31 - 1))
    if kind == 'bmp':
        data = data[:18] + struct.pack('<ii', side, side) + data[26:]
    elif kind == 'ppm':
        data = b'P%d\n%d %d\n255\n' % (draw.choice((3, 6)), side, side) + data[-100:]
    elif kind == 'webp':
        data = data[:26] + struct.pack('<HH', side & 0x3FFF, 0x3FFF) + data[30:]
    else:
        tags = {256: 16, 257: 16, 258: 64, 259: draw.choice((1, 5, 8)), 277: 4, 278: 2**31 - 1}
        tags |= draw.choice(({256: side, 257: side}, {322: side & ~15, 323: side & ~15}))
        tags |= {273: 8, 279: 64}
        entries = b''.join(struct.pack('<HHII', tag, 4, 1, tags[tag]) for tag in sorted(tags))
        data = b'II*\0' + struct.pack('<IH', 8, len(tags)) + entries + bytes(4)
    return _picture(folder, suffix[1:], data)


def chunk(folder: Path, draw: random.Random) -> Path:
    """Inflate to hundreds of megabytes of zeros, said or not."""
    megabytes = draw.choice((200, 600, 2_000))
    packer = zstandard.ZstdCompressor(
        level=1, write_content_size=draw.random() < 0.5
    ).compressobj()
    data = b''.join(packer.compress(_ZEROS) for _ in range(megabytes)) + packer.flush()
    declared = draw.choice((megabytes << 20, 1 << 20, 1 << 28, 2**62))
    record = struct.pack('<QQQI', 0, 2**62, declared, 0) + struct.pack('<I', 4) + b'zstd'
    record += struct.pack('<Q', len(data)) + data
    many = record_of(6, record) * draw.choice((1, 40))
    return _mcap_around(folder, many, draw)


def overlapping(folder: Path, draw: random.Random) -> Path:
    """List one chunk very many times, or chunks that are all of the same time."""
    path = mcap_of(folder / 'drive.mcap', [cdr()] * 8, CompressionType.ZSTD, 100)
    data = path.read_bytes()
    at = _position(data, 8)
    (length,) = struct.unpack_from('<Q', data, at + 1)
    index = data[at : at + 9 + length]
    path.write_bytes(data[:at] + index * draw.choice((2, 5_000)) + data[at:])
    return path


def large_messages(folder: Path, draw: random.Random) -> Path:
    """Hold images of zeros, each as large as is allowed and a little more."""
    pixels = draw.choice((50_000_000, 70_000_000))
    picture = message()
    head = bytes(ROS2.serialize_cdr(picture, IMAGE))[: -picture.data.size - 4]
    content = head + struct.pack('<I', pixels) + bytes(pixels)
    kind = draw.choice((CompressionType.ZSTD, CompressionType.LZ4))
    return mcap_of(folder / 'drive.mcap', [content] * 3, kind, 1)


def numbers_in_mcap(folder: Path, draw: random.Random) -> Path:
    """Put a huge number where a length, an offset or a count stands."""
    path = mcap_of(folder / 'drive.mcap', [cdr()] * 3, CompressionType.ZSTD)
    data = bytearray(path.read_bytes())
    for _ in range(draw.randint(1, 4)):
        at = draw.randrange(8, len(data) - 8)
        struct.pack_into('<Q', data, at, draw.choice(_HUGE))
    path.write_bytes(data)
    return path


def numbers_in_bag(folder: Path, draw: random.Random) -> Path:
    """Do so in a .bag, or list its chunks thousands of times."""
    path = put('bag', folder)
    data = bytearray(path.read_bytes())
    for _ in range(draw.randint(1, 3)):
        struct.pack_into('<I', data, draw.randrange(13, len(data) - 4), draw.choice(_HUGE[:2]))
    path.write_bytes(data)
    return path


def database(folder: Path, draw: random.Random) -> Path:
    """Have a database compute its rows, for ever or of a gigabyte."""
    path = put('db3', folder)
    endless = 'WITH RECURSIVE n(i) AS (SELECT 1 UNION ALL SELECT i + 1 FROM n)'
    changes = (
        'ALTER TABLE messages RENAME TO kept; CREATE TABLE messages(id INTEGER PRIMARY KEY, '
        'topic_id INTEGER DEFAULT 1, timestamp INTEGER DEFAULT 1, data BLOB GENERATED ALWAYS AS '
        '(zeroblob(900000000))); INSERT INTO messages(id, topic_id, timestamp) SELECT '
        'id, topic_id, timestamp FROM kept; DROP TABLE kept;',
        f'DROP TABLE messages; CREATE VIEW messages AS {endless} SELECT i AS id, 1 AS topic_id, '
        "i AS timestamp, x'00' AS data FROM n;",
        f'DROP TABLE topics; CREATE VIEW topics AS {endless} SELECT i AS id, i AS name, '
        "'sensor_msgs/msg/Image' AS type FROM n;",
        'UPDATE messages SET data = zeroblob(20000000);',
        "UPDATE topics SET name = CAST(zeroblob(1000000) AS TEXT), type = x'ff';",
        "UPDATE messages SET timestamp = 'soon';",
    )
    with sqlite3.connect(path) as connection:
        connection.executescript(draw.choice(changes))
    connection.close()
    return path


def shared_pages(folder: Path, draw: random.Random) -> Path:
    """Have a page of a database's tree name one leaf hundreds of times."""
    path = folder / 'drive.db3'
    with sqlite3.connect(path) as connection:
        connection.executescript(
            'PRAGMA page_size = 512;'
            'CREATE TABLE topics(id INTEGER PRIMARY KEY, name, type, serialization_format);'
            "INSERT INTO topics VALUES(1, '/camera', 'sensor_msgs/msg/Image', 'cdr');"
            'CREATE TABLE messages(id INTEGER PRIMARY KEY, topic_id, timestamp, data);'
        )
        connection.executemany(
            'INSERT INTO messages(topic_id, timestamp, data) VALUES(1, ?, ?)',
            [(number, b'\0' * 60) for number in range(draw.choice((500, 20_000)))],
        )
    connection.close()
    data = bytearray(path.read_bytes())
    for start in range(0, len(data), 512):
        page = data[start : start + 512]
        if page[0] == 5:  # an inner page of a table: all its children become the first
            (cells,) = struct.unpack_from('>H', page, 3)
            pointers = struct.unpack_from(f'>{cells}H', page, 12)
            child = page[pointers[0] : pointers[0] + 4]
            for pointer in pointers:
                data[start + pointer : start + pointer + 4] = child
            data[start + 8 : start + 12] = child
    path.write_bytes(data)
    return path


def zstd_folder(folder: Path, draw: random.Random) -> Path:
    """Hold gigabytes of zeros in a file that is compressed as a whole."""
    path = put('folder files', folder)
    file = next(path.glob('*.zstd'))
    packer = zstandard.ZstdCompressor(level=1).compressobj()
    pieces = [packer.compress(_ZEROS) for _ in range(draw.choice((1_500, 4_000)))]
    file.write_bytes(b''.join(pieces) + packer.flush())
    return path


def metadata(folder: Path, draw: random.Random) -> Path:
    """Say much in metadata.yaml: aliases of aliases, depth, or numbers that are none."""
    path = put(draw.choice(('folder mcap', 'folder messages')), folder)
    text = (path / 'metadata.yaml').read_text()
    laughs = 'a0: &a0 [x, x]\n' + ''.join(
        f'a{number}: &a{number} [*a{number - 1}, *a{number - 1}]\n' for number in range(1, 40)
    )
    changed = draw.choice(
        (
            laughs + text.replace('storage_identifier: ', 'storage_identifier: *a39 #'),
            '[' * draw.choice((1_000, 100_000)),
            text.replace('message_count: 4', 'message_count: 99999999999999999999'),
            text.replace('message_count: 4', 'message_count: [1]'),
            text.replace('nanoseconds', 'nano'),
            text.replace('name: /camera', 'name: [/camera]'),
        )
    )
    (path / 'metadata.yaml').write_text(changed)
    return path


def irregular(folder: Path, draw: random.Random) -> Path:
    """Be no file: a pipe, a socket, a device, a link to itself; or lie in a recording's folder."""
    path = folder / f'drive.{draw.choice(("mcap", "db3", "bag", "mp4", "jpg", "png"))}'
    kind = draw.choice(('pipe', 'socket', 'zero', 'null', 'loop', 'inside', 'empty'))
    if kind == 'inside':
        inner = _made(folder / 'drive')
        os.mkfifo(inner / 'drive.mcap')
        if draw.random() < 0.5:
            os.mkfifo(inner / 'metadata.yaml')
        return inner
    if kind == 'pipe':
        os.mkfifo(path)
    elif kind == 'socket':
        with socket.socket(socket.AF_UNIX) as one:
            one.bind(str(path))
    elif kind == 'empty':
        path.touch()
    else:
        path.symlink_to({'zero': '/dev/zero', 'null': '/dev/null', 'loop': path.name}[kind])
    return path


def sparse(folder: Path, draw: random.Random) -> Path:
    """Be terabytes of nothing."""
    path = folder / f'drive.{draw.choice(("mcap", "db3", "bag", "jpg"))}'
    if path.suffix == '.jpg':
        path = _made(folder / 'pictures') / '1.jpg'
    with path.open('wb') as file:
        file.write(draw.choice((b'\x89MCAP0\r\n', b'SQLite format 3\0', b'#ROSBAG V2.0\n')))
        file.truncate(draw.choice((10**9, 10**12)))
    return path.parent if path.suffix == '.jpg' else path


def record_of(opcode: int, content: bytes) -> bytes:
    """Return a record of an mcap file."""
    return struct.pack('<BQ', opcode, len(content)) + content


def npz(folder: Path, draw: random.Random) -> Path:
    """Return an archive whose only array declares, or holds, gigabytes."""
    path = folder / 'truth.npz'
    side = draw.choice((60_000, 10**6, 10**9))
    head = f"{{'descr': '|b1', 'fortran_order': False, 'shape': ({side}, {side}), }}"
    head = head.ljust(117) + '\n'
    with zipfile.ZipFile(path, 'w', zipfile.ZIP_DEFLATED) as archive:
        with archive.open('right.npy', 'w', force_zip64=True) as member:
            member.write(b'\x93NUMPY\x01\x00' + struct.pack('<H', len(head)) + head.encode())
            for _ in range(draw.choice((0, 700))):
                member.write(_ZEROS)
    return path


def _position(data: bytes, wanted: int) -> int:
    """Return where the first record of a kind stands in an mcap file."""
    at = 8
    while data[at] != wanted:
        at += 9 + struct.unpack_from('<Q', data, at + 1)[0]
    return at


def _mcap_around(folder: Path, records: bytes, draw: random.Random) -> Path:
    """Write a file with these records behind its header, with or without its end."""
    path = mcap_of(folder / 'drive.mcap', [cdr()], CompressionType.NONE)
    data = path.read_bytes()
    at = _position(data, 6)
    path.write_bytes(data[:at] + records + (data[at:] if draw.random() < 0.5 else b''))
    return path


def _picture(folder: Path, suffix: str, data: bytes) -> Path:
    inner = _made(folder / 'pictures')
    (inner / f'1.{suffix}').write_bytes(data)
    return inner


def _made(folder: Path) -> Path:
    folder.mkdir(exist_ok=True)
    return folder


BOMBS: dict[str, Maker] = {
    make.__name__: make
    for make in (
        jpeg,
        scans,
        png,
        other_picture,
        chunk,
        overlapping,
        large_messages,
        numbers_in_mcap,
        numbers_in_bag,
        database,
        shared_pages,
        zstd_folder,
        metadata,
        irregular,
        sparse,
    )
}
