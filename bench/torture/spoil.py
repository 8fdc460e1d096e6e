# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Damage, as disks, networks and enemies do it."""

import random


def spoil(data: bytes, draw: random.Random) -> bytes:
    """Return data that are cut, flipped, overwritten with large numbers, spliced or repeated."""
    changed = bytearray(data)
    for _ in range(draw.choice((1, 1, 1, 3, 10))):
        if len(changed) < 9:
            break
        at, length = draw.randrange(len(changed)), draw.choice((1, 4, 64, 1024))
        way = draw.choice(('cut', 'flip', 'number', 'drop', 'repeat', 'noise'))
        if way == 'cut':
            del changed[at:]
        elif way == 'flip':
            changed[at] ^= 1 << draw.randrange(8)
        elif way == 'number':
            size = draw.choice((2, 4, 8))
            order = draw.choice(('little', 'big'))
            value = draw.choice((0, 2 ** (8 * size - 1) - 1, 2 ** (8 * size) - 1))
            changed[at : at + size] = value.to_bytes(size, order)
        elif way == 'drop':
            del changed[at : at + length]
        elif way == 'repeat':
            changed[at:at] = changed[at : at + length] * draw.choice((1, 20))
        else:
            changed[at : at + length] = draw.randbytes(length)
    return bytes(changed)
