# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Vector instructions of one width, written for LLVM 15 and later."""

from importlib import import_module
from typing import Any

from convseq_ros.core.similarity.kernels.instructions import Tile


class Vectors:
    """
    Writes the instructions for a tile.

    Parameters
    ----------
    builder : IRBuilder
        Of the compiled function.
    tile : Tile
        Its shape and kind of products.

    """

    def __init__(self, builder: Any, tile: Tile) -> None:
        self.ir = ir = import_module('llvmlite.ir')
        self.help = import_module('numba.core.cgutils')
        self.builder, self.tile = builder, tile
        self.word = ir.IntType(32)
        self.number = self.word if tile.bytes else ir.FloatType()
        self.words = ir.VectorType(self.word, tile.lanes)
        self.numbers = ir.VectorType(self.number, tile.lanes)

    def call(self, name: str, result: Any, *arguments: Any) -> Any:
        """Call a function of LLVM."""
        kind = self.ir.FunctionType(result, [one.type for one in arguments])
        function = self.help.get_or_insert_function(self.builder.module, kind, f'llvm.{name}')
        return self.builder.call(function, arguments)

    def load(self, kind: Any, address: Any, words: int = 0) -> Any:
        """Return what lies some words beyond an address."""
        return self.builder.load(self._pointer(kind, address, words), align=4)

    def store(self, value: Any, address: Any, words: int = 0) -> None:
        """Write some words beyond an address."""
        self.builder.store(value, self._pointer(value.type, address, words), align=4)

    def splat(self, value: Any) -> Any:
        """Return a vector of equal numbers."""
        some = self.ir.Constant(self.ir.VectorType(value.type, self.tile.lanes), self.ir.Undefined)
        first = self.builder.insert_element(some, value, self.ir.Constant(self.word, 0))
        return self.builder.shuffle_vector(first, some, self.constant(0))

    def constant(self, *values: int) -> Any:
        """Return a vector of integers, all equal if one is given."""
        return self.ir.Constant(self.words, values * (self.tile.lanes // len(values)))

    def larger(self, one: Any, other: Any) -> Any:
        """Return the larger of each two numbers."""
        if self.tile.bytes:
            return self.call(f'smax.{self._suffix}', self.numbers, one, other)
        return self.builder.select(self.builder.fcmp_ordered('>', one, other), one, other)

    def largest(self, vector: Any) -> Any:
        """Return the largest number of a vector."""
        kind = 'smax' if self.tile.bytes else 'fmax'
        return self.call(f'vector.reduce.{kind}.{self._suffix}', self.number, vector)

    def total(self, vector: Any) -> Any:
        """Return the sum of a vector's numbers, half and half, as no order is prescribed."""
        count = self.tile.lanes
        while count > 1:
            count //= 2
            halves = (
                self.builder.shuffle_vector(
                    vector,
                    vector,
                    self.ir.Constant(
                        self.ir.VectorType(self.word, count), list(range(first, first + count))
                    ),
                )
                for first in (0, count)
            )
            vector = self.builder.fadd(*halves)
        return self.builder.extract_element(vector, self.ir.Constant(self.word, 0))

    def dots(
        self, query: Any, reference: Any, words: int, start: Any = None
    ) -> list[tuple[Any, Any]]:
        """Return the dot products of a tile, for each row two vectors; see `tile.py`."""
        lanes, rows = self.tile.lanes, range(self.tile.rows)
        zero = self.ir.Constant(self.number, None)
        first = [self.load(self.number, start, row) if start else zero for row in rows]
        sums = [(self.splat(one), self.splat(one)) for one in first]
        for word in range(words):
            left = self.load(self.numbers, reference, 2 * word * lanes)
            right = self.load(self.numbers, reference, (2 * word + 1) * lanes)
            for row in rows:
                own = self.splat(self.load(self.number, query, row * words + word))
                sums[row] = (
                    self.added(sums[row][0], left, own),
                    self.added(sums[row][1], right, own),
                )
        return sums

    @property
    def _suffix(self) -> str:
        return f'v{self.tile.lanes}{"i" if self.tile.bytes else "f"}32'

    def _pointer(self, kind: Any, address: Any, words: int) -> Any:
        offset = self.ir.Constant(address.type, 4 * words)
        return self.builder.inttoptr(self.builder.add(address, offset), kind.as_pointer())

    def added(self, sums: Any, reference: Any, query: Any) -> Any:
        """Add the products of four bytes, or of one float32 number, in each word."""
        lanes, bits = self.tile.lanes, 32 * self.tile.lanes
        if not self.tile.bytes:
            return self.call(f'fmuladd.{self._suffix}', self.numbers, reference, query, sums)
        if self.tile.name.endswith('vnni'):
            return self.call(f'x86.avx512.vpdpbusd.{bits}', self.words, sums, reference, query)
        fours = self.ir.VectorType(self.ir.IntType(8), 4 * lanes)
        twos = self.ir.VectorType(self.ir.IntType(16), 2 * lanes)
        by_two, by_four = {
            256: ('x86.avx2.pmadd.ub.sw', 'x86.avx2.pmadd.wd'),
            512: ('x86.avx512.pmaddubs.w.512', 'x86.avx512.pmaddw.d.512'),
        }[bits]
        reference, query = (self.builder.bitcast(one, fours) for one in (reference, query))
        products = self.call(by_two, twos, reference, query)
        ones = self.ir.Constant(twos, [1] * 2 * lanes)
        return self.builder.add(sums, self.call(by_four, self.words, products, ones))
