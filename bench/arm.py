# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Compute the cost of the inner loops on ARM: `python -m bench.arm`, from the repository.

GCC compiles the kernels for ARM, and llvm-mca counts the cycles of a tile of a coherent pair on a
Neoverse N1, the sister of Cortex-A76. Nothing is run. Needs aarch64-linux-gnu-gcc and llvm-mca of
LLVM 16 or later. Writes docs/performance_arm.json, from which the page is made.
"""

from collections.abc import Iterator
import json
from pathlib import Path
import re
import shutil
import subprocess
import textwrap

_NATIVE = Path('convseq_ros/core/native')
_FLAGS = (
    '-std=gnu11 -O3 -fno-schedule-insns -ffp-contract=off -fno-math-errno -fno-trapping-math '
    '-Wno-psabi'
).split()
_MCA = 'llvm-mca-16 -mtriple=aarch64 -mcpu=neoverse-n1 -mattr=+dotprod'.split()
_ITERATIONS = 200
_PRODUCTS = {'dotprod': 'sdot', 'neon': 'smull'}  # per product of 16 bytes with 16 bytes
PEAK = 2.0  # products of 128 bits per cycle, with both vector pipes
GHZ = 2.4  # of a Raspberry Pi 5
# A pair of 650 and 900 salient regions, in tiles of 10 by 8, with 8 steps of four numbers.
_TILES, _BLOCKS, _STEPS, _ROWS = 65, 113, 8, 10
_IN_TILE = 2 * _ROWS * _STEPS


def computed() -> list[dict[str, object]]:
    """Return the cost of a tile of a coherent pair, for each kind of processor."""
    rows = []
    for kind, name in _PRODUCTS.items():
        source = str(_NATIVE / f'{kind}.c')
        command = ['aarch64-linux-gnu-gcc', *_FLAGS, '-S', source, '-o', '-']
        text = subprocess.run(command, capture_output=True, text=True, check=True).stdout
        # The longest loop, with labels and maxima, is that of coherent pairs.
        full = (body for body in _loops(text) if _sum(body, name) == _IN_TILE)
        loop = max(full, key=len)
        cycles = _cycles(loop)
        share = _IN_TILE / cycles / PEAK
        pair_ms = _TILES * _BLOCKS * cycles / GHZ / 1e6
        costs = {'cycles': round(cycles, 1), 'products': _IN_TILE, 'share': round(share, 3)}
        rows.append({'kind': kind, **costs, 'pair_ms': round(pair_ms, 3)})
    return rows


def _loops(text: str) -> Iterator[list[str]]:
    """Yield the instructions of each innermost loop of an assembler text."""
    lines, labels = text.split('\n'), dict[str, int]()
    for index, line in enumerate(lines):
        if label := re.match(r'(\.L\d+):', line):
            labels[label[1]] = index
        back = re.match(r'\s+b\.?(?:ne|lt|gt|le|ge|hi|ls|cc|cs)\s+(\.L\d+)', line)
        if back and back[1] in labels:
            body = lines[labels[back[1]] + 1 : index + 1]
            if not any(re.match(r'\.L\d+:', each) for each in body):
                yield [each for each in body if not re.match(r'\s+\.', each)]


def _sum(body: list[str], name: str) -> int:
    return sum(line.split()[:1] == [name] for line in body)


def _cycles(body: list[str]) -> float:
    command = [*_MCA, f'-iterations={_ITERATIONS}']
    output = subprocess.run(
        command, input='\n'.join(body) + '\n', capture_output=True, text=True, check=True
    ).stdout
    total = re.search(r'Total Cycles:\s+(\d+)', output)
    assert total, output
    return int(total[1]) / _ITERATIONS


def section(rows: list[dict[str, object]]) -> str:
    """Return the page's section."""
    told = ' and '.join(
        f'{row["pair_ms"]} ms with the kernels {row["kind"]} ({row["share"]} of the peak)'
        for row in rows
    )
    text = (
        'Not measured on a board. By cycles that llvm-mca counts for a Neoverse N1, the sister of '
        f'Cortex-A76, at {GHZ} GHz (`python -m bench.arm`), a pair of images takes {told}.'
    )
    return f'## On ARM, computed\n\n{textwrap.fill(text, 99, break_on_hyphens=False)}\n'


def main() -> int:
    """Write the computed costs."""
    for tool in ('aarch64-linux-gnu-gcc', _MCA[0]):
        if not shutil.which(tool):
            print(f'bench.arm: needs {tool}; apt install gcc-aarch64-linux-gnu llvm-16')
            return 1
    rows = computed()
    lines = json.dumps(rows, indent=1) + '\n'
    Path('docs/performance_arm.json').write_text(lines, encoding='utf-8')
    print(section(rows))
    return 0


if __name__ == '__main__':
    raise SystemExit(main())
