# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""docs/PERFORMANCE.md, from what was measured and nothing else."""

from collections.abc import Iterable, Mapping, Sequence
import json
from pathlib import Path
import textwrap
from typing import Any

from bench.arm import section
from bench.plot import draw_cost, draw_stages
from bench.table import cells, COLUMNS, number, Row

_PICTURE = 'cost_against_map_size.png'
_STAGES = 'frame_by_stage.png'
_TITLES = {
    'encoding': 'Encoding',
    'pairs': 'Pair scores',
    'rows': "The paper's row",
    'frames': 'A whole frame',
    'stages': 'A whole frame, stage by stage',
    'between': 'A frame between keyframes',
    'avx2': 'A whole frame without AVX-512',
    'sequence': 'The sequence stage',
    'memory': 'Maps: opening, memory, disk',
    'start': 'From the start to the first answer',
    'node': 'The live node',
    'drive': 'The live node on a drive',
}
_ABOUT = {
    'encoding': (
        'A gray image of 640 x 480, drawn, to cells, salient regions and entropy. *Released '
        'steps*: the same steps restated with OpenCV, NumPy and scikit-image; the histograms are '
        'summed by NumPy, as the compiled code of the script was not run.'
    ),
    'pairs': (
        'One query with G salient regions against one reference; the query is prepared, and so '
        'are references. *Tuned NumPy*: BLAS into an array that is there already, and arg maxima '
        'by comparison. *Released loop*: product, maximum and mean over all 961 regions, as the '
        'script does, whatever G. *Error*: the largest difference from the definition. A *peak* '
        'is what the machine multiplies when nothing else is done: `sgemm` of two large matrices, '
        'dot products of bytes that never leave registers. Coherent pairs are votes alone '
        '(`subtract_background: false`); normalised cells, background and global similarity cost '
        'some microseconds more, which is in the whole frames below.'
    ),
    'rows': 'One query against every reference, scores of the paper (`matching: regional`).',
    'frames': (
        'From gray image to answer, all stages, on one core, `matching: coherent`, k = 10. The '
        'released script describes its k frames again for every answer and repeats the row k '
        'times; its cost is **computed** from its steps, taken in turn with our frames: '
        'k x encoding + k x (R - k + 1) x pair. The first frames of a drive, which look at more '
        'places, do not count. *Right*: the best candidate lies within two references of the '
        'place that the image shows. Maps lie in the file cache.'
    ),
    'stages': (
        'Where the time goes, on average, on one core; what a stage calls of another counts there.'
    ),
    'between': (
        'Frames that are no keyframes, on a drive in the evening, from gray image to answer. By '
        'scene (`keyframe_overlap`), what a glance does not settle is described and compared.'
    ),
    'avx2': 'The same with the kernels of processors that have AVX2 and no more.',
    'sequence': "Sums of kept pair scores along diagonals, as the paper's decision has them.",
    'memory': (
        'In processes of their own, with default parameters; resident after {frames} frames.'
    ),
    'start': (
        'From the start of the process `vpr_node` to the first answer about an image; a camera is '
        'on before. Programs and map lie in the file cache. Fast DDS alone would take up to 3 s '
        'more in every second start: see config/fastdds_quick_start.xml, which the node sets for '
        'itself.'
    ),
    'node': (
        'The real `vpr_node` with default parameters in a process of its own; another process '
        'publishes bgr8 images and clocks the answers, both with the settings of '
        'config/fastdds_large_images.xml: from the call that publishes an image to the arrival of '
        '`~/candidates`, so both ways through DDS are in it. With one thread, the node has one '
        'core and the camera another. Here every frame is a keyframe, as the map has it.'
    ),
    'drive': (
        'The node as above, on a drive of 10 m/s at 30 Hz whose map says that there are at most 8 '
        'keyframes a second (`keyframe_interval_s: 0.125`); then beside programs that take what '
        'they get of every core.'
    ),
}
_HOW = """\
**How it was measured.** Medians; the sides of a comparison are taken in turn in one process, each
called once before it counts, and *times faster* is the median of the ratios, round by round.
Where there are two threads, a fifth of a second lies between two sides: BLAS's threads wait for
more work by spinning, and would take a core from the next side. Every part runs in a process of
its own with as many BLAS threads as the column says; whole frames have one, as the commands and
the node set it. Images are drawn (`convseq_ros/simulation`): a street by day is the map, the same
street in the evening the query. Maps of all sizes are written by the map's own writer from the
day's descriptors, lap by lap; every lap but one is varied at random until it is another street.
How often answers are right is another question:
[RESULTS.md](RESULTS.md) has it, from real images.

    make bench                                # everything, then this page
    python -m bench pairs frames              # some parts, table and JSON alone
    python -m bench --page-only               # the page again, from docs/performance.json
"""
_APPROXIMATE = """\
## What approximates

| what | how far off | what settles it |
| --- | --- | --- |
| 8-bit kernels (`kernel: int8`, what `auto` takes where the processor can) | {int8} | what is \
within 0.02 of the best candidate, 8 at most, is scored again in float32 before anything is \
published |
| float32 kernels | {float32} | nothing needs to |
| the shortlist (`search: shortlist`): references are scored only where a sequence may end that \
looks alike at coarse scores, by a reduced descriptor | what it does not list is not found: see \
[RESULTS.md](RESULTS.md) | `search: exhaustive` scores every reference |
| cells in half precision, in maps | {half} | a map answers alike before it was saved and after \
it was opened |

`kernel: numpy` with `search: exhaustive` approximates nothing. docs/RESULTS.md has the accuracy of
both ways of matching and both ways of searching on the real sequences.
"""
_BEFORE = """\
## Against the code before

The targets of frames were set on two machines, on which the code of 22 November's morning
(68e8c93, without geometry) took 14, 17 and 22 ms, and 19, 24 and 30 ms, at R = 1,000,
10,000 and 100,000. On the machine of this page, with both sides in turn, it takes 11.6, 15.0 and
20.2 ms: **this is the faster one**, and no target is to be multiplied by 1.4. Today's code, with
geometry and with 8, 10 and 18 % more pairs, takes 11.4, 15.2 and 21.9 ms there: .98, 1.01 and 1.09
times as much, the median of three rounds, round by round, on a busy machine at real-time priority.

    git clone . ../before && git -C ../before checkout 68e8c93     # it wants numba
    chrt -f 10 python -m bench.paired ../before --rounds 3

What was tried for the rest at R = 10,000, with the same answers: a memory of 2,000 or 4,000 places
instead of 1,000 spares 4 or 10 of the 40 that a frame prepares, as most are new, at no gain that
shows; tiles of 9 regions by 3 vectors are as fast as 12 by 2; the label that each product gets
costs 5 of 61 microseconds a pair, and no cheaper way to keep it was found. At R = 100,000, to have
the C library keep memory instead of giving it back (`MALLOC_TRIM_THRESHOLD_`) gains nothing.

What was tried for frames between keyframes by scene: most of them are passed over at a glance, the
rest is described, as the mean shows. No other copy told better which frames lie between than edges
of 64 x 48: levels of 32 x 24 to 128 x 96, edges of 32 x 24 to 256 x 192, histograms of cells.
"""
_ADVICE = """\
## On a robot

* `OPENBLAS_NUM_THREADS=1`, also around a program of your own: threads of BLAS wait for each other
  by spinning, and take what they wait with from everybody else. `vpr_node` and `convseq` set it
  for themselves if it is not set.
* Install a C compiler (`apt install gcc`) before the package; `ros2 topic echo /diagnostics` tells
  the kernel that is in use. Without one everything works, more slowly. On AMD processors with
  AVX-512, `OPENBLAS_CORETYPE=SKYLAKEX` then takes a frame from 49 to 41 ms here: OpenBLAS takes
  them for older ones (`CONVSEQ_KERNELS=numpy python -m bench frames --sizes 1000`).
* `threads: 0` takes the cores that the process may use, two at most; *pair scores* and *the
  paper's row* show what the second one is worth. `taskset -c 3` keeps the node to one.
* Give camera and node `FASTRTPS_DEFAULT_PROFILES_FILE=config/fastdds_large_images.xml`: raw images
  then go through shared memory.
* `search: shortlist` is the default; the cost of `exhaustive`, the paper's, grows with the map as
  the picture shows.

## Limits

* Coarse scores take one short product for every place. Above about a million places that alone
  would fill a frame's time: share the map among machines, as [a fleet](FLEET.md) does.
* Measured on one machine. Its instructions are named above; ARM is computed, not measured, and a
  processor older than AVX2 has no compiled kernels.
* The released script was not run: it needs Python 2. Its steps were restated and timed here.
"""


