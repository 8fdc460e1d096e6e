# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Measure, and write docs/RESULTS.md: `python docs/make_results.py --data-root ../shared/data`.

Sets whose images are not there are named with where they belong. Everything measured stays in
the run folder (docs/results by default), from which `convseq report` makes a page.
"""

import argparse
from collections.abc import Iterable, Mapping, Sequence
import csv
import json
from pathlib import Path
from typing import Any

from convseq_ros.cli import main as convseq
from convseq_ros.errors import ConvseqError
from convseq_ros.evaluation.agreement import agreement
from convseq_ros.evaluation.calibration import pooled
from convseq_ros.evaluation.data_set import DataSet, open_data_set, ready_made
from convseq_ros.evaluation.run_folder import read_run, Run, write_text
from results_texts import AGREEMENT, DECISIONS, ONE_LINE, READING, RELIABILITY, UNKNOWN

METHODS = {
    'coherent': 'coherent=convseq',
    'coherent-exhaustive': 'coherent-exhaustive=convseq+search=exhaustive',
    'coherent-k10': 'coherent-k10=convseq-k10',
    'coherent-k10-exhaustive': 'coherent-k10-exhaustive=convseq-k10+search=exhaustive',
    'coherent-k1': 'coherent-k1=convseq-k1',
    'coherent-k1-exhaustive': 'coherent-k1-exhaustive=convseq-k1+search=exhaustive',
    'background-kept': 'background-kept=convseq+subtract_background=false',
    'background-kept-k1-exhaustive': (
        'background-kept-k1-exhaustive=convseq-k1+search=exhaustive+subtract_background=false'
    ),
    'regional': 'regional=convseq+matching=regional+search=exhaustive',
    'regional-k10': 'regional-k10=convseq-k10+matching=regional+search=exhaustive',
    'convseq-forward': 'convseq-forward',
    'cohog': 'cohog',
    'seqslam': 'seqslam',
    'hog': 'hog',
}
SHIPPED = 'coherent=convseq'
LISTED = ('30', '50', '80')
DECIDING = (
    SHIPPED,
    'whole_rows=convseq+search=exhaustive',
    *(f'listed_{number}=convseq+search=shortlist+shortlist_length={number}' for number in LISTED),
)
STUDIES = (
    'k_ablation',
    'thresholds',
    'speed',
    'dropped_frames',
    'stops',
    'image_size',
    'appearance',
)
QUICK_STUDIES = STUDIES[:5]
LONG = 'street_hour'
FIGURES = {
    'method': 'method',
    'accuracy_matched': 'right, of matched',
    'interval': '95 %',
    'accuracy_all': 'right, of all',
    'auc_pr': 'AUC-PR',
    'recall_at_100_precision': 'R at 100 % P',
    'recall_at_5': 'R@5',
    'mean_k': 'mean k',
    'encode_ms': 't_e, ms',
    'frame_ms': 'frame, ms',
    'pcu': 'PCU',
}
OPEN_FIGURES = {
    'method': 'method',
    'known': 'knowable',
    'recall_at_100_precision': 'R at 100 % P, margin',
    'accepted_right': 'accepted, right',
    'false_closures': 'false',
    'slips': 'slips',
    'transferred_recall': 'recall',
    'transferred_false_closures': 'false ',
    'transferred_slips': 'slips ',
}
DECISION_FIGURES = {
    'known': 'known',
    'in_reach': 'in reach',
    'accepted_right': 'right',
    'accepted_recall_in_reach': 'recall',
    'accepted_recall': 'of all known',
    'slips': 'slips',
    'false_closures': 'false',
    'pairs_per_frame': 'pairs a frame',
}
STUDY_FIGURES = ('accuracy_matched', 'accuracy_all', 'matched', 'mean_k', 'k_distribution')


def main(arguments: Sequence[str] | None = None) -> int:
    """Measure and write; 0 when done, 1 if a part could not be measured."""
    chosen = _parser().parse_args(arguments)
    there, drawn, absent = _sort_out([*ready_made(), *chosen.set], chosen.data_root)
    long = [name for name in drawn if name == LONG]
    short = [name for name in drawn if name != LONG]

    def evaluate(folder: str, *arguments: str) -> int:
        output = str(chosen.results / folder)
        return convseq(
            ['evaluate', *arguments, '--data-root', str(chosen.data_root), '--output', output]
        )

    steps = [
        (
            '.',
            *there,
            *_methods(*METHODS.values(), 'published'),
            '--protocol',
            'closed',
            '--protocol',
            'open',
            '--threshold-from-others',
        ),
        (
            'decisions',
            *there,
            *short,
            *_methods(*DECIDING),
            '--protocol',
            'open',
            '--protocol',
            'past',
        ),
        ('long', *long, *_methods(SHIPPED)),
        *(('.', '--study', study) for study in chosen.study),
    ]
    if any(evaluate(*step) for step in steps):
        return 1
    write_text(chosen.output, page(chosen.results, chosen.study, absent))
    return 0


def _methods(*texts: str) -> list[str]:
    return [part for text in texts for part in ('--method', text)]


def page(results: Path, studies: Iterable[str], absent: Mapping[str, str]) -> str:
    """Return the document."""
    runs = [{**run.summary, 'about': run.about_set()} for run in read_run(results)]
    first = runs[0]
    versions = ', '.join(f'{name} {version}' for name, version in first['versions'].items())
    machine = first['machine']
    parts = [
        '# Results\n',
        'Written by `make results`; do not edit.\n',
        f'{first["date"][:10]}, {machine["cpu"]} ({machine["cores"]} cores), {versions}.\n',
        READING,
        _table(['method', 'what it is'], ONE_LINE.items()),
        *_decisions(results),
    ]
    for name in dict.fromkeys(run['set'] for run in runs):
        own = _ordered([run for run in runs if run['set'] == name])
        about = own[0]['about']
        parts.append(f'## {about.get("title") or name}\n')
        parts.append(_about(about))
        figures = OPEN_FIGURES if about['protocol'] == 'open' else FIGURES
        if about['protocol'] == 'open':
            parts.append(
                'The first, the last and the middle half of the map kept in turn. Columns 3 to 6 '
                'at the shipped decision, the last three with a threshold on the score that only '
                'other places gave.\n'
            )
        parts.append(
            _table(figures.values(), ([_cell(run, key) for key in figures] for run in own))
        )
    for study in studies:
        parts += _study(results, study)
    parts.append(UNKNOWN)
    if absent:
        parts.append('## Sets that were not measured here\n')
        parts.append(_table(['set', 'what is missing'], absent.items()))
    return '\n'.join(parts)


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[1])
    parser.add_argument('--data-root', type=Path, default=Path('../shared/data'))
    parser.add_argument('--set', action='append', default=[], help='a further data set, YAML')
    parser.add_argument('--results', type=Path, default=Path('docs/results'), help='run folder')
    parser.add_argument('--output', type=Path, default=Path('docs/RESULTS.md'))
    parser.add_argument(
        '--study',
        nargs='*',
        choices=STUDIES,
        default=QUICK_STUDIES,
        help='studies to run (all but image_size and appearance, which take longer)',
    )
    return parser


def _sort_out(
    names: Iterable[str], data_root: Path
) -> tuple[list[str], list[str], dict[str, str]]:
    """Return the sets whose images are there, those that are drawn, and what others lack."""
    there, drawn, absent = [], [], {}
    for name in names:
        data_set = open_data_set(name, data_root)
        missing = _missing(data_set)
        if data_set.query.simulated:
            drawn.append(name)
        elif missing:
            absent[data_set.name] = f'{missing}; {data_set.source}'
        else:
            there.append(name)
    if not there:
        raise ConvseqError(f'{data_root}: holds none of the data sets')
    return there, drawn, absent


def _decisions(results: Path) -> Iterable[str]:
    runs = read_run(results / 'decisions')
    names = list(dict.fromkeys(run.set for run in runs))
    of = {(run.set, run.method): run for run in runs}
    shipped = [of[name, 'coherent'] for name in names] + read_run(results / 'long')
    yield DECISIONS
    yield _table(
        ['set', *DECISION_FIGURES.values()],
        ([run.set, *(_cell(run.summary, key) for key in DECISION_FIGURES)] for run in shipped),
    )
    yield AGREEMENT
    others = [f'listed_{number}' for number in LISTED]
    yield _table(
        ['set', *(f'{number} references' for number in LISTED)],
        (
            [
                name,
                *(f'{agreement(of[name, "whole_rows"], of[name, other]):.3f}' for other in others),
            ]
            for name in names
        ),
    )
    yield _table(
        ['references', 'recall', 'slips', 'false', 'pairs a frame'],
        (
            [label, *_sum([of[name, other] for name in names])]
            for label, other in zip((*LISTED, 'all'), (*others, 'whole_rows'), strict=True)
        ),
    )
    yield RELIABILITY
    told = [run.summary['calibration'] or {} for run in shipped]
    for heading, key in (('As shipped:\n', 'as_shipped'), ('From other places:\n', 'from_others')):
        yield heading
        rows = pooled([one[key] for one in told if one.get(key)])
        yield _table(
            ['confidence', 'frames', 'mean confidence', 'right'],
            (
                [
                    f'{row["low"]:g} to {row["high"]:g}',
                    str(row['count']),
                    f'{row["said"]:.3f}',
                    f'{row["right"]:.3f}',
                ]
                for row in rows
            ),
        )


def _sum(runs: Iterable[Run]) -> list[str]:
    """Return figures over all sets: recall in reach, slips, false ones, pairs."""
    all_of = [run.summary for run in runs]
    reach = sum(one['in_reach'] for one in all_of)
    found = sum((one['accepted_recall_in_reach'] or 0.0) * one['in_reach'] for one in all_of)
    frames = sum(one['queries'] for one in all_of)
    pairs = sum(one['pairs_per_frame'] * one['queries'] for one in all_of)
    return [
        f'{found / reach:.3f}',
        str(sum(one['slips'] for one in all_of)),
        str(sum(one['false_closures'] for one in all_of)),
        f'{pairs / frames:.0f}',
    ]


def _missing(data_set: DataSet) -> str:
    paths = [data_set.query.path, data_set.truth.path]
    paths += [data_set.reference.path] if data_set.reference else []
    return next((f'`{path.name}`' for path in paths if path and not path.exists()), '')


def _ordered(runs: list[dict[str, Any]]) -> list[dict[str, Any]]:
    order = list(METHODS)
    return sorted(
        runs,
        key=lambda run: (
            order.index(run['method']) if run['method'] in order else len(order),
            run['method'],
        ),
    )


def _about(about: Mapping[str, Any]) -> str:
    size = f'{about["queries"]} queries, {about["references"]} references'
    if about['protocol'] == 'online':
        size = (
            f'{about["queries"]} frames against their own past, the latest '
            f'{about["exclude_recent"]} excluded'
        )
    within = f'within {about["radius_m"]} m' if about['radius_m'] else f'+-{about["tolerance"]}'
    if about['truth'] == 'table' and not about['tolerance']:
        within = 'tolerances as in the table'
    return f'{size}; truth: {about["truth"]}, {within}.\n'


def _cell(run: Mapping[str, Any], key: str) -> str:
    if key == 'interval':
        low, high = run.get('accuracy_matched_low'), run.get('accuracy_matched_high')
        return '-' if low is None else f'{low:.2f}-{high:.2f}'
    if key.startswith('transferred_'):
        return _text((run.get('transferred') or {}).get(key.removeprefix('transferred_')))
    if key == 'recall_at_100_precision' and run['protocol'] == 'open':
        return _text(run['recall_at_100_precision_by'].get('margin'))
    return _text(run.get(key))


def _study(results: Path, name: str) -> Iterable[str]:
    with (results / f'{name}.csv').open(newline='', encoding='utf-8') as file:
        rows = list(csv.DictReader(file))
    argv = json.loads((results / f'{name}.json').read_text(encoding='utf-8'))['study']
    varied = list(rows[0])[: list(rows[0]).index('queries')]
    columns = [*varied, *STUDY_FIGURES]
    yield f'## Study: {argv}\n'
    yield _table(columns, ([_number(row[column]) for column in columns] for row in rows))


def _number(text: str) -> str:
    return f'{float(text):.3f}' if '.' in text and ':' not in text else text or '-'


def _text(value: Any) -> str:
    if value is None:
        return '-'
    if isinstance(value, float):
        return f'{value:.3f}' if abs(value) < 10 else f'{value:.1f}'
    return str(value)


def _table(columns: Iterable[str], rows: Iterable[Iterable[str]]) -> str:
    columns = list(columns)
    lines = [columns, ['---'] * len(columns), *rows]
    return '\n'.join(f'| {" | ".join(line)} |' for line in lines) + '\n'


if __name__ == '__main__':
    raise SystemExit(main())
