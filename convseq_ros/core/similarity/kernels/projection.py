# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The projected regions of coherent matching, compiled."""

from functools import cache
from math import isqrt

from convseq_ros.core.compiled import compiled
from convseq_ros.core.similarity.coherent import projection, Regions
from convseq_ros.core.similarity.global_similarity import BLOCK, rounded, Whole
from convseq_ros.core.similarity.kernels.panel import address, empty_panel, Panel, reference_words
from convseq_ros.core.similarity.kernels.tile import (
    BYTE_WORDS,
    BYTES,
    FLOAT_WORDS,
    FLOATS,
    keep_region_dots,
    place_region,
    REGION_ROWS,
    SPAN,
)
import numpy as np
import numpy.typing as npt

_ROWS, _COLUMNS = REGION_ROWS, FLOATS.columns

Cells = npt.NDArray[np.float32]


def projected(cells: Cells) -> Regions:
    """Return what `projected_regions` does, to 1e-6; shape ((S - 2) ** 2, 32)."""
    side = len(cells) - SPAN + 1
    regions = np.empty((side * side, FLOAT_WORDS), np.float32)
    axes, origin = _axes()
    _project(np.ascontiguousarray(cells), axes.address, origin, regions)
    return regions


def shown(cells: Cells, usual: Regions | None) -> tuple[Regions, Whole | None]:
    """Return what the definition's `shown` does, to 1e-6."""
    regions = projected(cells)
    if usual is None:
        return regions, None
    blocks = -(-isqrt(len(regions)) // BLOCK)
    sums = np.zeros((blocks, blocks, FLOAT_WORDS), np.float32)
    _subtract(regions, np.ascontiguousarray(usual, np.float32), sums)
    return regions, rounded(sums)


def packed_bytes(regions: Regions, scale: float, most: int, offset: int) -> Panel:
    """Return regions as a reference's words: `quantised`, four to a word."""
    blocks = -(-len(regions) // BYTES.columns)
    panel = empty_panel((blocks, BYTE_WORDS, BYTES.columns), np.int32)
    _pack(regions, np.float32(scale), np.float32(most), np.float32(offset), panel.array)
    return panel


@cache
def _axes() -> tuple[Panel, npt.NDArray[np.float32]]:
    """Return the axes, in blocks, and where they map the mean."""
    mean, axes = projection()
    return reference_words(np.ascontiguousarray(axes.T), FLOATS), mean @ axes


@compiled
def _project(cells, axes, origin, regions):  # type: ignore[no-untyped-def]
    """Fill in the regions, in tiles of neighbours in a row."""
    size, _, numbers = cells.shape
    side = size - SPAN + 1
    # Wide enough for a tile, and with what the last one reads beyond the image.
    room = np.zeros((size, max(size, _ROWS + SPAN - 1), numbers), np.float32)
    room[:, :size] = cells
    squares = np.empty((size, size), np.float32)
    for row in range(size):
        for column in range(size):
            square = np.float32(0)
            for number in room[row, column]:
                square += number * number
            squares[row, column] = square
    width = 4 * numbers * room.shape[1]
    tile = np.empty((_ROWS, FLOAT_WORDS), np.float32)
    factor = np.empty(1, np.float32)
    for row in range(side):
        done = 0
        while done < side:
            first = max(0, min(done, side - _ROWS))
            for block in range(FLOAT_WORDS // _COLUMNS):
                keep_region_dots(
                    address(room) + row * width + 4 * first * numbers,
                    width,
                    axes + 4 * block * _COLUMNS * SPAN * SPAN * numbers,
                    address(tile) + 4 * block * _COLUMNS,
                )
            for column in range(done, min(first + _ROWS, side)):
                total = np.float32(0)
                for down in range(SPAN):
                    for right in range(SPAN):
                        total += squares[row + down, column + right]
                factor[0] = 1 / np.sqrt(total) if total > 0 else 1
                place_region(
                    address(tile) + 4 * (column - first) * FLOAT_WORDS,
                    address(factor),
                    address(origin),
                    address(regions) + 4 * (row * side + column) * FLOAT_WORDS,
                )
            done = first + _ROWS


@compiled
def _subtract(regions, usual, sums):  # type: ignore[no-untyped-def]
    """Make regions unusual ones, of unit length, and add them up in blocks."""
    side = int(np.sqrt(len(regions)))
    one = np.ones(1, np.float32)
    for place in range(len(regions)):
        offset = 4 * place * FLOAT_WORDS
        own = address(regions) + offset
        place_region(own, address(one), address(usual) + offset, own)
        block = sums[place // side // BLOCK, place % side // BLOCK]
        for axis in range(len(block)):
            block[axis] += regions[place, axis]


@compiled
def _pack(regions, scale, most, offset, words):  # type: ignore[no-untyped-def]
    """Write regions as bytes, a region to a column; the last is repeated."""
    columns = words.shape[2]
    own = np.empty(4 * words.shape[1], np.uint8)
    whole = own.view(np.int32)
    for place in range(words.shape[0] * columns):
        if place < len(regions):
            for axis in range(len(own)):
                number = np.rint(regions[place, axis] * scale)
                own[axis] = np.uint8(min(max(number, -most), most) + offset)
        for word in range(len(whole)):
            words[place // columns, word, place % columns] = whole[word]
