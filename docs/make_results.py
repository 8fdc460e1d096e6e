# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Measure, and write the tables of docs/RESULTS.md: `python docs/make_results.py --data-root DATA`.

Only what stands between two comments of the page is replaced. Sets whose images are not there are
left out. Everything measured stays in the run folder, with a page of it.
"""

import argparse
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path

from convseq_ros.cli import main as convseq
from convseq_ros.config.reading_config import ReadingConfig
from convseq_ros.errors import ConvseqError
from convseq_ros.evaluation.data_set import DataSet, open_data_set, ready_made
from convseq_ros.evaluation.provenance import short
from convseq_ros.evaluation.run_folder import read_summaries
from convseq_ros.evaluation.scorecard import Summary
from convseq_ros.io.regular_file import write_text

BEGIN, END = '<!-- written by make results -->', '<!-- end of what make results writes -->'
OURS = 'ours'
METHODS = {
    OURS: ('**ours**, sequences', 'convseq'),
    'single': ('**ours**, single images', 'single'),
    'paper': ("the paper's method, sequences", 'paper'),
    'cohog': ("CoHOG: the paper's pair score, single images", 'cohog'),
    'seqslam': ('SeqSLAM', 'seqslam'),
    'hog': ('HOG, single images', 'hog'),
}
_MEANS = 'said', 'right'
_PUBLISHED = 'vprbench-'
LONG = 'street_hour'  # 3,600 frames: only when it is named
OPPOSITE = 'gardens_point_right_left'  # the direction in which others measure: best answers only


def main(arguments: Sequence[str] | None = None) -> int:
    """Measure and write; 0 when done, 1 if a part could not be measured."""
    parser = argparse.ArgumentParser(allow_abbrev=False, description=__doc__.splitlines()[1])
    parser.add_argument('sets', nargs='*', help='data sets (all whose images are there)')
    parser.add_argument('--data-root', type=Path, default=Path('../shared/data'))
    parser.add_argument('--results', type=Path, default=Path('docs/results'), help='run folder')
    parser.add_argument('--output', type=Path, default=Path('docs/RESULTS.md'))
    chosen = parser.parse_args(arguments)
    names = chosen.sets or [name for name in ready_made() if name != LONG]
    sets = {name: open_data_set(name, chosen.data_root) for name in names}
    there = [name for name, one in sets.items() if _is_there(one)]
    real = [name for name in there if not sets[name].query.simulated]
    decided = [name for name in there if name != OPPOSITE]
    if not there:
        raise ConvseqError(f'{chosen.data_root}: holds none of the data sets')

    def evaluate(folder: str, sets: Iterable[str], methods: Iterable[str], *more: str) -> int:
        asked = [part for method in methods for part in ('--method', method)]
        where = '--data-root', str(chosen.data_root), '--output', str(chosen.results / folder)
        return convseq(['evaluate', *sets, *asked, *more, *where]) if sets else 0

    every = [f'{kind} label={label}' for label, (_, kind) in METHODS.items()]
    protocols = '--protocol', 'open', '--protocol', 'past'
    if evaluate('closed', real, [*every, 'published']) or evaluate(
        'open', decided, every[:1], *protocols
    ):
        return 1
    before, _, rest = chosen.output.read_text(encoding='utf-8').partition(BEGIN)
    drawn = [sets[name].name for name in there if name not in real]
    parts = [before + BEGIN, *_tables(chosen.results, drawn), END + rest.partition(END)[2]]
    write_text(chosen.output, '\n\n'.join(parts))
    return 0


def _is_there(data_set: DataSet) -> bool:
    paths = [data_set.query.path, data_set.truth.path]
    paths += [data_set.reference.path] if data_set.reference else []
    return all(path.exists() for path in paths if path)


def _read(folder: Path) -> list[Summary]:
    return read_summaries([folder], ReadingConfig())


def _tables(results: Path, drawn: Sequence[str]) -> Iterable[str]:
    decided = _read(results / 'open')
    first = decided[0]
    versions = ', '.join(f'{name} {version}' for name, version in first['versions'].items())
    commit = short(first['commit'])
    yield f'Measured {first["date"][:10]} at {commit} on {first["machine"]["cpu"]}; {versions}.'
    if (results / 'closed').exists():
        yield '### Best answers'
        yield from _accuracy(_read(results / 'closed'))
    yield '### Accepted matches'
    shown = [run for run in decided if run['known']]
    yield _table(
        ('set', 'known', 'right', 'slips', 'false', 'first right match after'),
        (
            [
                'drawn: ' * run['set'].startswith(tuple(drawn)) + run['set'],
                *_counts([run]),
                _first(run),
            ]
            for run in shown
        ),
    )
    alone = [run for run in decided if not run['known']]
    if alone:
        frames, false = (sum(run[key] for run in alone) for key in ('queries', 'false_closures'))
        yield (
            f'Drives that revisit nothing, each against its own past (`--protocol past`): {false} '
            f'false matches in {frames:,} frames of {len(alone)} drives.'
        )
    yield '### Confidence'
    rows = pooled([told['as_shipped'] for run in decided if (told := run['calibration'])])
    yield _table(
        ('confidence', 'frames', 'mean confidence, %', 'best place is right, %'),
        (
            (
                f'{row["low"]:g} to {row["high"]:g}',
                f'{row["count"]:,}',
                _percent(row['said']),
                _percent(row['right']),
            )
            for row in rows
        ),
    )


def pooled(tables: Iterable[Sequence[Mapping[str, float]]]) -> list[dict[str, float]]:
    """Return one reliability table of several, range by range."""
    rows: dict[float, list[Mapping[str, float]]] = {}
    for table in tables:
        for row in table:
            rows.setdefault(row['low'], []).append(row)
    together = []
    for low, own in sorted(rows.items()):
        count = sum(row['count'] for row in own)
        means = {name: sum(row['count'] * row[name] for row in own) / count for name in _MEANS}
        together.append({'low': low, 'high': own[0]['high'], 'count': count, **means})
    return together


def _accuracy(runs: Sequence[Summary]) -> Iterable[str]:
    """Yield a table of methods by sets, and what published scores come to, single images."""
    sets = dict.fromkeys(run['set'] for run in runs)
    of = {(run['set'], run['method']): run for run in runs}
    used = [name for name in METHODS if any((one, name) in of for one in sets)]
    rows = (
        [METHODS[name][0], *(_right(of[one, name]) if (one, name) in of else '' for one in sets)]
        for name in used
    )
    known = {run['set']: run['known'] for run in runs}
    heads = (f'{one}, of {known[one]}' for one in sets)
    yield _table(('% right (95 % interval)', *heads), rows)
    for one in sets:
        shares = ', '.join(
            f'{name.removeprefix(_PUBLISHED)} {_percent(run["accuracy_all"])}'
            for (place, name), run in of.items()
            if place == one
            and name.startswith(_PUBLISHED)
            and not name.endswith(('-dynamic', '-k10'))
        )
        if shares:
            yield f'By scores that VPR-Bench published of {one}, single images, % right: {shares}.'


def _right(told: Summary) -> str:
    low, high = told.get('accuracy_all_low'), told.get('accuracy_all_high')
    share = _percent(told['accuracy_all'])
    return f'{share} ({_percent(low)}-{_percent(high)})'


def _counts(runs: Iterable[Summary]) -> list[str]:
    keys = 'known', 'accepted_right', 'slips', 'false_closures'
    return [f'{sum(run[key] for run in runs):,}' for key in keys]


def _first(run: Summary) -> str:
    frames = run.get('frames_to_first_closure') or {}
    return ', '.join('-' if one is None else str(one) for one in frames.values()) or '-'


def _percent(share: float | None) -> str:
    """Return a number for a column that says `%`."""
    return '?' if share is None else f'{100 * share:.1f}'


def _table(columns: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    lines = [columns, ['---'] * len(columns), *rows]
    return '\n'.join(f'| {" | ".join(line)} |' for line in lines)


if __name__ == '__main__':
    raise SystemExit(main())
