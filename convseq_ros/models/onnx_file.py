# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
The external files in which an ONNX model stores its weights.

Only part of the protobuf is read: the fields that lead to a tensor's `external_data`, by their
numbers in onnx.proto.
"""

from collections.abc import Iterator

MOST_FIELDS = 5_000_000  # that are read; a large network has some 100,000
_VARINT, _FIXED64, _BYTES, _FIXED32 = 0, 1, 2, 5
_WIDTH = {_FIXED64: 8, _FIXED32: 4}
# For each kind of message: the kinds of its fields, by field number.
_CHILDREN = {
    'model': {7: 'graph', 20: 'training', 25: 'function'},
    'training': {1: 'graph', 2: 'graph'},
    'graph': {1: 'node', 5: 'tensor', 15: 'sparse'},
    'node': {5: 'attribute'},
    'function': {7: 'node', 11: 'attribute'},
    'attribute': {5: 'tensor', 6: 'graph', 10: 'tensor', 11: 'graph', 22: 'sparse', 23: 'sparse'},
    'sparse': {1: 'tensor', 2: 'tensor'},
    'tensor': {13: 'entry'},
    'entry': {1: 'key', 2: 'value'},
}


def external_files(data: bytes) -> list[str]:
    """Return the names of a model's external weight files; ValueError if it is damaged."""
    files, waiting, fields_left = dict[str, None](), [('model', 0, len(data))], MOST_FIELDS
    while waiting:
        kind, start, end = waiting.pop()
        texts = dict[str, bytes]()
        for number, first, last in _fields(data, start, end):
            if not (fields_left := fields_left - 1):
                raise ValueError(f'more than {MOST_FIELDS} fields')
            inner = _CHILDREN[kind].get(number)
            if inner in ('key', 'value'):
                texts[inner] = data[first:last]
            elif inner:
                waiting.append((inner, first, last))
        if texts.get('key') == b'location':
            files[texts.get('value', b'').decode()] = None
    return [*files]


def _fields(data: bytes, at: int, end: int) -> Iterator[tuple[int, int, int]]:
    """Yield the number of each field of a message, and where its bytes start and end, if any."""
    while at < end:
        tag, at = _varint(data, at, end)
        number, wire, length = tag >> 3, tag & 7, 0
        if wire == _VARINT:
            _, at = _varint(data, at, end)
        elif wire in _WIDTH:
            at += _WIDTH[wire]
        elif wire == _BYTES:
            length, at = _varint(data, at, end)
            at += length
        if not number or wire not in (_VARINT, _BYTES, *_WIDTH):
            raise ValueError(f'field {number} of type {wire}')
        if at > end:
            raise ValueError('a field that is cut short')
        yield number, at - length, at


def _varint(data: bytes, at: int, end: int) -> tuple[int, int]:
    value = 0
    for shift in range(0, 70, 7):
        if at >= end:
            break
        byte, at = data[at], at + 1
        value |= (byte & 0x7F) << shift
        if byte < 0x80:
            return value, at
    raise ValueError('a number that does not end')
