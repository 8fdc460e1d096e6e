# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The content of a report: all runs are read and checked before anything is drawn."""

from collections.abc import Iterable, Mapping
import csv
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from convseq_ros.config.reading_config import ReadingConfig
from convseq_ros.errors import ConvseqError, one_line, SourceError
from convseq_ros.evaluation.run_folder import read_run, read_table, refuse_other, Run
from convseq_ros.evaluation.table import check_figures
import numpy as np
import numpy.typing as npt

_DAMAGED = (
    csv.Error, OSError, ValueError, TypeError, LookupError, AttributeError, ArithmeticError,
)  # fmt: skip


@dataclass(frozen=True, slots=True)
class Row:
    """The result of one query."""

    query: int
    verdict: str  # right or wrong if it was accepted, rejected, or skipped without a candidate
    best: int | None  # the best candidate
    truth: int | None  # the right reference to show, even if this map lacks it
    length: int  # frames matched together
    entropy: float | None
    half: str  # name of the kept part of the map
    texts: tuple[str, str, str, str]  # about the verdict, the query, the match and the truth


@dataclass(frozen=True, slots=True)
class Shown:
    """A run that was read and checked."""

    run: Run
    name: str  # of the method, made unique
    about: Mapping[str, Any]
    rows: list[Row]
    curve: npt.NDArray[np.float64]  # (T, 2), recall and precision
    scores: npt.NDArray[np.float32] | None  # (Q, R)
    truth: npt.NDArray[np.bool_] | None  # (Q, R)


def read_runs(folders: Iterable[Path], reading: ReadingConfig = ReadingConfig()) -> list[Shown]:
    """Return the runs of folders, the best of each set first; ConvseqError if one is damaged."""
    runs: dict[tuple[str, str], Shown] = {}
    firsts: dict[str, Run] = {}
    for folder in folders:
        for run in read_run(folder, reading):
            first = firsts.setdefault(run.set, run)
            refuse_other(run.summary, first.summary, run.folder)
            is_new = (run.set, run.method) not in runs
            name = run.method if is_new else f'{run.method} ({folder.name})'
            try:
                runs[run.set, name] = _shown(run, name)
            except SourceError:
                raise
            except _DAMAGED as error:
                raise ConvseqError(
                    f'{run.folder}: damaged results ({one_line(error, 100)}); '
                    'run `convseq evaluate` again'
                ) from None
    sets = list(dict.fromkeys(one.run.set for one in runs.values()))

    def order(one: Shown) -> tuple[int, float, str]:
        best = one.run.summary.get('accuracy_matched')
        return sets.index(one.run.set), -float(best or 0), one.name

    return sorted(runs.values(), key=order)


def right_to_show(right: npt.NDArray[np.bool_], best: int | None) -> int | None:
    """Return the middle of the run of right references (R,) nearest to `best`, or the longest."""
    indices = np.flatnonzero(right)
    if not len(indices):
        return None
    runs = np.split(indices, np.flatnonzero(np.diff(indices) > 1) + 1)
    if best is None:
        run = max(runs, key=len)
    else:
        run = min(runs, key=lambda indices: int(abs(indices - best).min()))
    return int(run[(len(run) - 1) // 2])


def _shown(run: Run, name: str) -> Shown:
    summary = run.summary
    check_figures(summary)
    for row in (summary.get('calibration') or {}).get('as_shipped', ()):
        _ = float(row['said']), float(row['right'])
    configuration, machine = (summary.get(name) or {} for name in ('configuration', 'machine'))
    _ = float(configuration.get('entropy_threshold') or 0), machine.get('cpu')
    about, truth, scores = run.about_set(), run.truth(), run.scores()
    rows = []
    for position, frame in enumerate(run.frames):
        try:
            rows.append(_row(frame, truth))
        except (ValueError, LookupError, TypeError) as error:
            raise ValueError(f'frames.csv: row {position + 1} is damaged: {error}') from None
    if not rows:
        raise ValueError('no frames')
    if any(matrix is not None and matrix.ndim != 2 for matrix in (truth, scores)):
        raise ValueError('truth or scores are not a matrix')
    path = run.folder / 'curve.csv'
    points = read_table(path, run.reading) if path.exists() else []
    curve = np.array([(float(item['recall']), float(item['precision'])) for item in points])
    return Shown(run, name, about, rows, curve.reshape(-1, 2), scores, truth)


def _row(row: Mapping[str, str], truth: npt.NDArray[np.bool_] | None) -> Row:
    query, best = int(row['query_index']), int(row['best_index']) if row['best_index'] else None
    verdict = 'skipped' if best is None else 'rejected'
    if row['status'] == 'accepted':
        verdict = 'right' if row['correct'] == '1' else 'wrong'
    is_known, half, length = row['known'] == '1', row.get('half') or '', row['sequence_length']
    right = None if truth is None else right_to_show(truth[query], best)
    entropy = float(row['entropy']) if row.get('entropy') else None
    sentence = f'{verdict.capitalize()}: {row["reason"].replace("_", " ")}'
    sentence += ', a slip' if row.get('slip') == '1' else ''
    sentence += '' if is_known else ', and this place is not in the map'
    sentence += f'; only the {half} part of the map was kept' if half else ''
    figures = [f'{one.removeprefix("best_")} {float(row[one]):.3f}'
               for one in ('best_score', 'margin', 'confidence') if row.get(one)]  # fmt: skip
    figures += [f'inliers {row["inliers"]}'] if row.get('inliers') else []
    place = 'not in the map' if right is None else f'reference {right}'
    place += '' if right is None or is_known else ', left out of this map'
    texts = (
        f'{sentence}.',
        f'Query {query}\nk {length}' + ('' if entropy is None else f', entropy {entropy:.3f}'),
        f'{"No match" if best is None else f"Match: reference {best}"}\n{", ".join(figures)}',
        f'Truth: {place}',
    )
    return Row(query, verdict, best, right, int(length or 0), entropy, half, texts)
