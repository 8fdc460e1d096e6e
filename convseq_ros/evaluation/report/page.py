# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The page put together from its parts; it needs no network and no other file."""

from collections.abc import Mapping, Sequence
from html import escape
from importlib.resources import files
import json
from string import Template
from urllib.parse import quote

from convseq_ros.errors import ConvseqError
from convseq_ros.evaluation.report.accuracies import accuracy, interval
from convseq_ros.evaluation.report.chart import NUM_COLORS, STYLE_SHEET
from convseq_ros.evaluation.report.charts import method_numbers, run_charts, set_charts
from convseq_ros.evaluation.report.facts import run_facts, set_facts, source
from convseq_ros.evaluation.report.pairs import browser_data
from convseq_ros.evaluation.report.poses import off_in_words, placed
from convseq_ros.evaluation.report.summary_table import summary_table
from convseq_ros.evaluation.report.verdict import Seen, seen
from convseq_ros.evaluation.run_folder import Run

MOST_ROWS = 4000
CAPTIONS = {
    'curves': 'Precision-recall, exact: one point for every distinct score. Recall is over matched'
    ' queries that have an answer.',
    'accuracy': 'Accuracy over matched queries that have an answer, with its 95 % interval'
    ' (bootstrap over blocks of the sequence); the upright tick is over all that have one, matched'
    ' or not.',
    'reliability': 'How often a confidence is right (the right place, slips included); larger dots'
    ' are more frames. Its two settings come from the sets of other places, where there are any.',
    'closures': 'Frames from the first that shows a place of the map to the first accepted and'
    ' right match, of every part of the map that was kept; pale: none at all.',
    'lengths': '{method}: frames matched together (k) over the entropy of the newest image. Ticks'
    ' between them: wrong best candidates, accepted (red) or rejected (amber).',
    'poses': '{method}: {off}. Gray: places of the map; dots: where accepted queries were'
    ' measured, with a line to where they were. A long, narrow way is stretched.',
}
MATRICES = (
    '<h3>Similarity matrices</h3><p class="caption">Scores of single image pairs, query down,'
    ' reference across; brighter is more similar, gray was not scored. Between the white lines:'
    ' truth. Dots: best candidate, <b class="right">accepted and right</b>,'
    ' <b class="wrong">accepted and wrong</b>, <b class="rejected">rejected</b>.'
    ' Click a row to see its pictures.</p>'
)


def report_page(runs: Sequence[Run], most_bytes: int) -> str:
    """
    Return the page; frames in the browser of pairs are thinned until it is small enough.

    Raises
    ------
    ConvseqError
        If a run is damaged, or the page is too large without a single picture.

    """
    colors = method_numbers(runs)
    rows = {(run.set, run.method): seen(run, run.truth()) for run in runs}
    sections = ''.join(
        _section([run for run in runs if run.set == name], rows, colors) for name in _sets(runs)
    )
    parts = {
        'title': 'Place recognition: ' + ', '.join(_sets(runs)),
        'told': escape(run_facts(runs)),
        'links': ''.join(
            f'<a href="#set-{escape(name)}">{escape(name)}</a>' for name in _sets(runs)
        ),
        'table': summary_table(runs),
        'sections': sections,
        'sources': ''.join(map(source, runs)),
        'style': STYLE_SHEET,
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
    facts = set_facts(runs[0])
    charts = ''.join(
        _figure(chart.svg(), CAPTIONS[what]) for what, chart in set_charts(runs, colors).items()
    )
    legend = ''.join(
        f'<li tabindex="0" data-series="{escape(run.method)}">'
        f'<i class="{_swatch(colors[run.method])}"></i>'
        f'{escape(run.method)}</li>'
        for run in runs
    )
    return (
        f'<section id="set-{escape(name)}" class="set"><h2>{escape(facts.pop("title"))}</h2>'
        f'<p class="facts">{escape(" · ".join(facts.values()))}</p>'
        f'<p>{escape(_winner(runs[0]))}</p>'
        f'<ul class="legend" aria-label="Methods">{legend}</ul>'
        f'<div class="charts">{charts}</div>'
        f'{_charts_of_runs(runs, rows)}</section>'
    )


def _swatch(color: int) -> str:
    return f'swatch c{color % NUM_COLORS}' + (' dashed' if color >= NUM_COLORS else '')


def _winner(run: Run) -> str:
    ends = interval(run)
    span = f' (95 % interval {ends[0]:.1%} to {ends[1]:.1%})' if ends else ''
    return (
        f'Most accurate: {run.method}, {accuracy(run):.1%} of the'
        f' {run.summary.get("matched_known", "")} matched queries that have an answer{span}.'
        if accuracy(run)
        else ''
    )


def _charts_of_runs(runs: Sequence[Run], rows: Mapping[tuple[str, str], Sequence[Seen]]) -> str:
    matrices, lengths, poses = '', '', ''
    for run in runs:
        charts = run_charts(run, rows[run.set, run.method])
        if 'matrix' in charts:
            matrices += (
                '<figure class="matrix"><div class="plate"'
                f' data-run="{quote(run.set)}/{quote(run.method)}"'
                f' data-queries="{len(rows[run.set, run.method])}">{charts["matrix"].svg()}</div>'
                f'<figcaption>{escape(run.method)}</figcaption></figure>'
            )
        if 'lengths' in charts:
            caption = CAPTIONS['lengths'].format(method=run.method)
            lengths += _figure(charts['lengths'].svg(), caption)
        if 'poses' in charts:
            off = off_in_words(placed(run, rows[run.set, run.method]))
            caption = CAPTIONS['poses'].format(method=run.method, off=off)
            poses += _figure(charts['poses'].svg(), caption)
    return (
        (matrices and f'{MATRICES}<div class="matrices">{matrices}</div>')
        + (lengths and f'<h3>Sequence length beside entropy</h3>{lengths}')
        + (poses and f'<h3>Measured poses</h3>{poses}')
    )


def _figure(picture: str, caption: str) -> str:
    return f'<figure>{picture}<figcaption>{escape(caption)}</figcaption></figure>'


def _sets(runs: Sequence[Run]) -> list[str]:
    return list(dict.fromkeys(run.set for run in runs))


def _json(data: object) -> str:
    told = json.dumps(data, separators=(',', ':'), allow_nan=False)
    return told.replace('<', '\\u003c')


def _resource(name: str) -> str:
    return (files(__package__) / name).read_text(encoding='utf-8')