def write_page(measured: Mapping[str, Any], docs: Path) -> None:
    """Write the document, and the picture into its folder of images."""
    rows = measured['findings']
    frames = [row for row in rows if row['part'] == 'frames']
    drawn = draw_cost(frames, docs / 'images' / _PICTURE)
    parts = [
        '# Performance\n',
        'Written by `make bench`; do not edit.\n',
        _machine(measured['about']),
        _HOW,
        '## Targets\n',
        _markdown([row for row in rows if row['target']]),
    ]
    if drawn:
        parts.append(f'![What a frame costs against the size of the map](images/{_PICTURE})\n')
    for name, title in _TITLES.items():
        own = [row for row in rows if row['part'] == name]
        if own:
            about = _ABOUT[name].format(frames=measured['about']['frames'])
            parts += [f'## {title}\n', _wrapped(about), _markdown(own)]
        if name == 'stages' and draw_stages(own, docs / 'images' / _STAGES):
            parts.append(
                f'![A frame by its stages, for maps of several sizes](images/{_STAGES})\n'
            )
    parts.append(
        _APPROXIMATE.format(
            int8=_errors(rows, 'int8'), float32=_errors(rows, 'float32'), half=_rounding(rows)
        )
    )
    computed = docs / 'performance_arm.json'
    if computed.exists():
        parts.append(section(json.loads(computed.read_text(encoding='utf-8'))))
    parts += [_BEFORE, _ADVICE]
    text = '\n'.join(parts)
    (docs / 'PERFORMANCE.md').write_text(text, encoding='utf-8')


