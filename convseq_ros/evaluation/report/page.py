# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The page put together from its parts; it needs no network and no other file."""

from collections.abc import Mapping, Sequence
from html import escape
from importlib.resources import files
import json
from string import Template
from typing import Any

from convseq_ros.errors import ConvseqError
from convseq_ros.evaluation.report.charts import method_style
from convseq_ros.evaluation.report.curves import accuracy, accuracy_chart, curves_chart
from convseq_ros.evaluation.report.lengths import lengths_chart, varies
from convseq_ros.evaluation.report.matrix import matrix_figure
from convseq_ros.evaluation.report.pairs import browser_data
from convseq_ros.evaluation.report.reliability import reliability_chart
from convseq_ros.evaluation.report.summary_table import number, summary_table
from convseq_ros.evaluation.report.verdict import Seen, seen
from convseq_ros.evaluation.run_folder import Run

MOST_ROWS = 4000
PROTOCOLS = {
    'closed': 'every query has an answer in the map',
    'open': 'half of the map is left out in turn, so "not in the map" is a right answer',
    'online': 'one sequence against its own past',
}


def report_page(runs: Sequence[Run], most_bytes: int) -> str:
    """
    Return the page; frames in the browser of pairs are thinned until it is small enough.

    Raises
    ------
    ConvseqError
        If a run is damaged, or the page is too large without a single picture.

    """
    methods = dict.fromkeys(run.method for run in runs)
    colors = {method: index for index, method in enumerate(methods)}
    rows = {(run.set, run.method): seen(run, run.truth()) for run in runs}
    sections = ''.join(
        _section([run for run in runs if run.set == name], rows, colors) for name in _sets(runs)
    )
    parts = {
        'title': 'Place recognition: ' + ', '.join(_sets(runs)),
        'told': escape(_told(runs)),
        'links': ''.join(
            f'<a href="#set-{escape(name)}">{escape(name)}</a>' for name in _sets(runs)
        ),
        'table': summary_table(runs),
        'sections': sections,
        'sources': ''.join(map(_source, runs)),
        'style': _resource('style.css'),
        'script': _resource('script.js'),
    }
    most_rows = max(len(kept) for kept in rows.values())
    step = -(-most_rows // MOST_ROWS)
    while True:
        data = browser_data(runs, rows, step)
        note = (
            ''
            if step == 1
            else (
                f'To keep this page small, one frame in {step} is shown here; '
                'the numbers and charts above are of all frames.'
            )
        )
        page = Template(_resource('template.html')).substitute(
            parts, data=_json(data), thinned=note
        )
        if len(page.encode()) <= most_bytes:
            return page
        if step >= most_rows:
            raise ConvseqError(
                f'the page would have {len(page) / 1e6:.1f} MB, {most_bytes / 1e6:g} MB are'
                ' allowed; give fewer results or raise --max-megabytes'
            )
        step *= 2


def _section(
    runs: Sequence[Run], rows: Mapping[tuple[str, str], Sequence[Seen]], colors: Mapping[str, int]
) -> str:
    name = runs[0].set
    facts = _facts(runs[0])
    charts = _figure(
        curves_chart(runs, colors),
        'Precision-recall, exact: one point for every distinct'
        ' score. Recall is over matched queries that have an answer.',
    ) + _figure(
        accuracy_chart(runs, colors),
        'Accuracy over matched queries that have an'
        ' answer, with its 95 % interval (bootstrap over blocks of the sequence); the'
        ' upright tick is over all that have one, matched or not.',
    )
    reliability = reliability_chart(runs, colors)
    if reliability:
        charts += _figure(
            reliability,
            'How often a confidence is right (the right place, slips'
            ' included); larger dots are more frames. Its two settings come from'
            ' the sets of other places, where there are any.',
        )
    legend = ''.join(
        f'<li tabindex="0" data-series="{escape(run.method)}">'
        f'<i class="swatch {method_style(colors[run.method])}"></i>'
        f'{escape(run.method)}</li>'
        for run in runs
    )
    return (
        f'<section id="set-{escape(name)}" class="set"><h2>{escape(facts.pop("title"))}</h2>'
        f'<p class="facts">{escape(" · ".join(facts.values()))}</p>'
        f'<p>{escape(_winner(runs[0]))}</p>'
        f'<ul class="legend" aria-label="Methods">{legend}</ul>'
        f'<div class="charts">{charts}</div>'
        f'{_matrices(runs, rows)}{_lengths(runs, rows)}</section>'
    )


def _winner(run: Run) -> str:
    low, high = (number(run.summary.get(f'accuracy_matched_{end}')) for end in ('low', 'high'))
    span = '' if low is None or high is None else f' (95 % interval {low:.1%} to {high:.1%})'
    return (
        f'Most accurate: {run.method}, {accuracy(run):.1%} of the'
        f' {run.summary.get("matched_known", "")} matched queries that have an answer{span}.'
        if accuracy(run)
        else ''
    )


def _matrices(runs: Sequence[Run], rows: Mapping[tuple[str, str], Sequence[Seen]]) -> str:
    figures = []
    for run in runs:
        scores = run.scores()
        if scores is not None and scores.size:
            figures.append(matrix_figure(run, scores, run.truth(), rows[run.set, run.method]))
    if not figures:
        return ''
    return (
        '<h3>Similarity matrices</h3><p class="caption">Scores of single image pairs, query down,'
        ' reference across; brighter is more similar. Between the white lines: truth. Dots: best'
        ' candidate, <b class="right">accepted and right</b>,'
        ' <b class="wrong">accepted and wrong</b>,'
        ' <b class="rejected">rejected</b>. Click a row to see its pictures.</p>'
        f'<div class="matrices">{"".join(figures)}</div>'
    )


def _lengths(runs: Sequence[Run], rows: Mapping[tuple[str, str], Sequence[Seen]]) -> str:
    parts = []
    for run in runs:
        table = rows[run.set, run.method]
        if varies(table):
            parts.append(
                _figure(
                    lengths_chart(run, table),
                    f'{run.method}: frames matched together (k) over the entropy of the newest '
                    'image. Ticks between them: wrong best candidates, accepted (red) or '
                    'rejected (amber).',
                )
            )
    if not parts:
        return ''
    return f'<h3>Sequence length beside entropy</h3>{"".join(parts)}'


def _figure(picture: str, caption: str) -> str:
    return f'<figure>{picture}<figcaption>{escape(caption)}</figcaption></figure>'


def _facts(run: Run) -> dict[str, str]:
    told = run.about_set()
    protocol = str(run.summary.get('protocol', 'closed'))
    facts = {
        'title': str(told.get('title') or run.set),
        'protocol': f'{protocol}: {PROTOCOLS.get(protocol, "")}'.rstrip(': '),
    }
    for key, words in (
        ('queries', '{} queries'),
        ('references', '{} references'),
        ('tolerance', 'tolerance ±{}'),
        ('radius_m', 'within {} m'),
    ):
        if number(told.get(key)):
            facts[key] = words.format(told[key])
    return facts


def _source(run: Run) -> str:
    told = {
        key: run.summary.get(key)
        for key in (
            'argv',
            'date',
            'machine',
            'versions',
            'criterion',
            'transferred',
            'notes',
            'configuration',
            'k_distribution',
        )
    }
    lines = ''.join(
        f'<dt>{escape(key.replace("_", " "))}</dt><dd>{escape(_words(value))}</dd>'
        for key, value in told.items()
        if value
    )
    return (
        f'<details><summary>{escape(run.set)} / {escape(run.method)}</summary>'
        f'<dl>{lines}</dl></details>'
    )


def _words(value: Any) -> str:
    if isinstance(value, dict):
        return ', '.join(f'{key} {_words(part)}' for key, part in value.items())
    if isinstance(value, list):
        return ' '.join(map(_words, value))
    return str(value)


def _told(runs: Sequence[Run]) -> str:
    dates = sorted({str(run.summary['date']) for run in runs if run.summary.get('date')})
    machine = next((run.summary['machine'] for run in runs if run.summary.get('machine')), None)
    parts = [f'{len(_sets(runs))} sets, {len({run.method for run in runs})} methods']
    if dates:
        parts.append(
            dates[0][:10]
            if dates[0][:10] == dates[-1][:10]
            else f'{dates[0][:10]} to {dates[-1][:10]}'
        )
    if machine:
        parts.append(_words(machine))
    return ' · '.join(parts)


def _sets(runs: Sequence[Run]) -> list[str]:
    return list(dict.fromkeys(run.set for run in runs))


def _json(data: object) -> str:
    told = json.dumps(data, separators=(',', ':'), allow_nan=False)
    return told.replace('<', '\\u003c')


def _resource(name: str) -> str:
    return (files(__package__) / name).read_text(encoding='utf-8')
