# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Writes and reads the folder of `convseq evaluate --output DIR`.

::

    DIR/summary.csv               one row per set and method
    DIR/<set>/set.json            name, title, protocol, tolerance, queries, references, query,
                                  reference, source, base
    DIR/<set>/truth.npy           bool (Q, R), the right references of each query
    DIR/<set>/thumbnails/query/000000.jpg, .../reference/000000.jpg
                                  160 px wide; missing where a frame was unreadable; no reference
                                  folder for a drive against its own past
    DIR/<set>/<method>/frames.csv the result table's columns and those of `EXTRA_COLUMNS`
    DIR/<set>/<method>/summary.json
    DIR/<set>/<method>/scores.npy float32 (Q, R), pair scores, higher is more similar, NaN where a
                                  pair was not scored; absent with half of the map removed
    DIR/<set>/<method>/curve.csv  threshold, precision, recall of the exact curve

With half of the map removed the set is called `<set>-open`. It has three rows per query, one for
each kept half. Its indices are those of the full map. Its `base` names the set with the
thumbnails and the truth of the full map.
"""

from collections.abc import Iterable, Mapping, Sequence
import csv
from dataclasses import dataclass
import io
import json
from pathlib import Path
from typing import Any

from convseq_ros.app.result_row import COLUMNS, row
from convseq_ros.config.reading_config import ReadingConfig
from convseq_ros.core.map.image_coding import thumbnail
from convseq_ros.errors import SourceError
from convseq_ros.evaluation.images import Images
from convseq_ros.evaluation.material import Material
from convseq_ros.evaluation.metrics import Curve
from convseq_ros.evaluation.protocols import OPEN, Outcome, VERSION
from convseq_ros.evaluation.scorecard import margin, Verdicts
from convseq_ros.evaluation.table import check_figures
from convseq_ros.io.files import read_array, read_text
from convseq_ros.io.regular_file import complete_or_absent
import numpy as np
import numpy.typing as npt

THUMBNAIL_PX = 160  # wide
# What results of a set need in common, and how it is called if it differs.
_SAME = {
    'images': 'other images',
    'truth': 'another truth, or part of the map,',
    'criterion': 'another criterion',
}
EXTRA_COLUMNS = ('correct', 'known', 'slip', 'margin', 'entropy', 'half')


@dataclass(frozen=True, slots=True)
class Run:
    """The results of one method on one set, read from a folder."""

    set: str
    method: str
    folder: Path  # DIR/<set>/<method>
    summary: Mapping[str, Any]  # summary.json
    frames: list[dict[str, str]]  # the rows of frames.csv; empty fields are empty strings
    reading: ReadingConfig = ReadingConfig()  # size limits

    def about_set(self) -> Mapping[str, Any]:
        return read_json(self.folder.parent / 'set.json', self.reading)

    def scores(self) -> npt.NDArray[np.float32] | None:
        """Return the pair scores (Q, R), or None if the folder has none."""
        return self._array(self.folder / 'scores.npy')

    def truth(self) -> npt.NDArray[np.bool_] | None:
        """Return the right references (Q, R) in the full map, or None if the folder has none."""
        return self._array(self._base() / 'truth.npy')

    def thumbnail(self, drive: str, index: int) -> Path | None:
        """Return the thumbnail of a frame of `query` or `reference`, or None without one."""
        folder = self._base() / 'thumbnails'
        if drive == 'reference' and not (folder / 'reference').is_dir():
            drive = 'query'
        path = folder / drive / f'{index:06d}.jpg'
        return path if path.exists() else None

    def _array(self, path: Path) -> Any:
        return read_array(path, self.reading) if path.exists() else None

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
    write_text(path, json.dumps(content, indent=1) + '\n')


def write_set(folder: Path, material: Material) -> None:
    """Write the files of a set that do not depend on the method: truth and thumbnails."""
    _write_array(folder / 'truth.npy', material.truth.right)
    _write_thumbnails(folder / 'thumbnails' / 'query', material.query)
    if not material.data_set.online:
        _write_thumbnails(folder / 'thumbnails' / 'reference', material.reference)


def write_run(folder: Path, outcome: Outcome, verdicts: Verdicts, curve: Curve) -> None:
    """Write the answers of a method, and its curve."""
    _write_frames(folder / 'frames.csv', outcome, verdicts)
    if outcome.protocol != OPEN:
        _write_array(folder / 'scores.npy', outcome.pairs.scores.astype(np.float32))
    names = ('threshold', 'precision', 'recall')
    points = zip(curve.threshold, curve.precision, curve.recall, strict=True)
    texts = ([f'{value:.7g}' for value in point] for point in points)
    table = (dict(zip(names, point, strict=True)) for point in texts)
    write_table(folder / 'curve.csv', names, table)


def _write_array(path: Path, array: npt.NDArray[Any]) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    with complete_or_absent(path) as part:
        np.save(part, array, allow_pickle=False)


def _write_frames(path: Path, outcome: Outcome, verdicts: Verdicts) -> None:
    rows, query = [], outcome.query
    durations: Sequence[float | None] = outcome.durations_ms or [None] * len(outcome.matches)
    for index, (match, duration_ms) in enumerate(zip(outcome.matches, durations, strict=True)):
        number, query_margin = match.query_index, margin(match)
        entropy = f'{query.descriptors[number].entropy:.6f}' if query.readable[number] else ''
        rows.append(
            {
                **row(match, duration_ms or 0.0),
                'duration_ms': None if duration_ms is None else f'{duration_ms:.3f}',
                'correct': int(verdicts.correct[index]),
                'known': int(verdicts.known[index]),
                'slip': int(verdicts.slip[index]),
                'margin': '' if np.isnan(query_margin) else f'{query_margin:.7f}',
                'entropy': entropy,
                'half': outcome.halves[index],
            }
        )
    write_table(path, COLUMNS + EXTRA_COLUMNS, rows)


def _write_thumbnails(folder: Path, images: Images) -> None:
    """Write one JPEG for every readable frame."""
    folder.mkdir(parents=True, exist_ok=True)
    for old in folder.glob('*.jpg'):
        old.unlink()
    for index, frame in enumerate(images):
        if frame.gray is not None:
            (folder / f'{index:06d}.jpg').write_bytes(thumbnail(frame.gray, THUMBNAIL_PX))


def write_exports(folder: Path, summaries: Iterable[Mapping[str, Any]]) -> None:
    """Write <set>-<method>.json per summary, for comparison with other runs."""
    for summary in summaries:
        write_json(folder / f'{summary["set"]}-{summary["method"]}.json', summary)


def read_exports(paths: Iterable[Path], reading: ReadingConfig) -> list[Mapping[str, Any]]:
    """Return exported summaries, set by set; SourceError if they cannot be compared."""
    by_set: dict[str, list[Mapping[str, Any]]] = {}
    for path in paths:
        try:
            summary = read_json(path, reading)
            version = summary['protocol_version']
            name, _ = str(summary['set']), str(summary['method'])
            check_figures(summary)
        except (ValueError, TypeError, LookupError, AttributeError, ArithmeticError) as error:
            raise SourceError(f'{path}: not an export of `convseq evaluate` ({error})') from None
        if version != VERSION:
            raise SourceError(
                f'{path}: protocol version {version}, and this program has {VERSION}; '
                'evaluate again with one program'
            )
        by_set.setdefault(name, []).append(summary)
        refuse_other(summary, by_set[name][0], path)
    return [summary for exports in by_set.values() for summary in exports]


def refuse_other(summary: Mapping[str, Any], first: Mapping[str, Any], path: Path) -> None:
    """Raise a SourceError if results are not comparable with the first ones of their set."""
    for key, what in _SAME.items():
        if summary.get(key) != first.get(key):
            raise SourceError(
                f'{path}: {first.get("set")} has {what} than in the results before; compare '
                'figures of the same'
            )


def write_summary_table(folder: Path, summaries: Iterable[Mapping[str, Any]]) -> None:
    """Write summary.csv: every figure that is a single number or text."""
    summaries = list(summaries)
    columns = dict.fromkeys(name for summary in summaries for name in summary)
    for summary in summaries:
        for name, value in summary.items():
            if isinstance(value, Mapping | list):
                columns.pop(name, None)
    write_table(folder / 'summary.csv', columns, summaries)


def read_table(path: Path, reading: ReadingConfig) -> list[dict[str, str]]:
    """Return a CSV table; SourceError if it cannot be read, csv.Error if it is no table."""
    return list(csv.DictReader(io.StringIO(read_text(path, 'a table', reading), newline='')))


def read_run(folder: Path, reading: ReadingConfig = ReadingConfig()) -> list[Run]:
    """Return all runs in a folder, by name; SourceError if there are none, or one is damaged."""
    runs = []
    for path in sorted(folder.glob('*/*/summary.json')):
        try:
            summary = read_json(path, reading)
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


def read_json(path: Path, reading: ReadingConfig) -> Mapping[str, Any]:
    """Return the object in a JSON file; SourceError if unreadable, ValueError if not an object."""
    try:
        content = json.loads(read_text(path, 'a JSON file', reading))
    except RecursionError:
        raise ValueError(f'{path.name} is nested too deeply') from None
    if not isinstance(content, Mapping):
        raise ValueError(f'{path.name} holds no object')
    return content
