# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""References as coherent pairs are compared, many at a time: references.c."""

from collections.abc import Sequence
from dataclasses import dataclass

from convseq_ros.core.compiled import address, array, DOUBLE, FLOAT, kernel, SIZE
from convseq_ros.core.encoding.kernels import axes
from convseq_ros.core.encoding.regions import REGION, Regions, thinned
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
    rounded_up,
)
import numpy as np
import numpy.typing as npt

_FLOATS, _ADDRESSES = array('f4'), array('u8')
_prepare = kernel(
    'prepare', _ADDRESSES, SIZE, SIZE, SIZE, FLOAT, FLOAT, FLOAT, DOUBLE, _FLOATS, _FLOATS,
    _FLOATS, SIZE, FLOAT, _ADDRESSES, array('i1'),
)  # fmt: skip
_lateral_products = kernel(
    'lateral_products', _FLOATS, SIZE, SIZE, _ADDRESSES, SIZE, SIZE, array('f8')
)


@dataclass(frozen=True, slots=True)
class Reference:
    """The regions of a reference, as bytes or floats, and behind them its blocks."""

    panel: Panel
    address: int  # of the panel
    blocks: int  # where they begin, in numbers of 4 bytes; 0 if there are none
    length: float  # of the vector of all blocks


def pack(regions: Regions, blocks: Blocks | None, scale: float) -> Reference:
    """Return a reference from its regions, as bytes if there is a scale, and its blocks."""
    shown = reference_bytes(regions, scale) if scale else reference_floats(regions)
    behind = np.zeros(0, np.float32) if blocks is None else blocks
    panel = empty_panel(shown.nbytes + behind.nbytes, np.uint8)
    panel[: shown.nbytes], panel[shown.nbytes :] = shown.view(np.uint8), behind.view(np.uint8)
    begin = 0 if blocks is None else shown.nbytes // 4
    return Reference(panel, address(panel), begin, float(lengths(behind)))


def pack_all(
    packed: Sequence[Packed],
    normalizes: bool,
    background: Regions | None,
    scale: float,
    step: int = 1,
) -> list[Reference | None]:
    """
    Return what `pack` does of each reference, from its packed cells; None without gradient.

    Of rows and columns of regions, one of each `step` is taken.
    """
    room, panels, shown = _prepared(packed, normalizes, background, scale, step)
    made = [panels[one] for one in np.flatnonzero(shown)]
    if not made:
        return [None] * len(packed)
    if not scale:
        for regions in (panel[:room].view(np.float32) for panel in made):
            regions[:] = reference_floats(_regions(regions, len(packed[0]), step))
    blocks = np.array([panel[room:] for panel in made], np.uint8).view(np.float32)
    begin = room // 4 if blocks.size else 0
    found = iter(
        [
            Reference(panel, address(panel), begin, length)
            for panel, length in zip(made, lengths(blocks).tolist(), strict=True)
        ]
    )
    return [next(found) if any_ else None for any_ in shown]


def regions_all(
    packed: Sequence[Packed], normalizes: bool, background: Regions | None
) -> list[Regions | None]:
    """Return the regions (N, 32) of references, from packed cells; None without gradient."""
    _, panels, shown = _prepared(packed, normalizes, background, 0.0, 1)
    return [
        _regions(panel.view(np.float32), len(packed[0]), 1) if any_ else None
        for panel, any_ in zip(panels, shown, strict=True)
    ]


def _regions(numbers: npt.NDArray[np.float32], size: int, step: int) -> Regions:
    """Return the regions that a panel begins with, before they are laid out in blocks."""
    side = rounded_up(size - REGION.span + 1, step) // step
    return numbers[: side**2 * REGION.numbers].reshape(-1, REGION.numbers)


def _prepared(
    packed: Sequence[Packed], normalizes: bool, background: Regions | None, scale: float, step: int
) -> tuple[int, list[Panel], npt.NDArray[np.int8]]:
    """Return how many bytes the regions of a panel take, the panels, and which show something."""
    size, shown = len(packed[0]), np.empty(len(packed), np.int8)
    side, own, block = size - REGION.span + 1, NORMALIZATION, GLOBAL_SIMILARITY.block
    if background is not None:
        background = np.ascontiguousarray(thinned(background, step), np.float32)
    side = rounded_up(side, step) // step
    room = rounded_up(side**2, COLUMNS) * REGION.numbers * (1 if scale else 4)
    behind = 0
    if background is not None:
        behind = (-(-side // block)) ** 2 * REGION.numbers * 4
    cells = [np.ascontiguousarray(one) for one in packed]
    panels = [empty_panel(room + behind, np.uint8) for _ in packed]
    _prepare(
        addresses(cells), len(packed), size, step, PACKED_UNIT, own.middle, own.side,
        own.saturation if normalizes else 0.0, *axes(), background, block, scale,
        addresses(panels), shown,
    )  # fmt: skip
    return room, panels, shown


def alike(
    query: Wide, references: Sequence[Reference], where: npt.NDArray[np.uint64]
) -> npt.NDArray[np.float32] | None:
    """Return global similarities, as the definition does; None if a reference has no blocks."""
    if not all(one.blocks for one in references):
        return None
    best, begin = np.empty(len(references)), references[0].blocks
    _lateral_products(query, *query.shape[:2], where, begin, len(references), best)
    return from_products(best, query, np.array([one.length for one in references]))
