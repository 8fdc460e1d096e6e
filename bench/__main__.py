# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Measure, print tables, and write them as JSON: `python -m bench [PART ...]`, from the repository.

With --page, docs/PERFORMANCE.md is written too, from JSON files alone.
"""

import argparse
from collections.abc import Sequence
import json
from pathlib import Path
import sys
import tempfile
import time

from bench.finding import cells, COLUMNS, table
from bench.machine import described
from bench.material import Work
from bench.page import robots, write_earlier, write_page
from bench.part import PARTS, run

SIZES = 1_000, 10_000, 100_000
_QUICK_SIZES = (48,)
_FRAMES, _QUICK_FRAMES = 120, 22


def main(arguments: Sequence[str] | None = None) -> int:
    """Measure the chosen parts."""
    chosen = _parser().parse_args(arguments)
    if not chosen.page_only:
        with tempfile.TemporaryDirectory(prefix='convseq_bench_') as folder:
            _measure(chosen, chosen.folder or Path(folder))
    if chosen.beside:
        write_earlier(chosen.beside, chosen.docs)
    if chosen.page or chosen.page_only:
        write_page(json.loads(chosen.json.read_text(encoding='utf-8')), chosen.docs)
    return 0


def _measure(chosen: argparse.Namespace, folder: Path) -> None:
    folder.mkdir(parents=True, exist_ok=True)
    sizes = tuple(chosen.sizes or (_QUICK_SIZES if chosen.quick else SIZES))
    start_s = time.monotonic()
    about = described()
    _show(f'drawing a street and writing maps of {", ".join(f"{size:,}" for size in sizes)}')
    about['frames'] = _QUICK_FRAMES if chosen.quick else _FRAMES
    Work(folder, sizes).prepare(about['frames'])
    findings = []
    for name in chosen.parts or PARTS:
        for setting in PARTS[name]:
            if chosen.quick and setting.threads != PARTS[name][0].threads:
                continue
            if chosen.best_kernels and setting.kernels:
                continue
            _show(f'{name}, {setting.threads} threads{setting.kernels and f", {setting.kernels}"}')
            findings += run(name, setting, folder, sizes, chosen.quick)
    about['seconds'] = round(time.monotonic() - start_s)
    about['parts'] = list(chosen.parts or PARTS)
    chosen.json.parent.mkdir(parents=True, exist_ok=True)
    lines = ',\n'.join(json.dumps(finding) for finding in findings)
    text = f'{{"about": {json.dumps(about)},\n"findings": [\n{lines}\n]}}\n'
    chosen.json.write_text(text, encoding='utf-8')
    print(table([[*COLUMNS], *map(cells, findings)]))
    print(f'\n{table(robots({"about": about, "findings": findings}))}')


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        allow_abbrev=False, prog='bench', description=__doc__.splitlines()[1]
    )
    parser.add_argument('parts', nargs='*', metavar='PART', help=f'of {", ".join(PARTS)} (all)')
    parser.add_argument('--quick', action='store_true', help='tiny: only checks that it runs')
    parser.add_argument('--sizes', type=int, nargs='+', help='references of the maps')
    parser.add_argument('--folder', type=Path, help='keep and reuse maps in this folder')
    parser.add_argument('--json', type=Path, default=Path('docs/performance.json'))
    parser.add_argument('--docs', type=Path, default=Path('docs'), help='folder of the page')
    parser.add_argument('--best-kernels', action='store_true', help='only the best kernels')
    parser.add_argument('--page', action='store_true', help='also write the page')
    beside = 'of earlier commits, on this machine: the page has frames beside theirs'
    parser.add_argument('--beside', type=Path, nargs='+', metavar='JSON', help=beside)
    parser.add_argument('--page-only', action='store_true', help='only write the page anew')
    return parser


def _show(text: str) -> None:
    print(f'bench: {text}', file=sys.stderr, flush=True)


if __name__ == '__main__':
    raise SystemExit(main())
