# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""docs/PERFORMANCE.md: one table of what was measured; performance.json has all of it."""

from collections.abc import Iterable, Mapping
import json
from pathlib import Path
import textwrap
from typing import Any

from bench.arm import section
from bench.part import PARTS
from bench.table import cells, COLUMNS, number, Row

_HEAD = """\
# Speed

How long does a frame take, how much memory does a map need, and what helps on a robot? The table
has rows with a target; `docs/performance.json` has all rows, with quartiles and notes.

<!-- not run here: takes ten minutes -->
```bash
make bench                     # all parts; python -m bench --page-only writes this page again
```

"""
_HOW = """\
Times are medians. Two sides of a comparison are taken in turn in one process; *times faster* is
the median of the ratios. Images are drawn: a street by day is the map, the same street in the
evening the query. *Released script* is computed from its steps, restated here: it needs Python 2.
R is the number of places, G the number of salient regions.
"""
_ADVICE = """\
## What is approximated

| what | how | how to avoid it |
| --- | --- | --- |
| pair scores by 8-bit kernels | up to {int8} off; the best 8 candidates are scored again in \
float32 | `kernel: float32` or `numpy` |
| which places are scored | those with the best coarse scores | `search: exhaustive` |
| cells in a map | half precision | none is needed: answers are the same before and after saving |

## On a robot

* Install a C compiler (`apt install gcc`) before the package. `/diagnostics` names the kernel in
  use.
* Programs of your own around the core should set `OPENBLAS_NUM_THREADS=1`; `vpr_node` and
  `convseq` do. Threads of BLAS wait by spinning.
* `threads: 0` uses up to two cores. `taskset -c 3` keeps the node to one.
* Raw images go through shared memory if camera and node have
  `FASTRTPS_DEFAULT_PROFILES_FILE=config/fastdds_large_images.xml`.
* On AMD processors with AVX-512 and without a compiler, `OPENBLAS_CORETYPE=SKYLAKEX` saves about
  16 % of a frame.

Another computer: `make board` measures for some minutes and writes `board.json`. Please send it.
"""


def write_page(measured: Mapping[str, Any], docs: Path) -> None:
    """Write the document."""
    rows, about = measured['findings'], measured['about']
    parts = [_HEAD + _HOW, _machine(about), _markdown(row for row in rows if row['target'])]
    if absent := [name for name in PARTS if name not in {row['part'] for row in rows}]:
        parts.append(
            textwrap.fill(
                f'Not measured here: {", ".join(absent)}. `python -m bench {" ".join(absent)}` '
                'measures them.',
                99,
            )
            + '\n'
        )
    parts.append(_ADVICE.format(int8=_largest_error(rows)))
    computed = docs / 'performance_arm.json'
    if computed.exists():
        parts.append(section(json.loads(computed.read_text(encoding='utf-8'))))
    (docs / 'PERFORMANCE.md').write_text('\n'.join(parts), encoding='utf-8')


def _is_shown(row: Row) -> bool:
    """Return whether a row is for people: rows of the paper's scores by two threads are not."""
    return row['part'] != 'rows' or row['threads'] == 1


def _machine(about: Mapping[str, Any]) -> str:
    machine = about['machine']
    versions = ', '.join(f'{name} {version}' for name, version in about['versions'].items())
    text = (
        f'Measured {about["date"][:10]} on {machine["cpu"]}, {machine["cores"]} cores, '
        f'{number(machine["memory_gb"])} GB, kernels {machine["kernels"]}, load '
        f'{machine["load"]}; {versions}.'
    )
    return textwrap.fill(text, 99, break_on_hyphens=False) + '\n'


def _markdown(rows: Iterable[Row]) -> str:
    heads = list(COLUMNS[:-1])  # notes are in the JSON
    lines = [heads, ['---'] * len(heads), *(cells(row)[:-1] for row in rows)]
    return '\n'.join(f'| {" | ".join(line)} |' for line in lines) + '\n'


def _largest_error(rows: Iterable[Row]) -> str:
    errors = [
        float(row['note'].split()[1])
        for row in rows
        if row['side'] == 'int8 kernel' and row['note'].startswith('error ')
    ]
    return f'{max(errors):.0e}' if errors else 'an error not measured here'
