# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The charts of the report as single PNG and SVG files, for papers and slides."""

from collections.abc import Sequence
import math
from pathlib import Path
import re

from convseq_ros.evaluation import plots
from convseq_ros.evaluation.report.curves import accuracy, read_curve
from convseq_ros.evaluation.report.lengths import entropy_threshold, varies
from convseq_ros.evaluation.report.reliability import reliability_table
from convseq_ros.evaluation.report.summary_table import number
from convseq_ros.evaluation.report.verdict import Seen, seen
from convseq_ros.evaluation.run_folder import Run
import numpy as np


def write_figures(runs: Sequence[Run], folder: Path) -> None:
    """
    Write the charts of every set and method, .png and .svg.

    They are called `<set>-curves`, `-accuracy`, `-reliability` where a method tells its
    confidence, `<set>-<method>-matrix` and `-lengths`.

    Raises
    ------
    ConvseqError
        If matplotlib is not installed or a run is damaged.

    """
    folder.mkdir(parents=True, exist_ok=True)
    for name in dict.fromkeys(run.set for run in runs):
        own = [run for run in runs if run.set == name]
        plots.draw_curves(
            _files(folder, name, 'curves'),
            name,
            {run.method: read_curve(run.folder) for run in own},
        )
        plots.draw_accuracies(
            _files(folder, name, 'accuracy'),
            name,
            [(run.method, accuracy(run), *_interval(run)) for run in own],
        )
        tables = {run.method: reliability_table(run) for run in own if reliability_table(run)}
        if tables:
            plots.draw_reliability(_files(folder, name, 'reliability'), name, tables)
        for run in own:
            _write_run(run, folder)


def _write_run(run: Run, folder: Path) -> None:
    truth, scores = run.truth(), run.scores()
    rows = seen(run, truth)
    title = f'{run.set}: {run.method}'
    if scores is not None and scores.size:
        found = np.full(len(scores), -1)
        right = np.zeros(len(scores), bool)
        for one in rows:
            if one.best is not None and one.verdict in ('right', 'wrong'):
                found[one.query], right[one.query] = one.best, one.correct
        plots.draw_matrix(
            _files(folder, run.set, run.method, 'matrix'), title, scores, truth, found, right
        )
    if varies(rows):
        plots.draw_lengths(
            _files(folder, run.set, run.method, 'lengths'),
            title,
            [one.length for one in rows],
            _entropy(rows),
            entropy_threshold(run),
        )


def _entropy(rows: Sequence[Seen]) -> list[float]:
    return [math.nan if one.entropy is None else one.entropy for one in rows]


def _interval(run: Run) -> tuple[float | None, float | None]:
    low, high = (number(run.summary.get(f'accuracy_matched_{end}')) for end in ('low', 'high'))
    return low, high


def _files(folder: Path, *names: str) -> list[Path]:
    stem = '-'.join(re.sub(r'[^\w.-]+', '_', name) for name in names)
    return [folder / f'{stem}.{kind}' for kind in ('png', 'svg')]
