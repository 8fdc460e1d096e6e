# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The page of what was matched: confidence over time, map and drive from above, and pairs."""

from base64 import b64encode
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from html import escape
import json
from pathlib import Path
from typing import Any

from convseq_ros.core.types import constants
from convseq_ros.evaluation.report.pairs import Pair
from convseq_ros.evaluation.report.template import photos, write_page
import numpy as np

Texts = tuple[str, str, str]  # about the answer, the frame and the place
Row = list[Any]  # of the page's script: kind, texts, pictures, regions, keypoints, position


@constants
class PAGE:
    """Limits that keep a page of 5,000 frames below 20 MB."""

    pair_bytes: int = 18_000_000  # of all pairs, as base64
    other_bytes: int = 5_000_000  # of those that are no matches
    text_bytes: int = 300  # of a pair
    few: int = 1000  # frames up to which pictures are wide
    wide_px: int = 240
    narrow_px: int = 128


class _Pairs:
    """Rows of which all, or evenly every n-th one, are kept: twice as many as fit at most."""

    def __init__(self) -> None:
        self.offered, self._rows, self._step, self._bytes = 0, dict[int, Row](), 1, 0

    def offer(self, make: Callable[[], Row]) -> None:
        self.offered += 1
        if (at := self.offered - 1) % self._step:
            return
        self._rows[at] = make()
        self._bytes += size_of([self._rows[at]])
        if self._bytes > 2 * PAGE.pair_bytes:
            self._step *= 2
            self._rows = {at: row for at, row in self._rows.items() if at % self._step == 0}
            self._bytes = sum(size_of([row]) for row in self._rows.values())

    def fitting(self, most_bytes: int) -> list[Row]:
        """Return all rows, or evenly as many as take so many bytes of a page."""
        rows = kept = [*self._rows.values()]
        while size_of(rows) > most_bytes:
            count = int(0.97 * len(rows))
            rows = [kept[at] for at in np.linspace(0, len(kept) - 1, count).astype(int)]
        return rows


def size_of(rows: Sequence[Row]) -> int:
    """Return how many bytes rows take of a page, which holds each picture of a place once."""
    places = sum(map(len, {row[5] for row in rows}))
    return places + sum(PAGE.text_bytes + sum(map(len, (row[4], *row[6:8]))) for row in rows)


class MatchPage:
    """
    Collects frames or links in order, and writes their page.

    `expected` is about how many come, `match` the kind that is a match, `colors` are by kind.
    """

    def __init__(self, expected: int, match: str, colors: Mapping[str, str]) -> None:
        self.width_px = PAGE.wide_px if expected <= PAGE.few else PAGE.narrow_px
        self.kinds, self.pictured = list[str](), set[bool]()  # whether places have a picture
        self._heights, self._at = list[float | None](), list[float]()
        self._match, self._colors = match, colors
        self._matches, self._others = _Pairs(), _Pairs()

    def add(
        self,
        kind: str,
        confidence: float | None,
        at: float,
        make: Callable[[], tuple[Texts, Pair]] | None = None,
    ) -> None:
        """Add a frame at a time or place; `make`, if it has candidates, returns its pair."""
        position = len(self.kinds)
        self.kinds.append(kind)
        self._heights.append(None if confidence is None else round(100 * confidence, 1))
        self._at.append(round(at, 2))
        if make is None:
            return

        def row(make: Callable[[], tuple[Texts, Pair]] = make) -> Row:
            texts, pair = make()
            self.pictured.add(bool(pair[1]))
            return [kind, *texts, *(b64encode(part).decode() for part in pair), position]

        (self._matches if kind == self._match else self._others).offer(row)

    def write(
        self,
        output: Path,
        title: str,
        facts: Sequence[str],
        above: str,
        about: Mapping[str, Any],
        strip: str,
        axis: str = '',
        threshold: float | None = None,
        order: Callable[[int], Any] = int,
    ) -> None:
        """
        Write the page in one step.

        `above` is a drawing, or empty; `about` says how it was made. `strip` explains the strip,
        and `axis` is the unit of `at`. Pairs are sorted by `order` of their positions.
        """
        counts, pairs = Counter(self.kinds), (self._matches, self._others)
        offered, numbers = sum(one.offered for one in pairs), dict[str, int]()
        others = self._others.fitting(PAGE.other_bytes)
        kept = self._matches.fitting(PAGE.pair_bytes - size_of(others)) + others
        kept.sort(key=lambda row: order(row[-1]))

        def number(picture: str) -> int | None:
            return numbers.setdefault(picture, len(numbers)) if picture else None

        rows = [[*row[:4], number(row[4]), number(row[5]), *row[6:]] for row in kept]
        kinds = [kind for kind in self._colors if counts[kind]]
        legend = ''.join(
            f'<span><i style="background:{color}"></i>{escape(kind)} {counts[kind]}</span>'
            for kind, color in self._colors.items()
            if counts[kind]
        )
        told = json.dumps(about, indent=1)
        few = f'To keep this page small, {len(rows)} of {offered} pairs are here, evenly. '
        parts = {
            'title': escape(title),
            'facts': escape(' · '.join(facts)),
            'links': '',
            'summary': '',
            'sections': f'<figure><canvas id="strip"></canvas><figcaption>{escape(strip)} A click '
            f'shows the nearest pair.</figcaption></figure><p class="legend">{legend}</p>',
            'note': few * (len(rows) < offered) + _MARKS,
            'photos': photos('Frame', 'Place'),
            'more': _ABOVE.format(above) if above else '',
            'sources': f'<details><summary>settings</summary><pre>{escape(told)}</pre></details>',
        }
        graph = {
            'kinds': [kinds.index(kind) for kind in self.kinds],
            'heights': self._heights,
            'at': self._at,
            'colors': self._colors,
            'axis': axis,
            'threshold': None if threshold is None else 100 * threshold,
        }
        runs = [{'set': title, 'method': 'pairs', 'rows': rows}]
        pictures = [f'data:image/jpeg;base64,{picture}' for picture in numbers]
        data = {'runs': runs, 'pictures': pictures, 'kinds': kinds, 'strip': graph}
        write_page(output, parts, data)


_ABOVE = (
    '<section><h2>From above</h2><figure>{}<figcaption>Arcs lead from where the frame was to its '
    'place. A click on one shows its pair.</figcaption></figure></section>'
)
_MARKS = (
    'Of one colour in both pictures: '
    '<label><input type="checkbox" checked data-mark="region"> agreeing regions</label> '
    '<label><input type="checkbox" checked data-mark="keypoint"> agreeing keypoints</label>'
)
