# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What the page of `convseq evaluate` shows of a set: curves, matrices, and pairs by verdict."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from convseq_ros.config import EncodingConfig
from convseq_ros.core.types import Flags, Floats, Indices, Match
from convseq_ros.evaluation.material import Material
from convseq_ros.evaluation.methods import Sweep
from convseq_ros.evaluation.metrics import Curve
from convseq_ros.evaluation.plots import new_figure, svg
from convseq_ros.evaluation.protocols import OPEN, Outcome
from convseq_ros.evaluation.report.page import Pair, Section
from convseq_ros.evaluation.scorecard import Summary, Verdicts
from convseq_ros.evaluation.table import HEADINGS
import numpy as np
import numpy.typing as npt

_MEANS = 'said', 'right'
_UNSCORED = '#4c4c4c'
_VERDICT_COLORS = {'right': '#4ade80', 'wrong': '#ff6b6b', 'rejected': '#f5bd4f'}
_MOST_CELLS, _MOST_DOTS = 320, 1500  # that are drawn of a matrix: in a row, and of matches


@dataclass(frozen=True, eq=False)
class Result:
    """The result of a method on a set."""

    summary: Summary
    outcome: Outcome
    verdicts: Verdicts
    curve: Curve


def section_of(
    material: Material,
    encoding: EncodingConfig,
    results: Sequence[Result],
    sweep: Sweep | None = None,
) -> Section:
    """Return what the page shows of a set's results; a query, its answer and the truth a pair."""
    first = results[0].summary
    facts = [str(first['protocol']), f'{first["queries"]} queries']
    facts += [f'{first["references"]} references', f'truth: {material.data_set.truth.kind}']
    if first['unmissable']:
        facts.append(f'every place is right for {first["unmissable"]} queries')
    pairs = dict[str, list[Pair]]()
    for result in results:
        for verdict, pair in _pairs(material, encoding, result):
            pairs.setdefault(f'{result.summary["method"]}: {verdict}', []).append(pair)
    return Section(str(first['title']), ' · '.join(facts), [*_figures(results, sweep)], pairs)


def _figures(results: Sequence[Result], sweep: Sweep | None) -> Iterator[tuple[str, str]]:
    """Yield caption and SVG of each figure."""
    if sweep:
        said = 'Accuracy of matched queries, AUC-PR, and the time to encode all k frames (mean k)'
        yield f'{said}, by {sweep.option}.', _by_value(results, sweep)
    curves = {str(one.summary['method']): one.curve for one in results if len(one.curve.recall)}
    if curves:
        points = {
            name: (np.append(0.0, one.recall), np.append(one.precision[0], one.precision))
            for name, one in curves.items()
        }
        said = 'Precision and recall of the best answers to queries that have one.'
        yield said, _lines(points, 'recall', 'precision')
    tables = {str(one.summary['method']): one.summary['calibration'] for one in results}
    ranges = {
        name: tuple(np.array([row[key] for row in table['as_shipped']]) for key in _MEANS)
        for name, table in tables.items()
        if table
    }
    if ranges:
        said = 'Reliability: how often a confidence is right, slips included.'
        yield said, _lines(ranges, 'confidence', 'share that is right', marker='o')
    for one in results:
        if one.outcome.protocol != OPEN:
            yield (
                f'{one.summary["method"]}: scores of image pairs; brighter is more similar. '
                'Dots: best candidates.',
                _matrix(one),
            )


