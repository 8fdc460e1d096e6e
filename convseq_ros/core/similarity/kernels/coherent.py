# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Coherent pair scores, compiled: counterparts by tiles, then votes for shifts."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache

from convseq_ros.core.compiled import compiled
from convseq_ros.core.encoding.regions import Regions
from convseq_ros.core.similarity.coherent import COHERENT, coherent_pair, CoherentQuery
from convseq_ros.core.similarity.kernels.normalization import normalized
from convseq_ros.core.similarity.kernels.panel import (
    address,
    addresses,
    Panel,
    panel_of,
    quantised,
    query_words,
    reference_words,
)
from convseq_ros.core.similarity.kernels.projection import packed_bytes, shown_regions
from convseq_ros.core.similarity.kernels.tile import (
    best_word,
    BYTE_WORDS,
    BYTES,
    DOT_BIT,
    first_best,
    FLOAT_WORDS,
    FLOATS,
    keep_counterparts,
    keep_words,
    ROW_BIT,
)
from convseq_ros.core.similarity.pair_score import PairScore, Scores
import numpy as np
import numpy.typing as npt

_SCALE = 160.0  # of a region's numbers as bytes; hardly any of a unit vector is clipped
_MOST = 127  # the largest signed byte
REACH = COHERENT.reach_cells
_FACTORS = COHERENT.window[REACH:]
_LANES, _ROWS, _COLUMNS = BYTES.lanes, BYTES.rows, BYTES.columns
_FLOAT_LANES, _FLOAT_ROWS, _FLOAT_COLUMNS = FLOATS.lanes, FLOATS.rows, FLOATS.columns


@dataclass(frozen=True, slots=True)
class _Query:
    """What compiled functions read of a query; `spots` as `_spots` has them."""

    query: CoherentQuery
    words: Panel
    spots: npt.NDArray[np.int64]
    start: npt.NDArray[np.int32] | None = None

    @property
    def side(self) -> int:
        return self.query.side


@cache
def _spots(side: int) -> npt.NDArray[np.int64]:
    """Return where regions lie in a grid with room for every shift, smoothed; shape (N,)."""
    index = np.arange(side * side)
    return index // side * (2 * side - 1 + 2 * REACH) + index % side


