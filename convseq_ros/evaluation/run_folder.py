# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
The folder that `convseq evaluate --output DIR` writes, and how to read it again.

::

    DIR/summary.csv               one row for every set and method
    DIR/<set>/set.json            name, title, protocol, tolerance, queries, references, query,
                                  reference, source, base
    DIR/<set>/truth.npz           `right`: bool (Q, R), query by reference
    DIR/<set>/poses.npz           `query` (Q, 7) and `reference` (R, 7): position in metres, and
                                  quaternion; NaN where unknown; absent if no reference has one
    DIR/<set>/thumbnails/query/000000.jpg, .../reference/000000.jpg
                                  160 px wide; missing where a frame was unreadable; no reference
                                  folder for a drive against its own past
    DIR/<set>/<method>/frames.csv the result table's columns and those of `EXTRA_COLUMNS`
    DIR/<set>/<method>/summary.json
    DIR/<set>/<method>/scores.npy float32 (Q, R), pair scores, higher is more similar, NaN where a
                                  pair was not scored; absent with half of the map removed
    DIR/<set>/<method>/fields.npz `dots`: uint8 (N, 4), inliers of the best candidates, row and
                                  column in query and reference, 255 the whole image; `ends`: how
                                  many up to each row of frames.csv; absent if nothing is verified
    DIR/<set>/<method>/curve.csv  threshold, precision, recall of the exact curve

With half of the map removed the set is called `<set>-open`; it has three rows a query, one for
every half that was kept, indices of the whole map, and its `base` names the set that holds its
thumbnails and the truth of the whole map.
"""

from collections.abc import Iterable, Mapping, Sequence
import csv
from dataclasses import dataclass
import io
import json
from pathlib import Path
from typing import Any

from convseq_ros.core.types import Match, Pose
from convseq_ros.errors import SourceError
from convseq_ros.evaluation.geometry import Dots, NO_DOTS, pose_rows
from convseq_ros.evaluation.metrics import Curve
from convseq_ros.evaluation.protocols import Outcome
from convseq_ros.evaluation.scorecard import margin, Verdicts
from convseq_ros.evaluation.truth import Truth
from convseq_ros.files import read_array, read_text
from convseq_ros.reading_config import ReadingConfig
from convseq_ros.results import COLUMNS, complete_or_absent, row
import numpy as np
import numpy.typing as npt

EXTRA_COLUMNS = ('correct', 'known', 'slip', 'margin', 'entropy', 'half')


@dataclass(frozen=True, slots=True)
class Run:
    """
    One method on one set, as read from a folder.

    Parameters
    ----------
    set, method : str
        Their names.
    folder : Path
        DIR/<set>/<method>.
    summary : mapping
        What summary.json holds.
    frames : list of mapping
        The rows of frames.csv; empty fields are empty strings.
    reading : ReadingConfig
        Which files are too large.

    """

    set: str
    method: str
    folder: Path
    summary: Mapping[str, Any]
    frames: list[dict[str, str]]
    reading: ReadingConfig = ReadingConfig()

    def about_set(self) -> Mapping[str, Any]:
        """Return what set.json holds."""
        return _read_json(self.folder.parent / 'set.json', self.reading)

    def scores(self) -> npt.NDArray[np.float32] | None:
        """Return the pair scores, query by reference, if the folder has them."""
        path = self.folder / 'scores.npy'
        return read_array(path, reading=self.reading) if path.exists() else None

    def truth(self) -> npt.NDArray[np.bool_] | None:
        """Return which references are right, query by reference, with the whole map."""
        path = self._base() / 'truth.npz'
        return read_array(path, 'right', self.reading) if path.exists() else None

    def fields(self) -> list[Dots]:
        """Return the inliers of each row's best candidate, if the folder has them."""
        path = self.folder / 'fields.npz'
        if not path.exists():
            return [NO_DOTS] * len(self.frames)
        dots, ends = (read_array(path, name, self.reading) for name in ('dots', 'ends'))
        return np.split(dots, ends[:-1])

    def poses(self, drive: str) -> npt.NDArray[np.float64] | None:
        """Return where each frame of `query` or `reference` was, (N, 7), if the folder says."""
        path = self._base() / 'poses.npz'
        return read_array(path, drive, self.reading) if path.exists() else None

    def thumbnail(self, drive: str, index: int) -> Path | None:
        """Return the small picture of a frame of `query` or `reference`, if there is one."""
        folder = self._base() / 'thumbnails'
        if drive == 'reference' and not (folder / 'reference').is_dir():
            drive = 'query'
        path = folder / drive / f'{index:06d}.jpg'
        return path if path.exists() else None

    def _base(self) -> Path:
        base = self.about_set().get('base')
        return self.folder.parents[1] / base if base else self.folder.parent


def write_text(path: Path, text: str) -> None:
    """Write a file in one step."""
    path.parent.mkdir(parents=True, exist_ok=True)
    with complete_or_absent(path) as part:
        part.write_text(text, encoding='utf-8')


def write_table(path: Path, columns: Iterable[str], rows: Iterable[Mapping[str, object]]) -> None:
    """Write a CSV table in one step."""
    path.parent.mkdir(parents=True, exist_ok=True)
    with complete_or_absent(path) as part, part.open('w', newline='', encoding='utf-8') as file:
        table = csv.DictWriter(file, list(columns), lineterminator='\n', extrasaction='ignore')
        table.writeheader()
        table.writerows(rows)


