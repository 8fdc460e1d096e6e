# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""All charts of some runs, for the page and as files for papers and slides."""

from collections.abc import Mapping, Sequence
from pathlib import Path
import re

from convseq_ros.evaluation.report.accuracies import accuracies_chart
from convseq_ros.evaluation.report.chart import Chart
from convseq_ros.evaluation.report.curves import curves_chart
from convseq_ros.evaluation.report.first_closures import first_closures_chart
from convseq_ros.evaluation.report.lengths import lengths_chart
from convseq_ros.evaluation.report.matrix import matrix_chart
from convseq_ros.evaluation.report.poses import poses_chart
from convseq_ros.evaluation.report.reliability import reliability_chart
from convseq_ros.evaluation.report.verdict import Seen, seen
from convseq_ros.evaluation.run_folder import Run

KINDS = ('png', 'svg', 'pdf')


def set_charts(runs: Sequence[Run], colors: Mapping[str, int]) -> dict[str, Chart]:
    """Return the charts of one set by their names; `colors` numbers the methods."""
    return _drawn(
        curves=curves_chart(runs, colors),
        reliability=reliability_chart(runs, colors),
        accuracy=accuracies_chart(runs, colors),
        closures=first_closures_chart(runs, colors),
    )


def run_charts(run: Run, rows: Sequence[Seen]) -> dict[str, Chart]:
    """Return the charts of one run by their names; `rows` tell what became of its queries."""
    return _drawn(
        matrix=matrix_chart(run, rows),
        lengths=lengths_chart(run, rows),
        poses=poses_chart(run, rows),
    )


def method_numbers(runs: Sequence[Run]) -> dict[str, int]:
    """Return a number for each method, which gives its colour on all sets."""
    methods = dict.fromkeys(run.method for run in runs)
    return {method: number for number, method in enumerate(methods)}


def write_figures(runs: Sequence[Run], folder: Path) -> None:
    """
    Write the charts of every set and method, .png, .svg and .pdf.

    They are called `<set>-curves`, `-accuracy`, `-closures` where frames to the first closure are
    known, `-reliability` where a method tells its confidence, `<set>-<method>-matrix`,
    `-lengths`, and `-poses` where they are measured.

    Raises
    ------
    ConvseqError
        If matplotlib is not installed or a run is damaged.

    """
    folder.mkdir(parents=True, exist_ok=True)
    colors = method_numbers(runs)
    for name in dict.fromkeys(run.set for run in runs):
        own = [run for run in runs if run.set == name]
        _save(set_charts(own, colors), folder, name)
        for run in own:
            _save(run_charts(run, seen(run, run.truth())), folder, name, run.method)


def _drawn(**charts: Chart | None) -> dict[str, Chart]:
    return {name: chart for name, chart in charts.items() if chart}


def _save(charts: Mapping[str, Chart], folder: Path, *names: str) -> None:
    for what, chart in charts.items():
        stem = '-'.join(re.sub(r'[^\w.-]+', '_', name) for name in (*names, what))
        chart.save(*(folder / f'{stem}.{kind}' for kind in KINDS))