def _lines(lines: Mapping[str, Any], x_label: str, y_label: str, **how: Any) -> str:
    axes = (figure := new_figure(5, 3.6)).add_subplot()
    axes.set(xlim=(0, 1.01), ylim=(0, 1.01), xlabel=x_label, ylabel=y_label)
    axes.grid(alpha=0.3)
    for number, (name, (x, y)) in enumerate(lines.items()):
        axes.plot(x, y, label=name, linestyle=('-', '--', ':', '-.')[number // 10 % 4], **how)
    figure.legend(loc='upper center', bbox_to_anchor=(0.5, 0.0), ncols=2, fontsize=7)
    return svg(figure)


def _by_value(results: Sequence[Result], sweep: Sweep) -> str:
    """Return a figure of results in the order of `Sweep.methods`."""
    figure, count = new_figure(5, 5), len(sweep.values)
    above, below = figure.subplots(2, sharex=True)
    above.set(ylim=(0, 1.03), ylabel='share')
    below.set(xlabel=sweep.option, ylabel='encoding, ms')
    below.xaxis.get_major_locator().set_params(integer=True)
    for first in range(0, len(results), count):
        rows = [one.summary for one in results[first : first + count]]
        name = str(rows[0]['method']).removesuffix(f'-{sweep.option}{sweep.values[0]}')
        for key, style in (('accuracy_matched', '.-'), ('auc_pr', '.--')):
            shares = [np.nan if row[key] is None else row[key] for row in rows]
            above.plot(sweep.values, shares, style, label=f'{name} {HEADINGS[key]}')
        # Every frame is encoded once, and a sequence has `mean_k` of them.
        times_ms = [(row['mean_k'] or np.nan) * (row['encode_ms'] or np.nan) for row in rows]
        below.plot(sweep.values, times_ms, '.-', label=name)
    for axes in (above, below):
        axes.grid(alpha=0.3)
        axes.legend(fontsize=7)
    return svg(figure)


def _matrix(result: Result) -> str:
    scores = result.outcome.pairs.scores
    height = min(max(4.5 * scores.shape[0] / scores.shape[1], 1.6), 6.0)
    axes = (figure := new_figure(5, height)).add_subplot(xlabel='reference', ylabel='query')
    _show_scores(axes, scores)
    _show_truth(axes, result.outcome.right)
    best = [match.best for match in result.outcome.matches]
    dots = [(at, one.reference_index) for at, one in enumerate(best) if one]
    if dots:
        words = _words(result)
        _show_matches(axes, np.array(dots), np.array([words[at] for at, _ in dots]))
    if axes.get_legend_handles_labels()[0]:
        figure.legend(loc='upper center', bbox_to_anchor=(0.5, 0.0), ncols=2, fontsize=7)
    return svg(figure)


def _show_scores(axes: Any, scores: Floats) -> None:
    """Draw scores (Q, R): brighter is more similar, gray is NaN; blocks show their maximum."""
    from matplotlib import colormaps

    num_queries, num_references = scores.shape
    small = reduced(scores)
    finite = small[np.isfinite(small)]
    low, high = np.percentile(finite, (1, 99.8)) if finite.size else (0.0, 1.0)
    axes.imshow(
        np.ma.masked_invalid(small),
        cmap=colormaps['Blues_r'].with_extremes(bad=_UNSCORED),
        vmin=low,
        vmax=high if high > low else low + 1,
        extent=(-0.5, num_references - 0.5, num_queries - 0.5, -0.5),
        aspect='auto',
        interpolation='none',
    )
    if finite.size < small.size:
        axes.plot([], [], 's', color=_UNSCORED, label='not scored')


def _show_truth(axes: Any, truth: Flags) -> None:
    """Draw the edge of the right pairs; `truth` is bool, shape (Q, R)."""
    small = reduced(truth.astype(np.float32))
    if small.any() and not small.all() and min(small.shape) > 1:
        rows, columns = (
            (np.arange(count) + 0.5) * total / count - 0.5
            for count, total in zip(small.shape, truth.shape, strict=True)
        )
        axes.contour(columns, rows, small, levels=[0.5], colors='magenta', linewidths=0.8)
        axes.plot([], [], color='magenta', label='edge of the truth')


def _show_matches(axes: Any, matches: Indices, verdicts: npt.NDArray[np.str_]) -> None:
    """Draw a dot per match (N, 2); of very many, only every n-th."""
    step = max(1, -(-len(matches) // _MOST_DOTS))
    for verdict in reversed(_VERDICT_COLORS):
        queries, references = matches[verdicts == verdict].T
        if len(queries):
            label, color = f'{len(queries)} {verdict}', _VERDICT_COLORS[verdict]
            axes.plot(references[::step], queries[::step], 'o', ms=3, label=label, color=color)


def reduced(values: Floats) -> Floats:
    """Return the maximum of each block, so that neither side is longer than _MOST_CELLS."""
    for axis in (0, 1):
        block = -(-values.shape[axis] // _MOST_CELLS)
        if block > 1:
            starts = np.arange(0, values.shape[axis], block)
            values = np.fmax.reduceat(values, starts, axis=axis)
    return values


def _words(result: Result) -> list[str]:
    """Return right or wrong for each accepted answer, rejected, or skipped without candidates."""
    verdicts = result.verdicts
    words = np.where(verdicts.correct, 'right', 'wrong')
    words = np.where(verdicts.accepted, words, 'rejected')
    return list(np.where(verdicts.matched, words, 'skipped').tolist())


def _pairs(
    material: Material, encoding: EncodingConfig, result: Result
) -> Iterator[tuple[str, Pair]]:
    """Yield the verdict on each answer with a candidate, and its pictures."""
    query, reference = (drive.thumbnails for drive in material.drives(encoding))
    outcome = result.outcome
    for verdict, match, half in zip(_words(result), outcome.matches, outcome.halves, strict=True):
        if match.best:
            at, best = match.query_index, match.best.reference_index
            right = nearest(material.truth.right[at], best)
            truth = b'' if right is None else reference[right]
            caption = _caption(match, right, half)
            yield verdict, Pair(caption, (query[at], reference[best], truth))


def _caption(match: Match, right: int | None, half: str) -> str:
    best = match.best
    assert best
    confidence = '' if match.confidence is None else f', confidence {match.confidence:.3f}'
    return (
        f'Query {match.query_index}: {match.reason.value.replace("_", " ")}'
        f'{f", with the {half} part of the map" if half else ""}\n'
        f'Reference {best.reference_index}, score {best.score:.3f}{confidence}\n'
        f'Truth: {"not in the map" if right is None else f"reference {right}"}'
    )


def nearest(right: Flags, best: int) -> int | None:
    """Return the right reference, of flags (R,), that is nearest to the best; None without one."""
    indices = np.flatnonzero(right)
    return int(indices[np.abs(indices - best).argmin()]) if len(indices) else None
