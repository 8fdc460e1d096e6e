# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
What a worker does of a fleet: it holds some maps, its shards, and answers for them together.

A question holds all that is needed to answer it. What is remembered of earlier ones saves time
only, so that a worker that has just begun answers as one that has known the whole drive.
"""

from collections import OrderedDict
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from convseq_ros.config import EncodingConfig, KeyframeConfig
from convseq_ros.core.compiled import kernels_of
from convseq_ros.core.map.format import MapSession
from convseq_ros.core.map.place import Packed, Place
from convseq_ros.core.map.reader import open_map
from convseq_ros.core.sequence.centred import Centred, sums_of, Usual
from convseq_ros.core.sequence.coarse_sums import all_sums, Asked, best_sums, Spread, Sums
from convseq_ros.core.sequence.diagonals import Values
from convseq_ros.core.sequence.indexed import centred
from convseq_ros.core.types import Indices, Row
from convseq_ros.errors import MapError
import numpy as np
import numpy.typing as npt

_LARGE = 'thumbnail', 'image', 'depths'  # of a picture, beside its cells
KEPT_ROWS = 32  # of coarse scores, at least; a sequence has 25 at most, by default


@dataclass(frozen=True, eq=False, slots=True)
class About:
    """What a fleet must know of a shard."""

    count: int
    encoding: EncodingConfig
    keyframes: KeyframeConfig
    sessions: tuple[MapSession, ...]
    starts: Indices  # of the sessions that have places
    sums: npt.NDArray[np.float64]  # of its global descriptors, (2, n)


@dataclass(frozen=True, eq=False, slots=True)
class Direction:
    """In which direction references lie that are like a frame; stands for its coarse scores."""

    key: str  # of this frame of this drive, alone in the world
    numbers: npt.NDArray[np.float32]  # (n,)
    count: int  # references of the whole fleet

    def __len__(self) -> int:
        return self.count


@dataclass(frozen=True, eq=False, slots=True)
class Question:
    """What is asked of every shard."""

    key: str  # of what is usual
    usual: Usual
    rows: Sequence[Direction | None] = ()  # newest first, for the peaks
    steps: Values | None = None
    asked: Sequence[Asked] = ()  # their rows are directions, their known ends are the fleet's
    means: Mapping[str, Any] | None = None  # of rows, by their keys
    index_above: int = 0  # places of a shard


@dataclass(frozen=True, eq=False, slots=True)
class Answer:
    """What some shards say together."""

    # Of each row that was asked for: the sum of its scores, and how many are known.
    totals: Mapping[str, tuple[float, int]]
    peaks: Values | None = None  # (V, 3): highest score, sum of scores, how many
    sums: Sequence[Sums] = ()


@dataclass(frozen=True, eq=False, slots=True)
class Pictures:
    """What is known of some places."""

    places: Sequence[Place]  # session counts from the map's own first
    packed: Packed  # (n, S, S, 8)
    thumbnails: Sequence[bytes]
    # Kept images and depths, None where there are none, or they were not asked for.
    images: Sequence[bytes | None]
    depths: Sequence[bytes | None]


class Shard:
    """One map; MapError if it cannot be opened, or is found damaged later."""

    def __init__(self, path: Path) -> None:
        self._map = open_map(path)
        self._rows = OrderedDict[str, Row]()
        self._usual = ''
        self._centred: Centred | None = None

    def about(self) -> About:
        """Return what the fleet must know."""
        own = self._map
        sessions, starts = tuple(own.sessions), own.bounds.starts
        settings = len(own), own.encoding, own.keyframes
        return About(*settings, sessions, starts, sums_of(own.global_descriptors))

    def answer(self, question: Question, offset: int) -> Answer:
        """Answer of a map whose first place has a number in the fleet."""
        if question.key != self._usual:
            self._usual, self._rows = question.key, OrderedDict()
            own = self._map.global_descriptors, self._map.bounds.starts
            self._centred = centred(question.usual, *own, question.index_above)
        rows = [*map(self._row, question.rows)]
        totals = {
            one.key: (float(np.nansum(row, dtype=np.float64)), int(np.isfinite(row).sum()))
            for one, row in zip(question.rows[:1], rows, strict=False)
            if one is not None and row is not None
        }
        peaks = None
        if question.steps is not None:
            package = 'convseq_ros.core.sequence'
            peaks = kernels_of(package).peaks(rows, question.steps, self._map.bounds.starts)
            peaks[:, 1] *= peaks[:, 2]
        sums = [self._sums(one, question.means, offset) for one in question.asked]
        self._forget(question)
        return Answer(totals, peaks, sums)

    def pictures(self, indices: Sequence[int], with_images: bool = False) -> Pictures:
        """Return what is known of some places."""
        found = self._map.pictures(indices, with_images)
        packed = np.stack([one.packed for one in found])
        places = [self._map.places[index] for index in indices]
        each = ([getattr(one, name) for one in found] for name in _LARGE)
        return Pictures(places, packed, *each)

    def _row(self, direction: Direction | None) -> Row | None:
        if direction is None or self._centred is None:
            return None
        row = self._rows.get(direction.key)
        if row is None:
            own = self._map.global_descriptors, self._map.bounds.starts
            row = self._centred.row(*own, direction.numbers)
            self._rows[direction.key] = row
        self._rows.move_to_end(direction.key)
        return row

    def _forget(self, question: Question) -> None:
        """Forget rows that were used longest ago, but for as many as a question has."""
        most = max(KEPT_ROWS, len(question.rows), *(len(one.rows) for one in question.asked), 0)
        while len(self._rows) > most:
            self._rows.popitem(last=False)

    def _sums(self, asked: Asked, means: Mapping[str, Any] | None, offset: int) -> Sums:
        count, known = len(self._map), asked.known - offset
        means_of = [0.0 if one is None or means is None else means[one.key] for one in asked.rows]
        own = replace(asked, rows=[*map(self._row, asked.rows)])  # known to any shard: a spread
        found = all_sums(own, self._map.bounds, means_of)
        here = known[(known >= 0) & (known < count)]
        found = best_sums(replace(own, known=here), found)
        return replace(found, ends=found.ends + offset)


@dataclass(frozen=True, eq=False, slots=True)
class Call:
    """A method of a holder, and its arguments: one object, which Dask does not take to pieces."""

    method: str
    what: tuple[Any, ...]


class Holder:
    """The shards of one worker, some maps in the fleet's order; an actor of Dask."""

    def __init__(self, paths: Sequence[str]) -> None:
        self._shards, self._lost = dict[str, Shard](), dict[str, str]()
        for path in paths:
            try:
                self._shards[path] = Shard(Path(path))
            except (MapError, OSError) as error:
                self._lost[path] = str(error)

    def ask(self, call: Call) -> Any:
        """Return what a method returns."""
        return getattr(self, call.method)(*call.what)

    def about(self) -> tuple[dict[str, About], dict[str, str]]:
        """Return what is known of each map, and why others cannot be opened."""
        return {path: shard.about() for path, shard in self._shards.items()}, self._lost

    def answer(self, question: Question, offsets: Mapping[str, int]) -> Answer:
        """Answer for some of the maps together."""
        there = {path: offset for path, offset in offsets.items() if path in self._shards}
        return merged(
            [self._shards[path].answer(question, offset) for path, offset in there.items()],
            question,
        )

    def pictures(
        self, wanted: Mapping[str, Sequence[int]], with_images: bool
    ) -> dict[str, Pictures | str]:
        """Return what is known of some places of maps, or why they cannot be read."""
        found = dict[str, Pictures | str]()
        for path, indices in wanted.items():
            try:
                found[path] = self._shards[path].pictures(indices, with_images)
            except MapError as error:
                found[path] = str(error)
        return found


def merged(answers: Sequence[Answer], question: Question) -> Answer:
    """Return what shards in the fleet's order say together."""
    totals: dict[str, tuple[float, int]] = {}
    for answer in answers:
        for key, (total, count) in answer.totals.items():
            before = totals.get(key, (0.0, 0))
            totals[key] = before[0] + total, before[1] + count
    sums = []
    for number in range(len(question.asked)):
        parts = [answer.sums[number] for answer in answers]
        ends = np.concatenate([np.zeros(0, np.int64), *(one.ends for one in parts)])
        scores = np.concatenate([np.zeros(0, np.float32), *(one.scores for one in parts)])
        sums.append(Sums(ends, scores, sum((one.spread for one in parts), Spread())))
    if question.steps is None:
        return Answer(totals, None, sums)
    peaks = np.zeros((len(question.steps), 3))
    for answer in answers:
        if answer.peaks is not None:
            there = answer.peaks[:, 2] > 0
            higher = there & ((peaks[:, 2] == 0) | (answer.peaks[:, 0] > peaks[:, 0]))
            peaks[higher, 0] = answer.peaks[higher, 0]
            peaks[there, 1:] += answer.peaks[there, 1:]
    return Answer(totals, peaks, sums)