def write_json(path: Path, content: Mapping[str, Any]) -> None:
    """Write a JSON file in one step."""
    write_text(path, json.dumps(content, indent=1) + '\n')


def write_truth(folder: Path, truth: Truth) -> None:
    """Write truth.npz into a set's folder."""
    folder.mkdir(parents=True, exist_ok=True)
    with complete_or_absent(folder / 'truth.npz') as part:
        np.savez_compressed(part, right=truth.right)


def write_poses(
    folder: Path, query: Sequence[Pose | None], reference: Sequence[Pose | None]
) -> None:
    """Write poses.npz into a set's folder, if any reference has a pose."""
    if any(reference):
        with complete_or_absent(folder / 'poses.npz') as part:
            np.savez_compressed(part, query=pose_rows(query), reference=pose_rows(reference))


def write_fields(path: Path, fields: Sequence[Dots]) -> None:
    """Write fields.npz, if there are any inliers."""
    if any(map(len, fields)):
        ends = np.cumsum([len(one) for one in fields])
        with complete_or_absent(path) as part:
            np.savez_compressed(part, dots=np.concatenate(fields), ends=ends)


def write_frames(path: Path, outcome: Outcome, verdicts: Verdicts) -> None:
    """Write frames.csv."""
    durations: Sequence[float | None] = outcome.durations_ms or [None] * len(outcome.matches)
    write_table(
        path,
        COLUMNS + EXTRA_COLUMNS,
        (
            {
                **row(match, duration_ms or 0.0),
                'duration_ms': None if duration_ms is None else f'{duration_ms:.3f}',
                'correct': int(verdicts.correct[index]),
                'known': int(verdicts.known[index]),
                'slip': int(verdicts.slip[index]),
                'margin': _margin_text(match),
                'entropy': _entropy_text(outcome, match.query_index),
                'half': outcome.halves[index],
            }
            for index, (match, duration_ms) in enumerate(
                zip(outcome.matches, durations, strict=True)
            )
        ),
    )


def write_scores(path: Path, outcome: Outcome) -> None:
    """Write scores.npy."""
    with complete_or_absent(path) as part:
        np.save(part, outcome.pairs.scores.astype(np.float32), allow_pickle=False)


def write_curve(path: Path, curve: Curve) -> None:
    """Write curve.csv."""
    points = zip(curve.threshold, curve.precision, curve.recall, strict=True)
    names = ('threshold', 'precision', 'recall')
    write_table(
        path,
        names,
        (
            {name: f'{value:.7g}' for name, value in zip(names, point, strict=True)}
            for point in points
        ),
    )


def write_summary_table(folder: Path, summaries: Iterable[Mapping[str, Any]]) -> None:
    """Write summary.csv: every figure that is one number or text."""
    summaries = list(summaries)
    columns = dict.fromkeys(
        name
        for summary in summaries
        for name, value in summary.items()
        if not isinstance(value, Mapping | list)
    )
    rows = []
    for summary in summaries:
        transferred = summary.get('transferred') or {}
        rows.append(
            {
                **summary,
                'transferred': None,
                **{f'transferred_{name}': value for name, value in transferred.items()},
            }
        )
    extra = dict.fromkeys(
        name
        for one in rows
        for name in one
        if name.startswith('transferred_') and name != 'transferred_others'
    )
    names = [name for name in columns if name != 'transferred'] + list(extra)
    write_table(folder / 'summary.csv', names, rows)


def read_table(path: Path, reading: ReadingConfig) -> list[dict[str, str]]:
    """Return a CSV table; SourceError if it cannot be read, csv.Error if it is none."""
    return list(csv.DictReader(io.StringIO(read_text(path, 'a table', reading), newline='')))


def read_run(folder: Path, reading: ReadingConfig = ReadingConfig()) -> list[Run]:
    """
    Return every method on every set in a folder, by name, whose files are not too large.

    Raises
    ------
    SourceError
        If the folder holds no results, or damaged ones.

    """
    runs = []
    for path in sorted(folder.glob('*/*/summary.json')):
        try:
            summary = _read_json(path, reading)
            frames = read_table(path.parent / 'frames.csv', reading)
        except (ValueError, csv.Error) as error:
            raise SourceError(
                f'{path.parent}: damaged results ({error}); evaluate again'
            ) from None
        names = path.parent.parent.name, path.parent.name
        runs.append(Run(*names, path.parent, summary, frames, reading))
    if not runs:
        raise SourceError(f'{folder}: no results of `convseq evaluate` in this folder')
    return runs


def _read_json(path: Path, reading: ReadingConfig) -> Mapping[str, Any]:
    """Return the object in a file; SourceError if it cannot be read, ValueError if it is none."""
    try:
        content = json.loads(read_text(path, 'a JSON file', reading))
    except RecursionError:
        raise ValueError(f'{path.name} is nested too deeply') from None
    if not isinstance(content, Mapping):
        raise ValueError(f'{path.name} holds no object')
    return content


def _margin_text(match: Match) -> str:
    value = margin(match)
    return '' if np.isnan(value) else f'{value:.7f}'


def _entropy_text(outcome: Outcome, index: int) -> str:
    query = outcome.query
    return f'{query.descriptors[index].entropy:.6f}' if query.readable[index] else ''
