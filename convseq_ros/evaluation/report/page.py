# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Builds the HTML page; it needs no network and no other file."""

import base64
from collections.abc import Sequence
from html import escape
import json
from pathlib import Path
from typing import Any
from urllib.parse import quote

from convseq_ros.evaluation.report.charts import run_charts, set_charts, svg
from convseq_ros.evaluation.report.shown import Row, Shown
from convseq_ros.evaluation.report.template import photos, write_page
from convseq_ros.evaluation.table import best_of, HEADINGS, summary_rows, text_of
from convseq_ros.io.regular_file import read_bytes

_MOST_FRAMES = 2000  # with pairs, over all sets: about 20 MB
_SOURCE = 'argv', 'date', 'machine', 'versions', 'criterion', 'configuration', 'k_distribution'
_KINDS = 'right', 'wrong', 'rejected', 'skipped'
_COLUMNS = (
    'Green is best on its set; a method leads to its pairs. Accuracy is over matched queries that '
    'have an answer, with its 95&nbsp;% interval; &ldquo;all&rdquo; counts those that got no '
    'candidate, too. &ldquo;R at 0 false&rdquo; is the recall at the threshold that is best on '
    'the set itself, &ldquo;one threshold&rdquo; at the one for all sets; both favour the method.'
)
_PROTOCOLS = {
    'closed': 'every query has an answer in the map',
    'open': 'a part of the map is left out, so "not in the map" is a right answer',
    'online': 'one sequence against its own past',
}


def write_report(runs: Sequence[Shown], output: Path) -> None:
    """Write the page of the runs; above _MOST_FRAMES, only every n-th pair is included."""
    by_set: dict[str, list[Shown]] = {}
    for run in runs:
        by_set.setdefault(run.run.set, []).append(run)
    frames = sum(max(len(run.rows) for run in set_runs) for set_runs in by_set.values())
    step = -(-frames // _MOST_FRAMES)
    machine = runs[0].run.summary.get('machine') or {}
    facts = str(runs[0].run.summary.get('date', ''))[:10], str(machine.get('cpu', ''))
    parts = {
        'title': escape('Place recognition: ' + ', '.join(by_set)),
        'facts': escape(' · '.join(filter(None, facts))),
        'links': ''.join(f'<a href="#set-{escape(name)}">{escape(name)}</a>' for name in by_set),
        'summary': f'<div class="wide">{_table(runs)}</div><p class="soft">{_COLUMNS}</p>',
        'sections': ''.join(map(_section, by_set.values())),
        'sources': ''.join(map(_source, runs)),
        'note': f'To keep this page small, one frame in {step} is shown.' if step > 1 else '',
        'photos': photos('Query', 'Best candidate', 'Truth'),
        'more': '',
    }
    write_page(output, parts, {**_pairs(runs, step), 'kinds': _KINDS})


def _table(runs: Sequence[Shown]) -> str:
    """Return the HTML table of all runs, with the columns of the terminal's table."""
    rows = summary_rows(
        [{**run.run.summary, 'set': run.run.set, 'method': run.name} for run in runs]
    )
    names = [name for name in HEADINGS if any(row[name] not in (None, '') for row in rows)][2:]
    heads = ''.join(f'<th scope="col">{escape(HEADINGS[name])}</th>' for name in names)
    body = ''
    for run, row in zip(runs, rows, strict=True):
        peers = [other for other in rows if other['set'] == row['set']]
        cells = ''.join(
            f'<td{" class=best" * (row[name] is not None and row[name] == best_of(peers, name))}>'
            f'{escape(text_of(row[name]))}</td>'
            for name in names
        )
        link = escape(f'#{quote(run.run.set)}/{quote(run.name)}')
        body += (
            f'<tr><th scope="row">{escape(run.run.set)}</th><th scope="row"><a href="{link}">'
            f'{escape(run.name)}</a></th>{cells}</tr>'
        )
    return (
        '<table><thead><tr><th scope="col">set</th><th scope="col">method</th>'
        f'{heads}</tr></thead><tbody>{body}</tbody></table>'
    )


def _section(runs: Sequence[Shown]) -> str:
    name, about = runs[0].run.set, runs[0].about
    protocol = str(runs[0].run.summary.get('protocol', 'closed'))
    facts = [f'{protocol}: {_PROTOCOLS.get(protocol, "")}'.rstrip(': ')]
    facts += [f'{about[key]} {key}' for key in ('queries', 'references') if about.get(key)]
    facts += [f'tolerance ±{about["tolerance"]} frames'] if about.get('tolerance') else []
    facts += [f'within {about["radius_m"]} m'] if about.get('radius_m') else []
    charts = [*set_charts(runs), *(chart for run in runs for chart in run_charts(run))]
    figures = ''.join(
        f'<figure>{svg(figure, f"{what} on {name}: {caption}")}'
        f'<figcaption>{escape(caption)}</figcaption></figure>'
        for what, caption, figure in charts
    )
    return (
        f'<section id="set-{escape(name)}"><h2>{escape(str(about.get("title") or name))}</h2>'
        f'<p class="soft">{escape(" · ".join(facts))}</p><div class="charts">{figures}</div>'
        '</section>'
    )


def _source(run: Shown) -> str:
    """Return the provenance of a run, folded on the page."""
    facts = json.dumps({key: run.run.summary.get(key) for key in _SOURCE}, indent=1)
    name = f'{escape(run.run.set)} / {escape(run.name)}'
    return f'<details><summary>{name}</summary><pre>{escape(facts)}</pre></details>'


def _pairs(runs: Sequence[Shown], step: int) -> dict[str, Any]:
    """Return the data of the page's script: every `step`-th frame's row, each picture once."""
    pictures: dict[str, int] = {}
    numbers: dict[Path, int | None] = {}

    def picture(run: Shown, drive: str, index: int | None) -> int | None:
        path = None if index is None else run.run.thumbnail(drive, index)
        if path is None:
            return None
        if path not in numbers:
            content = read_bytes(path, 'a thumbnail', run.run.reading.refuse_file)
            is_complete = content.startswith(b'\xff\xd8\xff') and content.endswith(b'\xff\xd9')
            uri = f'data:image/jpeg;base64,{base64.b64encode(content).decode()}'
            numbers[path] = pictures.setdefault(uri, len(pictures)) if is_complete else None
        return numbers[path]

    def row_data(run: Shown, row: Row) -> list[Any]:
        sides = ('query', row.query), ('reference', row.best), ('reference', row.truth)
        return [row.verdict, *row.texts, *(picture(run, *side) for side in sides)]

    data = [
        {
            'set': run.run.set,
            'method': run.name,
            'rows': [row_data(run, row) for row in run.rows[::step]],
        }
        for run in runs
    ]
    return {'runs': data, 'pictures': list(pictures)}