@cache
def _places(side: int) -> Panel:
    """Return row in tile and vector of every word, in its upper bits, [vectors][rows]."""
    vectors = np.arange(-(-side * side // _COLUMNS) * 2)[:, None]
    places = np.arange(_ROWS) << ROW_BIT | vectors
    return panel_of((places << 32 - DOT_BIT).astype(np.uint32).view(np.int32))


def _float_query(query: CoherentQuery) -> _Query:
    words = query_words(query.regions, FLOATS)
    return _Query(query, words, _spots(query.side)[query.index])


def _byte_query(query: CoherentQuery) -> _Query:
    words = query_words(quantised(query.regions, _SCALE, _MOST), BYTES)
    sums = words.array.view(np.int8).sum(axis=1, dtype=np.int32)
    start = -BYTES.offset * sums
    return _Query(query, words, _spots(query.side)[query.index], start)


def _float_reference(regions: Regions) -> Panel:
    return reference_words(regions, FLOATS)


def _byte_reference(regions: Regions) -> Panel:
    # As fine as the range above the offset lets it be; hardly any number is clipped.
    scale, most = _SCALE * BYTES.offset / 128, BYTES.offset - 1
    return packed_bytes(regions, scale, most, BYTES.offset)


def _compare_floats(query: _Query, references: Sequence[Panel]) -> Scores:
    found = np.empty((len(references), 3))
    where = addresses(references)
    _float_scores(query.words.address, query.spots, _spots(query.side), query.side, where, found)
    return found[:, 0].astype(np.float32), found[:, 1:]


def _compare_bytes(query: _Query, references: Sequence[Panel]) -> Scores:
    found = np.empty((len(references), 3))
    # Held by name: what two threads make at once is not what the cache keeps of both.
    places = _places(query.side)
    _byte_scores(
        query.words.address,
        query.start,
        query.spots,
        _spots(query.side),
        places.address,
        query.side,
        addresses(references),
        found,
    )
    return found[:, 0].astype(np.float32), found[:, 1:]


@compiled
def _float_scores(query, own, spots, side, references, found):  # type: ignore[no-untyped-def]
    """Write score and shift, (n, 3), of a query and each reference, both addresses."""
    tiles = -(-len(own) // _FLOAT_ROWS)
    blocks = -(-len(spots) // _FLOAT_COLUMNS)
    there, back = np.empty(tiles * _FLOAT_ROWS, np.int32), np.empty(len(spots), np.int32)
    best = np.empty((_FLOAT_ROWS, _FLOAT_LANES), np.float32)
    vectors = np.empty((_FLOAT_ROWS, _FLOAT_LANES), np.int32)
    columns = np.empty(blocks * _FLOAT_COLUMNS, np.float32)
    rows = np.empty(blocks * _FLOAT_COLUMNS, np.int32)
    for index in range(len(references)):
        columns[:] = -np.inf
        for tile in range(tiles):
            best[:] = -np.inf
            for block in range(blocks):
                keep_counterparts(
                    query + tile * _FLOAT_ROWS * FLOAT_WORDS * 4,
                    references[index] + block * _FLOAT_COLUMNS * FLOAT_WORDS * 4,
                    2 * block,
                    tile * _FLOAT_ROWS,
                    address(best),
                    address(vectors),
                    address(columns) + block * _FLOAT_COLUMNS * 4,
                    address(rows) + block * _FLOAT_COLUMNS * 4,
                )
            for row in range(_FLOAT_ROWS):
                offset = row * _FLOAT_LANES * 4
                region = first_best(address(best) + offset, address(vectors) + offset)
                there[tile * _FLOAT_ROWS + row] = min(region, len(spots) - 1)
        for region in range(len(spots)):
            back[region] = min(rows[region], len(own) - 1)
        _vote(there, back, own, spots, side, found[index])


@compiled
def _byte_scores(  # type: ignore[no-untyped-def]
    query, start, own, spots, places, side, references, found
):
    """Write score and shift, (n, 3), of a query and each reference, both addresses."""
    tiles = -(-len(own) // _ROWS)
    blocks = -(-len(spots) // _COLUMNS)
    there, back = np.empty(tiles * _ROWS, np.int32), np.empty(len(spots), np.int32)
    best = np.empty((_ROWS, _LANES), np.int32)
    columns, of_tile = np.empty((2, blocks * _COLUMNS), np.int32)
    lowest = np.iinfo(np.int32).min
    for index in range(len(references)):
        columns[:] = lowest
        for tile in range(tiles):
            best[:] = lowest
            for block in range(blocks):
                keep_words(
                    query + tile * _ROWS * BYTE_WORDS * 4,
                    references[index] + block * _COLUMNS * BYTE_WORDS * 4,
                    address(start) + tile * _ROWS * 4,
                    places + block * 2 * _ROWS * 4,
                    tile,
                    address(best),
                    address(columns) + block * _COLUMNS * 4,
                    address(of_tile) + block * _COLUMNS * 4,
                )
            for row in range(_ROWS):
                word = best_word(address(best) + row * _LANES * 4)
                vector, lane = word & (1 << ROW_BIT) - 1, word >> ROW_BIT & 15
                there[tile * _ROWS + row] = min(vector * _LANES + lane, len(spots) - 1)
        for region in range(len(spots)):
            row = of_tile[region] * _ROWS + (columns[region] >> ROW_BIT & 15)
            back[region] = min(row, len(own) - 1)
        _vote(there, back, own, spots, side, found[index])


@compiled
def _vote(there, back, own, spots, side, found):  # type: ignore[no-untyped-def]
    """Write the share of votes for the best shift, and that shift; see `coherent_score`."""
    span = 2 * side - 1
    width = span + 2 * REACH
    middle = (side - 1 + REACH) * (width + 1)
    votes = np.zeros(width * width)
    for row in range(len(own)):
        votes[spots[there[row]] - own[row] + middle] += 1
    share = len(own) / len(spots)
    for region in range(len(spots)):
        votes[spots[region] - own[back[region]] + middle] += share
    across, smoothed = np.zeros(width * width), np.empty(width * width)
    first, count = REACH * (width + 1), (span - 1) * width + span
    _smooth(votes, 1, first, across[first : first + count])
    _smooth(across, width, first, smoothed[first : first + count])
    peak, place = -1.0, 0
    for row in range(REACH, REACH + span):
        for at in range(row * width + REACH, row * width + REACH + span):
            if smoothed[at] > peak:
                peak, place = smoothed[at], at
    found[0] = min(peak / (2 * len(own)), 1.0)
    found[1] = place // width - REACH - side + 1
    found[2] = place % width - REACH - side + 1


@compiled
def _smooth(votes, step, first, smoothed):  # type: ignore[no-untyped-def]
    """Fill in votes from `first` on, with those up to 6 steps away added."""
    own = votes[first - REACH * step :]
    # Unsigned: of other indices the sign would be asked, for every number.
    one, reach = np.uint64(step), np.uint64(REACH)
    for number in range(np.uint64(len(smoothed))):
        total = own[number + reach * one]
        for away in range(np.uint64(1), np.uint64(REACH + 1)):
            before = own[number + (reach - away) * one]
            total += _FACTORS[away] * (before + own[number + (reach + away) * one])
        smoothed[number] = total


def float32() -> PairScore:
    """Return the pair score by float32 products; scores are those of the definition."""
    name = f'float32 {FLOATS.name}'
    return coherent_pair(
        name, True, normalized, shown_regions, _float_query, _float_reference, _compare_floats
    )


def int8() -> PairScore:
    """Return the pair score by 8-bit products; scores are within 0.01 of the definition's."""
    name = f'int8 {BYTES.name}'
    return coherent_pair(
        name, False, normalized, shown_regions, _byte_query, _byte_reference, _compare_bytes
    )
