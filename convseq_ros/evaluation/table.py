# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The table of all sets and methods, by pandas, for the terminal and the page."""

from collections.abc import Mapping, Sequence
from typing import Any

from convseq_ros.errors import load
from convseq_ros.evaluation.scorecard import RECALL_COUNTS

HEADINGS = {
    'set': 'set',
    'method': 'method',
    'accuracy_matched': 'acc. matched',
    'interval': '95 %',
    'matched_known': 'of',
    'accuracy_all': 'acc. all',
    'known': 'of all',
    'over_first': 'over first',
    **{f'recall_at_{count}': f'R@{count}' for count in RECALL_COUNTS},
    'auc_pr': 'AUC-PR',
    'recall_at_100_precision': 'R at 100 % P',
    'precision_at_100_recall': 'P at 100 % R',
    'accepted_recall': 'accepted R',
    'false_closures': 'false',
    'slips': 'slips',
    'first_closures': 'first after',
    'own_threshold_recall': 'R at 0 false',
    'mean_k': 'mean k',
    'encode_ms': 'encode ms',
    'frame_ms': 'frame ms',
    'place_bytes': 'bytes a place',
}


def table_of(summaries: Sequence[Mapping[str, Any]]) -> Any:
    """Return the main figures of every summary as a pandas table of texts, - for None."""
    paired = any('difference' in summary for summary in summaries)
    shown = {name: text for name, text in HEADINGS.items() if paired or name != 'over_first'}
    rows = []
    for summary in summaries:
        low, high = summary.get('accuracy_matched_low'), summary.get('accuracy_matched_high')
        interval = '' if low is None or high is None else f'{low:.2f}-{high:.2f}'
        over_first = ''
        if summary.get('difference') is not None:
            ends = (f'{summary[f"difference_{end}"]:+.2f}' for end in ('low', 'high'))
            over_first = f'{summary["difference"]:+.3f} ({" to ".join(ends)})'
        delays = (summary.get('frames_to_first_closure') or {}).values()
        first = ', '.join('-' if count is None else str(count) for count in delays)
        made = {'interval': interval, 'first_closures': first, 'over_first': over_first}
        figures = {**summary, **made}
        rows.append({text: _text(figures.get(name)) for name, text in shown.items()})
    return load('pandas', 'evaluation').DataFrame(rows)


def latex_of(summaries: Sequence[Mapping[str, Any]]) -> str:
    """Return the table as LaTeX with booktabs; ConvseqError if a library is missing."""
    load('jinja2', 'evaluation')
    return str(table_of(summaries).to_latex(index=False, escape=True))


def _text(value: Any) -> str:
    if value is None:
        return '-'
    if isinstance(value, float):
        return f'{value:.3f}' if abs(value) < 10 else f'{value:.1f}'
    return str(value)
