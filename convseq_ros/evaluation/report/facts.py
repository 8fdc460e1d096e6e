# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What the page says in words about sets and runs."""

from collections.abc import Sequence
from html import escape
from typing import Any

from convseq_ros.evaluation.report.summary_table import number
from convseq_ros.evaluation.run_folder import Run

PROTOCOLS = {
    'closed': 'every query has an answer in the map',
    'open': 'a part of the map is left out, so "not in the map" is a right answer',
    'online': 'one sequence against its own past',
}


def set_facts(run: Run) -> dict[str, str]:
    """Return the title of a run's set, its protocol, and how large and how strict it is."""
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


def source(run: Run) -> str:
    """Return how a run came about, to be unfolded on the page."""
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


def run_facts(runs: Sequence[Run]) -> str:
    """Return how many sets and methods there are, when they were measured, and where."""
    dates = sorted({str(run.summary['date']) for run in runs if run.summary.get('date')})
    machine = next((run.summary['machine'] for run in runs if run.summary.get('machine')), None)
    sets, methods = len({run.set for run in runs}), len({run.method for run in runs})
    parts = [f'{sets} set{"s" * (sets != 1)}, {methods} method{"s" * (methods != 1)}']
    if dates:
        parts.append(
            dates[0][:10]
            if dates[0][:10] == dates[-1][:10]
            else f'{dates[0][:10]} to {dates[-1][:10]}'
        )
    if machine:
        parts.append(_words(machine))
    return ' · '.join(parts)
