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
from convseq_ros.evaluation.data_set import DataSet, open_data_set, ready_made
from convseq_ros.evaluation.run_folder import read_run, write_text

METHODS = {
    'coherent': 'coherent=convseq+matching=coherent+search=exhaustive',
    'coherent-k10': 'coherent-k10=convseq-k10+matching=coherent+search=exhaustive',
    'coherent-k1': 'coherent-k1=convseq-k1+matching=coherent+search=exhaustive',
    'regional': 'regional=convseq+matching=regional+search=exhaustive',
    'regional-k10': 'regional-k10=convseq-k10+matching=regional+search=exhaustive',
    'convseq-forward': 'convseq-forward',
    'cohog': 'cohog',
    'seqslam': 'seqslam',
    'hog': 'hog',
}
ONE_LINE = {
    'coherent': 'ours: where the salient regions went, dynamic k, backward window',
    'coherent-k10, -k1': 'the same with fixed k',
    'regional': "the paper's pair score, dynamic k, backward window",
    'regional-k10': 'the same with fixed k',
    'convseq-forward': 'ConvSequential-SLAM as published: dynamic k, window into the future',
    'cohog': 'CoHOG: the same pair score on single frames',
    'seqslam': 'SeqSLAM, ds = 10, lines that end at the newest frame, signed arithmetic',
    'hog': 'HOG of the whole image, cosine',
    'vprbench-*': "score matrices that VPR-Bench published; -k10 and -dynamic add our sequences",
}
STUDIES = ('k_ablation', 'thresholds', 'speed', 'dropped_frames', 'stops', 'image_size',
           'appearance')  # fmt: skip
QUICK_STUDIES = STUDIES[:5]
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
STUDY_FIGURES = ('accuracy_matched', 'accuracy_all', 'matched', 'mean_k', 'k_distribution')
READING = """\
**How to read it.** *Right, of matched*: right answers among the queries that were matched (the
first frames wait for their sequence, or the last in a forward window) and have an answer; the
interval is a block bootstrap over contiguous blocks of the sequence. *Right, of all*: among all
queries that have an answer. *AUC-PR*: exact, recall over the right matches, as scikit-learn and
VPR-Bench count it. *R at 100 % P*: share of the matched queries that score above every wrong one.
*t_e*: time to encode an image; *frame*: to encode it, score it against all references and decide.
*PCU* = P_R100 x log10(t_e_max / t_e + 9). A right answer lies within the tolerance of the set; a
*slip* is off by up to three frames more, everything else that is wrong is *false*.
"""
UNKNOWN = """\
## What the paper reports

Its tables are pictures and its curves are drawn; their numbers are not known here and none is
restated. Known are: 90 % for CoHOG on Gardens Point day-day within two frames (its authors' list
of retrieved images), VPR-Bench's score matrices for corridor, and the output of the released
script on corridor.
"""


def main(arguments: Sequence[str] | None = None) -> int:
    """Measure and write; 0 when done, 1 if a part could not be measured."""
    chosen = _parser().parse_args(arguments)
    there, absent = _sort_out([*ready_made(), *chosen.set], chosen.data_root)
    common = ['--data-root', str(chosen.data_root), '--output', str(chosen.results)]
    methods = [part for text in (*METHODS.values(), 'published') for part in ('--method', text)]
    if there and convseq([
        'evaluate', *there, *methods, *common, '--protocol', 'closed', '--protocol', 'open',
        '--threshold-from-others',
    ]):  # fmt: skip
        return 1
    for study in chosen.study:
        if convseq(['evaluate', '--study', study, '--matching', 'regional', *common]):
            return 1
    write_text(chosen.output, page(chosen.results, chosen.study, absent))
    return 0


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
        parts.append(_table(figures.values(), ([_cell(run, key) for key in figures]
                                               for run in own)))  # fmt: skip
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
        '--study', nargs='*', choices=STUDIES, default=QUICK_STUDIES,
        help='studies to run (all but image_size and appearance, which take longer)',
    )  # fmt: skip
    return parser


def _sort_out(names: Iterable[str], data_root: Path) -> tuple[list[str], dict[str, str]]:
    """Return the sets whose images are there, and what the others lack."""
    there, absent = [], {}
    for name in names:
        data_set = open_data_set(name, data_root)
        missing = _missing(data_set)
        if missing:
            absent[data_set.name] = f'{missing}; {data_set.source}'
        else:
            there.append(name)
    if not there:
        raise ConvseqError(f'{data_root}: holds none of the data sets')
    return there, absent


def _missing(data_set: DataSet) -> str:
    paths = [data_set.query.path, data_set.truth.path]
    paths += [data_set.reference.path] if data_set.reference else []
    return next((f'`{path.name}`' for path in paths if path and not path.exists()), '')


def _ordered(runs: list[dict[str, Any]]) -> list[dict[str, Any]]:
    order = list(METHODS)
    return sorted(runs, key=lambda run: (
        order.index(run['method']) if run['method'] in order else len(order), run['method'],
    ))  # fmt: skip


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
