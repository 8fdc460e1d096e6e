# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""One self-contained HTML page of what `convseq evaluate` measured."""

from collections.abc import Iterable, Mapping
from dataclasses import replace
from pathlib import Path

from convseq_ros.errors import ConvseqError
from convseq_ros.evaluation.report.accuracies import accuracy
from convseq_ros.evaluation.report.page import report_page
from convseq_ros.evaluation.run_folder import read_run, Run
from convseq_ros.reading_config import ReadingConfig
from convseq_ros.results import complete_or_absent
import numpy as np

MOST_MEGABYTES = 20.0


def read_runs(folders: Iterable[Path], reading: ReadingConfig = ReadingConfig()) -> list[Run]:
    """
    Return the runs of some result folders, set by set, the most accurate of each set first.

    A run of a name that was already seen is told apart by its folder.

    Raises
    ------
    ConvseqError
        If a folder holds no run, or a run is damaged.

    """
    runs: dict[tuple[str, str], Run] = {}
    for folder in folders:
        for run in read_run(folder, reading):
            _check(run)
            if (run.set, run.method) in runs:
                run = replace(run, method=f'{run.method} ({folder.name})')
            runs[run.set, run.method] = run
    sets = list(dict.fromkeys(run.set for run in runs.values()))
    return sorted(runs.values(), key=lambda run: (sets.index(run.set), -accuracy(run), run.method))


def _check(run: Run) -> None:
    try:
        sound = bool(run.frames) and all(
            isinstance(one, Mapping) for one in (run.summary, run.about_set())
        )
        for matrix in (run.truth(), run.scores()) if sound else ():
            sound &= matrix is None or matrix.ndim == 2
        if sound:
            fields, poses = run.fields(), [run.poses(drive) for drive in ('query', 'reference')]
            sound = len(fields) == len(run.frames)
            sound &= all(one.shape[1:] == (4,) and one.dtype == np.uint8 for one in fields)
            about = run.about_set()
            sizes = [(about['queries'], 7), (about['references'], 7)]
            sound &= all(
                one is None or one.shape == size for one, size in zip(poses, sizes, strict=True)
            )
    except (OSError, ValueError, TypeError, IndexError, KeyError):
        sound = False
    if not sound:
        raise ConvseqError(f'{run.folder}: damaged results; run `convseq evaluate` again')


def write_report(runs: list[Run], output: Path, most_megabytes: float = MOST_MEGABYTES) -> None:
    """
    Write the page of some runs; it is complete or absent.

    Raises
    ------
    ConvseqError
        If matplotlib is not installed, a run is damaged or the page is too large.

    """
    page = report_page(runs, round(most_megabytes * 1e6))
    with complete_or_absent(output) as part:
        part.write_text(page, encoding='utf-8')