def _machine(about: Mapping[str, Any]) -> str:
    machine = about['machine']
    versions = ', '.join(f'{name} {version}' for name, version in about['versions'].items())
    return _wrapped(
        f'{about["date"][:10]}, {machine["cpu"]}, {machine["cores"]} cores, '
        f'{number(machine["memory_gb"])} GB; kernels: {machine["kernels"]}; '
        f'{versions}; BLAS: {machine["blas"]}. It took '
        f'{about["seconds"] / 60:.0f} minutes; load before it started: {machine["load"]}.'
    )


def _markdown(rows: Iterable[Row]) -> str:
    """Return findings as a table; columns that are empty throughout are left out."""
    lines = [cells(row) for row in rows]
    used = [place for place in range(len(COLUMNS)) if any(line[place] for line in lines)]
    heads = [COLUMNS[place] for place in used]
    body = [[line[place] for place in used] for line in lines]
    return (
        '\n'.join(f'| {" | ".join(line)} |' for line in [heads, ['---'] * len(heads), *body])
        + '\n'
    )


def _errors(rows: Sequence[Row], kernel: str) -> str:
    """Return the largest errors of a kernel's pair scores, by the way of matching."""
    found: dict[str, float] = {}
    for row in rows:
        if row['side'] == f'{kernel} kernel' and row['note'].startswith('error '):
            matching = row['what'].partition(' ')[0]
            error = float(row['note'].split()[1])
            found[matching] = max(error, found.get(matching, 0.0))
    return _largest({f'{matching} scores': error for matching, error in found.items()})


def _rounding(rows: Sequence[Row]) -> str:
    stored = [row for row in rows if row['unit'] == 'largest difference']
    return _largest({row['side']: row['value'] for row in stored})


def _largest(errors: Mapping[str, float]) -> str:
    told = ', '.join(f'{error:.0e} in {scores}' for scores, error in errors.items())
    return f'{told}: the largest of the pairs above' if told else 'not measured here'


def _wrapped(text: str, width: int = 99) -> str:
    return textwrap.fill(text, width) + '\n'
