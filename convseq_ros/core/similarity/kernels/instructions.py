# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Which vector instructions the machine has, and the shapes of tiles that suit them."""

from dataclasses import dataclass
from functools import cache
from importlib import import_module
import platform

from convseq_ros.core.compiled import available


@dataclass(frozen=True, slots=True)
class Tile:
    """
    How dot products are laid out in registers: rows of a query by two vectors of a reference.

    Parameters
    ----------
    name : str
        Of the instructions.
    lanes : int
        Words of 32 bits in a vector.
    rows : int
        There are twice as many accumulators; with what else is needed they fill the registers.
    offset : int
        What makes signed bytes of a reference unsigned; 0 for products of float32 numbers.

    """

    name: str
    lanes: int
    rows: int
    offset: int = 0

    @property
    def bytes(self) -> bool:
        """Whether words are four bytes, not one float32 number."""
        return self.offset > 0

    @property
    def columns(self) -> int:
        """Regions of a reference that are compared at once."""
        return 2 * self.lanes


@cache
def features() -> frozenset[str]:
    """Return the processor's features that compiled code may use, as LLVM names them."""
    if not available():
        return frozenset()
    host = import_module('llvmlite.binding').get_host_cpu_features()
    found = frozenset(name for name, there in host.items() if there)
    wanted = import_module('numba').config.CPU_FEATURES
    if wanted is None:
        return found
    return found & {name[1:] for name in wanted.split(',') if name.startswith('+')}


@cache
def int8_tile() -> Tile | None:
    """
    Return the best tile for 8-bit products; None where there are no instructions for them.

    Without VNNI sums of two products must fit into 16 bits: references then have 7 bits.
    """
    there = features()
    if {'avx512vnni', 'avx512bw'} <= there:
        return Tile('avx512-vnni', 16, 12, 128)
    if 'avxvnni' in there or {'avx512vnni', 'avx512vl'} <= there:
        return Tile('avx-vnni', 8, 6, 128)
    if 'avx512bw' in there:
        return Tile('avx512-maddubs', 16, 12, 64)
    return Tile('avx2-maddubs', 8, 6, 64) if 'avx2' in there else None


@cache
def float_tile() -> Tile | None:
    """Return the best tile for float32 products; None where compiled ones would be no faster."""
    there = features()
    if 'avx512f' in there:
        return Tile('avx512', 16, 12)
    if 'avx' in there:
        return Tile('avx', 8, 6)
    arm = available() and platform.machine() in ('aarch64', 'arm64')
    return Tile('neon', 4, 12) if arm else None
