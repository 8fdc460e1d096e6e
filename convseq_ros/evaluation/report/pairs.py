# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What the browser of matched pairs shows: one row for every frame, and the pictures once."""

import base64
from collections.abc import Mapping, Sequence
from itertools import islice
from pathlib import Path

from convseq_ros.evaluation.geometry import Dots
from convseq_ros.evaluation.report.poses import in_words
from convseq_ros.evaluation.report.verdict import Seen
from convseq_ros.evaluation.run_folder import Run
from convseq_ros.reading_config import ReadingConfig
from convseq_ros.regular_file import read_bytes

FIELDS = (
    'query', 'verdict', 'best', 'truth', 'correct', 'known', 'slip', 'length', 'score', 'margin',
    'entropy', 'reason', 'half', 'inliers',
)  # fmt: skip
_PICTURES = ('query_picture', 'best_picture', 'truth_picture')


class Pictures:
    """Thumbnails as data URIs, each one held once however many runs show it."""

    def __init__(self, reading: ReadingConfig) -> None:
        self._reading = reading
        self._places: dict[str, int] = {}
        self._numbers: dict[Path, int | None] = {}

    @property
    def uris(self) -> list[str]:
        """What is held, in the order of the numbers."""
        return list(self._places)

    def number(self, path: Path | None) -> int | None:
        """Return the place of a thumbnail in `uris`; None if there is none to show."""
        if path is None:
            return None
        if path not in self._numbers:
            self._numbers[path] = self._read(path)
        return self._numbers[path]

    def _read(self, path: Path) -> int | None:
        content = read_bytes(path, 'a thumbnail', self._reading.refuse_file)
        whole = content.startswith(b'\xff\xd8\xff') and content.endswith(b'\xff\xd9')
        if not whole:
            return None
        uri = f'data:image/jpeg;base64,{base64.b64encode(content).decode()}'
        return self._places.setdefault(uri, len(self._places))


def browser_data(
    runs: Sequence[Run], rows: Mapping[tuple[str, str], Sequence[Seen]], step: int
) -> dict[str, object]:
    """Return what the script needs; only every `step`-th frame is kept."""
    pictures = Pictures(runs[0].reading)
    told = [
        {
            'set': run.set,
            'method': run.method,
            'rows': [
                [
                    *(getattr(one, field) for field in FIELDS),
                    *_numbers(pictures, run, one),
                    in_words(row),
                    _packed(dots),
                ]
                for one, row, dots in islice(
                    zip(rows[run.set, run.method], run.frames, run.fields(), strict=True),
                    0,
                    None,
                    step,
                )
            ],
        }
        for run in runs
    ]
    return {
        'fields': [*FIELDS, *_PICTURES, 'pose', 'dots'],
        'pictures': pictures.uris,
        'runs': told,
    }


def _packed(dots: Dots) -> str:
    return base64.b64encode(dots.tobytes()).decode()


def _numbers(pictures: Pictures, run: Run, one: Seen) -> list[int | None]:
    shown = (('query', one.query), ('reference', one.best), ('reference', one.truth))
    return [
        pictures.number(None if index is None else run.thumbnail(drive, index))
        for drive, index in shown
    ]
