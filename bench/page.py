# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Writes docs/PERFORMANCE.md, the main figures; performance.json has all of them."""

from collections.abc import Iterable, Mapping
import json
from pathlib import Path
import textwrap
from typing import Any

from convseq_ros.evaluation.provenance import short

from bench.arm import section
from bench.finding import cells, number, Row, table
from bench.part import PARTS
from bench.parts import between

# Integer peak of one core in GOP/s and clock in GHz, from instruction sets and data sheets; the
# processor of 2021 was measured by this benchmark, with the products of its current kernels.
ROBOTS = {
    'Jetson Orin (Cortex-A78AE)': (141.0, 2.2),
    'Raspberry Pi 5 (Cortex-A76)': (154.0, 2.4),
    'AVX2 without VNNI (Zen 3 of 2021)': (163.0, 3.2),
    'AVX-VNNI (laptops since 2021)': (500.0, 3.5),
}
_KEYFRAMES_HZ, _RATE_HZ = 8, 30
_HEAD = """\
# Speed

How long does a frame take, also on a robot's processor, and how much memory does a map need?
`docs/performance.json` has all that was measured, with quartiles.

<!-- not run here: takes ten minutes -->
```bash
make bench                     # measure, and write this page
make board                     # two minutes: the first table for the machine at hand
```

"""
_SPLIT = """
The share of a core is that of a camera of 30 Hz with 8 keyframes a second. All but this machine is
*computed*: pair scores scale with the integer peak, the rest with the clock. A core that does less
in a cycle takes longer.
"""
_BESIDE = 'performance_beside.json'  # what frames took at earlier commits
_MILLION = 1_000_000
_ADVICE = """
## On a robot

* `/diagnostics` names the kernel in use.
* Programs of your own around the core should set `OPENBLAS_NUM_THREADS=1` and
  `OPENCV_FOR_THREADS_NUM=1`, as `vpr_node` and `convseq` do.
* `taskset -c 3` keeps the node to one core.
* Raw images are [delivered](TOPICS.md#delivery-of-images) by shared memory.

`make board` writes `board.json`. Please send it.
"""


def write_page(measured: Mapping[str, Any], docs: Path) -> None:
    """Write the document."""
    rows = measured['findings']
    parts = [_HEAD + _machine(measured), table(robots(measured)), _SPLIT, table(stages(rows))]
    if (docs / _BESIDE).exists():
        parts.append(beside(rows, json.loads((docs / _BESIDE).read_text(encoding='utf-8'))))
    parts += [table(main(rows)), of_a_city(rows)]
    if absent := [name for name in PARTS if name not in {row['part'] for row in rows}]:
        parts.append(f'Not measured here: {", ".join(absent)}.\n')
    parts.append(_ADVICE)
    computed = docs / 'performance_arm.json'
    if computed.exists():
        parts.append(section(json.loads(computed.read_text(encoding='utf-8'))))
    (docs / 'PERFORMANCE.md').write_text('\n'.join(parts), encoding='utf-8')


def write_earlier(paths: Iterable[Path], docs: Path) -> None:
    """Keep what the JSON files of earlier commits say of frames."""
    kept = []
    for path in paths:
        measured = json.loads(path.read_text(encoding='utf-8'))
        commit = short(measured['about']['commit'])
        kept.append({'commit': commit, 'frames': _frames(measured['findings'])})
    (docs / _BESIDE).write_text(json.dumps(kept, indent=1) + '\n', encoding='utf-8')


def beside(rows: Iterable[Row], earlier: Iterable[Mapping[str, Any]]) -> str:
    """Return what frames of all sizes took at earlier commits."""
    now, told = _frames(rows), []
    for one in earlier:
        times = (one['frames'].get(what) for what in now)
        text = ', '.join('-' if time is None else number(time) for time in times)
        told.append(f'{text} ms at {one["commit"]}')
    return f'The same frames took {", and ".join(told)}.\n'


