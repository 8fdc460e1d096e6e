# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Tiles of dot products, and what is kept of them, for compiled functions to call by addresses.

A tile compares some rows of a query with two vectors of regions of a reference. Both are arrays of
32-bit words, each of four bytes or of one float32 number: a query [rows][words], a reference
[blocks][words][2 * lanes]. Whatever is kept of rows is [rows][lanes], of columns [2 * lanes].
"""

from typing import Any

from convseq_ros.core.compiled import emitted
from convseq_ros.core.encoding.regions import REGION
from convseq_ros.core.similarity.kernels.instructions import float_tile, int8_tile, Tile
from convseq_ros.core.similarity.kernels.vectors import Vectors

# Where there are no such instructions, nothing is compiled with the shape in their place.
FLOATS = float_tile() or Tile('none', 4, 6)
BYTES = int8_tile() or FLOATS
BYTE_WORDS, CELL_WORDS, FLOAT_WORDS = 8, 8, 32
SPAN = REGION.span
# An image of 512 px has 30 in a row.
REGION_ROWS = min(FLOATS.rows, 10)
DOT_BIT, ROW_BIT = 15, 11


@emitted('none')
def keep_maxima(builder: Any, query: Any, reference: Any, best: Any) -> None:
    """Raise the largest dot product of every row."""
    write = Vectors(builder, BYTES)
    for row, (left, right) in enumerate(write.dots(query, reference, BYTE_WORDS)):
        kept = write.load(write.numbers, best, row * BYTES.lanes)
        kept = write.larger(kept, write.larger(left, right))
        write.store(kept, best, row * BYTES.lanes)


@emitted('int32')
def maximum(builder: Any, best: Any) -> Any:
    """Return the largest dot product of a row."""
    write = Vectors(builder, BYTES)
    return write.largest(write.load(write.numbers, best))


@emitted('none')
def keep_words(
    builder: Any,
    query: Any,
    reference: Any,
    start: Any,
    places: Any,
    tile: Any,
    best: Any,
    columns: Any,
    tiles: Any,
) -> None:
    """
    Raise the best counterparts of every row and column, words of dot, row in tile and vector.

    One word serves both: whatever is done to an accumulator costs almost as much as a product.

    Parameters
    ----------
    builder : IRBuilder
        Of the compiled function.
    query, reference, start : int64
        Addresses; dot products start at those of their rows.
    places : int64
        Address of rows and vectors of the words, in their upper bits, [2][rows].
    tile : int64
        Which tile of the query this is.
    best, columns, tiles : int64
        Addresses of words of rows and of columns, and of the tiles that these come from.

    """
    write, lanes = Vectors(builder, BYTES), BYTES.lanes
    dots = write.dots(query, reference, BYTE_WORDS, start)
    highest: list[Any] = [None, None]
    for row, pair in enumerate(dots):
        kept = write.load(write.numbers, best, row * lanes)
        for half, dot in enumerate(pair):
            place = write.splat(write.load(write.word, places, half * BYTES.rows + row))
            word = write.call(
                f'fshl.v{lanes}i32', write.words, dot, place, write.constant(DOT_BIT)
            )
            kept = write.larger(kept, word)
            highest[half] = write.larger(highest[half], word) if row else word
        write.store(kept, best, row * lanes)
    own = write.splat(builder.trunc(tile, write.word))
    for half, word in enumerate(highest):
        kept = write.load(write.words, columns, half * lanes)
        better = builder.icmp_signed('>', word, kept)
        write.store(builder.select(better, word, kept), columns, half * lanes)
        earlier = write.load(write.words, tiles, half * lanes)
        write.store(builder.select(better, own, earlier), tiles, half * lanes)


@emitted('int32')
def best_word(builder: Any, best: Any) -> Any:
    """Return the best word of a row, with its lane in place of the row."""
    write = Vectors(builder, BYTES)
    others = write.constant(-(1 << DOT_BIT) | (1 << ROW_BIT) - 1)
    words = builder.and_(write.load(write.words, best), others)
    lane = write.constant(*(lane << ROW_BIT for lane in range(BYTES.lanes)))
    return write.largest(builder.or_(words, lane))


@emitted('none')
def keep_counterparts(
    builder: Any,
    query: Any,
    reference: Any,
    vector: Any,
    row: Any,
    best: Any,
    there: Any,
    columns: Any,
    back: Any,
) -> None:
    """
    Raise the best counterparts of every row and column, float32; of equal ones the first stays.

    Parameters
    ----------
    builder : IRBuilder
        Of the compiled function.
    query, reference : int64
        Addresses.
    vector, row : int64
        Which vector of the reference and row of the query are the first.
    best, there, columns, back : int64
        Addresses of the largest dot products of rows and of the vectors that these come from; of
        those of columns and of the rows that these come from.

    """
    write, lanes = Vectors(builder, FLOATS), FLOATS.lanes

    def raised(kept: Any, place: Any, dot: Any, its_place: Any) -> tuple[Any, Any]:
        better = builder.fcmp_ordered('>', dot, kept)
        return builder.select(better, dot, kept), builder.select(better, its_place, place)

    def numbered(first: Any, count: int) -> Any:
        return builder.add(write.splat(builder.trunc(first, write.word)), write.constant(count))

    dots = write.dots(query, reference, FLOAT_WORDS)
    numbers = numbered(vector, 0), numbered(vector, 1)
    for own, pair in enumerate(dots):
        kept = write.load(write.numbers, best, own * lanes)
        place = write.load(write.words, there, own * lanes)
        for dot, number in zip(pair, numbers, strict=True):
            kept, place = raised(kept, place, dot, number)
        write.store(kept, best, own * lanes)
        write.store(place, there, own * lanes)
    for half in (0, 1):
        kept = write.load(write.numbers, columns, half * lanes)
        place = write.load(write.words, back, half * lanes)
        for own, pair in enumerate(dots):
            kept, place = raised(kept, place, pair[half], numbered(row, own))
        write.store(kept, columns, half * lanes)
        write.store(place, back, half * lanes)


@emitted('int32')
def first_best(builder: Any, best: Any, there: Any) -> Any:
    """Return the region with the largest dot product of a row, the first of equal ones."""
    write, lanes = Vectors(builder, FLOATS), FLOATS.lanes
    dots = write.load(write.numbers, best)
    vectors = builder.mul(write.load(write.words, there), write.constant(lanes))
    regions = builder.add(vectors, write.constant(*range(lanes)))
    equal = builder.fcmp_ordered('==', dots, write.splat(write.largest(dots)))
    listed = builder.select(equal, regions, write.constant(2**31 - 1))
    return write.call(f'vector.reduce.smin.v{lanes}i32', write.word, listed)


@emitted('none')
def keep_cell_dots(builder: Any, query: Any, reference: Any, dots: Any, stride: Any) -> None:
    """Write the dot products of float32 cells, rows `stride` bytes apart."""
    write = Vectors(builder, FLOATS)
    for row, pair in enumerate(write.dots(query, reference, CELL_WORDS)):
        own = builder.add(dots, builder.mul(stride, write.ir.Constant(stride.type, row)))
        for half in (0, 1):
            write.store(pair[half], own, half * FLOATS.lanes)


@emitted('none')
def keep_region_dots(builder: Any, cells: Any, width: Any, axes: Any, dots: Any) -> None:
    """
    Write the dot products of neighbouring 3 x 3-cell regions, [rows][FLOAT_WORDS].

    Every number of a cell is loaded once for all three regions that it belongs to.

    Parameters
    ----------
    builder : IRBuilder
        Of the compiled function.
    cells, width : int64
        Address of the first region's first cell, and bytes from a row of cells to the next.
    axes, dots : int64
        Addresses of two vectors of axes for each word of a region, and of the first result.

    """
    write, lanes = Vectors(builder, FLOATS), FLOATS.lanes
    zero = write.ir.Constant(write.numbers, None)
    sums = [[zero, zero] for _ in range(REGION_ROWS)]
    for down in range(SPAN):
        for number in range(CELL_WORDS):
            words = [(down * SPAN + right) * CELL_WORDS + number for right in range(SPAN)]
            pairs = [
                [write.load(write.numbers, axes, (2 * word + half) * lanes) for half in (0, 1)]
                for word in words
            ]
            for cell in range(REGION_ROWS + SPAN - 1):
                own = write.splat(write.load(write.number, cells, cell * CELL_WORDS + number))
                for right, pair in enumerate(pairs):
                    if 0 <= cell - right < REGION_ROWS:
                        kept = sums[cell - right]
                        for half in (0, 1):
                            kept[half] = write.added(kept[half], pair[half], own)
        cells = builder.add(cells, width)
    for row, kept in enumerate(sums):
        for half in (0, 1):
            write.store(kept[half], dots, row * FLOAT_WORDS + half * lanes)


@emitted('float32')
def best_block(
    builder: Any, left: Any, right: Any, above: Any, inverse: Any, kept: Any, vectors: Any
) -> Any:
    """
    Return the best similarity of a 2 x 2-cell region, from dot products of its cells.

    Parameters
    ----------
    builder : IRBuilder
        Of the compiled function.
    left, right : int64
        Addresses of the dot products of its two lower cells; those of `right` lie one further.
    above, inverse, kept : int64
        Addresses of sums of the two upper ones, inverse lengths of the reference's regions, and
        where the sums of the two lower ones are written.
    vectors : int64
        How many there are of each.

    """
    write = Vectors(builder, FLOATS)
    best = write.help.alloca_once_value(builder, write.ir.Constant(write.numbers, None))
    with write.help.for_range(builder, vectors) as loop:
        offset = builder.mul(loop.index, write.ir.Constant(loop.index.type, 4 * FLOATS.lanes))
        lower_left, lower_right, upper, factor = (
            write.load(write.numbers, builder.add(one, offset))
            for one in (left, right, above, inverse)
        )
        lower = builder.fadd(lower_left, lower_right)
        write.store(lower, builder.add(kept, offset))
        similarity = builder.fmul(builder.fadd(upper, lower), factor)
        builder.store(write.larger(similarity, builder.load(best)), best)
    return write.largest(builder.load(best))


@emitted('none')
def place_region(builder: Any, dots: Any, factor: Any, origin: Any, region: Any) -> None:
    """Write dot products times a factor less those of an origin, at unit length; addresses."""
    write, lanes = Vectors(builder, FLOATS), FLOATS.lanes
    scale = write.splat(write.load(write.number, factor))
    moved = []
    squares = write.ir.Constant(write.numbers, None)
    for start in range(0, FLOAT_WORDS, lanes):
        scaled = builder.fmul(write.load(write.numbers, dots, start), scale)
        moved.append(builder.fsub(scaled, write.load(write.numbers, origin, start)))
        squares = builder.fadd(squares, builder.fmul(moved[-1], moved[-1]))
    length = write.call('sqrt.f32', write.number, write.total(squares))
    one, zero = (write.ir.Constant(write.number, value) for value in (1.0, 0.0))
    flat = builder.fcmp_ordered('==', length, zero)
    inverse = write.splat(builder.fdiv(one, builder.select(flat, one, length)))
    for place, vector in enumerate(moved):
        write.store(builder.fmul(vector, inverse), region, place * lanes)
