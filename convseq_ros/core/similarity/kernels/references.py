# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""References as coherent pairs are compared, many at a time: references.c."""

from collections.abc import Sequence
from dataclasses import dataclass

from convseq_ros.core.compiled import address, array, DOUBLE, FLOAT, INT, kernel, SIZE
from convseq_ros.core.encoding.kernels import axes
from convseq_ros.core.encoding.regions import REGION, Regions, regions_in_a_row
from convseq_ros.core.map.place import Packed, PACKED_UNIT
from convseq_ros.core.similarity.global_similarity import (
    Blocks,
    from_products,
    GLOBAL_SIMILARITY,
    lengths,
    Wide,
)
from convseq_ros.core.similarity.kernels.numpy_normalization import NORMALIZATION
from convseq_ros.core.similarity.kernels.panel import (
    addresses,
    COLUMNS,
    empty_panel,
    Panel,
    reference_bytes,
    reference_floats,
    regions_of_bytes,
    regions_of_floats,
    rounded_up,
)
import numpy as np
import numpy.typing as npt

_FLOATS, _ADDRESSES = array('f4'), array('u8')
_prepare = kernel(
    'prepare', _ADDRESSES, SIZE, SIZE, INT, FLOAT, FLOAT, FLOAT, DOUBLE, _FLOATS, _FLOATS,
    _FLOATS, SIZE, FLOAT, SIZE, _ADDRESSES, array('i1'),
)  # fmt: skip
_lateral_products = kernel(
    'lateral_products', _FLOATS, SIZE, SIZE, _ADDRESSES, SIZE, SIZE, array('f8')
)


@dataclass(frozen=True, slots=True)
class Reference:
    """The regions of a reference, as bytes or floats; then its blocks."""

    panel: Panel
    address: int  # of the panel
    count: int  # regions
    blocks: int  # where blocks begin, in numbers of 4 bytes; 0 if there are none
    length: float  # of the vector of all blocks


def pack(regions: Regions, blocks: Blocks | None, scale: float) -> Reference:
    """Return a reference from its regions, as bytes if there is a scale, and its blocks."""
    every = reference_bytes(regions, scale) if scale else reference_floats(regions)
    behind = np.zeros(0, np.float32) if blocks is None else blocks
    parts = [one.view(np.uint8).ravel() for one in (every, behind)]
    panel = empty_panel(sum(map(len, parts)), np.uint8)
    np.concatenate(parts, out=panel)
    begin = 0 if blocks is None else len(parts[0]) // 4
    return Reference(panel, address(panel), len(regions), begin, float(lengths(behind)))


def pack_all(
    packed: Sequence[Packed], normalizes: bool, background: Regions | None, step: int, scale: float
) -> list[Reference | None]:
    """
    Return what `pack` does of each reference, from its packed cells; None without gradient.

    Of rows and columns of regions, one of each `step`, 1 or 2, is taken; with 2 without blocks.
    """
    size, shown, own = len(packed[0]), np.empty(len(packed), np.int8), NORMALIZATION
    side, block, behind = regions_in_a_row(size, step), 0, 0
    count, each = side**2, REGION.numbers * (1 if scale else 4)
    room = rounded_up(count, COLUMNS) * each
    if background is not None:
        background = np.ascontiguousarray(background, np.float32)
        if step == 1:
            block = GLOBAL_SIMILARITY.block
            behind = (-(-side // block)) ** 2 * REGION.numbers * 4
    cells = [np.ascontiguousarray(one) for one in packed]
    panels = [empty_panel(room + behind, np.uint8) for _ in packed]
    _prepare(
        addresses(cells), len(packed), size, step, PACKED_UNIT, own.middle, own.side,
        own.saturation if normalizes else 0.0, *axes(), background, block, scale, room,
        addresses(panels), shown,
    )  # fmt: skip
    made = [panels[one] for one in np.flatnonzero(shown)]
    if not made:
        return [None] * len(packed)
    for panel in made if not scale else ():
        numbers = panel[:room].view(np.float32)
        regions = numbers[: count * REGION.numbers].reshape(-1, REGION.numbers).copy()
        numbers[:] = reference_floats(regions)
    blocks = np.array([panel[room:] for panel in made], np.uint8).view(np.float32)
    begin = room // 4 if behind else 0
    found = iter(
        [
            Reference(panel, address(panel), count, begin, length)
            for panel, length in zip(made, lengths(blocks).tolist(), strict=True)
        ]
    )
    return [next(found) if any_ else None for any_ in shown]


def regions_of(reference: Reference, scale: float) -> Regions:
    """Return the regions (N, 32) of a reference; of bytes, to half a step of these."""
    panel = reference.panel[: 4 * reference.blocks or None]
    if scale:
        return regions_of_bytes(panel.view(np.int8), reference.count, scale)
    return regions_of_floats(panel.view(np.float32), reference.count)


def alike(
    query: Wide, references: Sequence[Reference], where: npt.NDArray[np.uint64]
) -> npt.NDArray[np.float32] | None:
    """Return global similarities, as the definition does; None if a reference has no blocks."""
    if not all(one.blocks for one in references):
        return None
    best, begin = np.empty(len(references)), references[0].blocks
    _lateral_products(query, *query.shape[:2], where, begin, len(references), best)
    return from_products(best, query, np.array([one.length for one in references]))