def stages(rows: Iterable[Row]) -> list[list[str]]:
    """Return a table of where the time of a frame goes, in a map of middle size, head first."""
    by_size = dict[str, dict[str, float]]()
    for row in rows:
        what, _, kind = row['what'].rpartition(', ')
        if kind == 'by stage' and is_main(row):
            by_size.setdefault(what, {})[row['side']] = row['value']
    if not by_size:
        return []
    what, took_ms = [*by_size.items()][len(by_size) // 2]
    return [['stage', f'{what}, ms'], *([name, number(ms)] for name, ms in took_ms.items())]


def main(rows: Iterable[Row]) -> list[list[str]]:
    """Return a table of the main figures, those that have a target, head first."""
    by_what = dict[str, list[str]]()
    for row in rows:
        aimed = row['most'] is not None or row['least'] is not None
        # Frames are told above; other kernels and threads repeat these.
        if aimed and row['part'] != 'frames' and is_main(row):
            what, side, _, measured, *_ = cells(row)
            by_what.setdefault(what, []).append(f'{side}: {measured}')
    return [['what', 'measured'], *([what, '; '.join(told)] for what, told in by_what.items())]


def _frames(rows: Iterable[Row]) -> dict[str, float]:
    return {
        row['what']: row['value']
        for row in rows
        if row['part'] == 'frames' and row['side'] == 'whole' and is_main(row)
    }


def is_main(row: Row) -> bool:
    """Return whether a row is of the best kernels, on one core."""
    return not row['kernels'] and row['threads'] == 1


def robots(measured: Mapping[str, Any]) -> list[list[str]]:
    """Return a table of times of frames, here and computed for robots, head first."""
    rows = [row for row in measured['findings'] if not row['kernels']]
    frames = [row for row in rows if row['part'] == 'frames' and row['side'] == 'whole']
    by_side = {(row['what'], row['side']): row['value'] for row in rows}
    here = (_value(rows, 'peak of a core, int8') or 0.0, measured['about']['machine']['clock_ghz'])
    sizes = [row['what'].rpartition('= ')[2] for row in frames]
    lines = [['processor class', 'GOP/s', 'GHz', *(f'R = {size}' for size in sizes)]]
    idle_ms = _value(rows, 'between', between.BY_SCENE) or 0.0
    machines = {'this machine': here} | ROBOTS
    for name, (peak, clock) in machines.items() if all(here) else ():
        times = []
        for row in frames:
            by_peak = by_side[row['what'], 'scales with the integer peak'] * here[0] / peak
            slower = here[1] / clock
            frame_ms = by_peak + by_side[row['what'], 'scales with the clock'] * slower
            rest_ms = (_RATE_HZ - _KEYFRAMES_HZ) * idle_ms * slower
            percent = (_KEYFRAMES_HZ * frame_ms + rest_ms) / 10
            times.append(f'{number(frame_ms)} ms, {percent:.0f} %')
        lines.append([name, number(peak), number(clock), *times])
    return lines


def of_a_city(rows: Iterable[Row]) -> str:
    """Return what a map of a million places would take, along a line through the largest two."""
    told = []
    for what, side, name in (
        ('frame, R = ', 'whole', 'a frame'),
        ('map, R = ', 'resident', 'resident'),
        ('map, R = ', 'open', 'to open'),
    ):
        found = [
            (int(row['what'].removeprefix(what).replace(',', '')), row)
            for row in rows
            if row['what'].startswith(what) and row['side'] == side and not row['kernels']
        ]
        if len(found) < 2 or not all(row['value'] for _, row in found):
            return ''
        (few, before), (many, last) = found[-2:]
        slope = (last['value'] - before['value']) / (many - few)
        value = last['value'] + slope * (_MILLION - many)
        told.append(f'{name} {number(value)} {last["unit"]}')
    computed = (
        f'A city of a million places, computed from the two largest maps: {", ".join(told)}.'
    )
    return textwrap.fill(computed, 99, break_on_hyphens=False) + '\n'


def _value(rows: Iterable[Row], what: str, side: str = '') -> float | None:
    values = (row['value'] for row in rows if what in row['what'] and side in row['side'])
    return next(values, None)


def _text(value: float | None, unit: str) -> str:
    return 'not computed' if value is None else number(value) + unit


def _machine(measured: Mapping[str, Any]) -> str:
    about, rows = measured['about'], measured['findings']
    machine = about['machine']
    versions = ', '.join(f'{name} {version}' for name, version in about['versions'].items())
    peaks = ', '.join(
        f'{number(row["value"])} {row["unit"]}'
        for row in rows
        if row['what'].startswith('peak') and not row['kernels'] and row['value']
    )
    clock = _text(machine['clock_ghz'], ' GHz')
    text = (
        f'Measured {about["date"][:10]} at {short(about["commit"])} on {machine["cpu"]}, '
        f'{machine["cores"]} cores, clock {clock}, '
        f'peak of one core {peaks or "not measured"}, {number(machine["memory_gb"])} GB, '
        f'kernels {machine["kernels"]}, load {machine["load"]}; {versions}. Times of frames are '
        'medians of the processor time on one core, on a drawn street by day (map) and in the '
        'evening (query). R is the number of places.'
    )
    return textwrap.fill(text, 99, break_on_hyphens=False) + '\n'
