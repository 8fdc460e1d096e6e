# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What a worker does: it holds some maps, its shards, and answers for them together."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from convseq_ros.config import EncodingConfig, KeyframeConfig
from convseq_ros.core.map.format import MapSession
from convseq_ros.core.map.place import Picture
from convseq_ros.core.map.reader import open_map
from convseq_ros.core.sequence.coarse_scores import Centred, sums_of, top, Track, Usual
from convseq_ros.core.types import Floats, Indices, Row
from convseq_ros.errors import MapError
import numpy as np
import numpy.typing as npt

# Frames that a track can be made of anew: what came before counts .8**256 of a score, no bit.
KEPT = 256


@dataclass(frozen=True, eq=False, slots=True)
class About:
    """What a fleet must know of a shard."""

    encoding: EncodingConfig
    keyframes: KeyframeConfig
    sessions: Sequence[MapSession]
    count: int
    columns: Mapping[str, Any]  # of its places, as of `Places`
    links: Sequence[tuple[int, int]]  # places and their anchors
    sums: npt.NDArray[np.float64]  # of its global descriptors, (2, n)


@dataclass(frozen=True, eq=False, slots=True)
class Question:
    """What is asked of every shard: which places the newest frame of a drive may show."""

    usual: Usual
    both: bool  # directions of a drive along a map
    camera: int
    drive: int  # of the camera
    frame: int  # how many of the drive there were
    directions: Sequence[Floats]  # in which places lie like the last frames, the newest last
    along: int  # places, by the drive so far
    newest: int  # places, by the newest frame
    passed: Sequence[range] = ()  # of the fleet's places


Best = tuple[Indices, Row]  # places of the fleet, and their scores, the best first; ties by number
# Of some shards, by the drive so far, and by the newest frame; None if frames of the drive lack.
Answer = tuple[Best, Best] | None


@dataclass(eq=False, slots=True)
class Known:
    """What a shard knows of a drive."""

    drive: int
    track: Track
    frame: int = 0
    row: Row = field(default_factory=lambda: np.zeros(0, np.float32))


class Shard:
    """One map; MapError if it cannot be opened, or is found damaged later."""

    def __init__(self, path: Path) -> None:
        self._map = open_map(path)
        self._centred: Centred | None = None
        self._known = dict[int, Known]()  # by camera

    def about(self) -> About:
        own = self._map
        settings = own.encoding, own.keyframes, tuple(own.sessions), len(own)
        return About(
            *settings, own.places.columns, tuple(own.links), sums_of(own.global_descriptors)
        )

    def answer(self, question: Question, offset: int) -> Answer:
        """Answer of a map whose first place has a number in the fleet."""
        if (known := self._followed(question)) is None:
            return None
        passed = [range(one.start - offset, one.stop - offset) for one in question.passed]
        sums, row = known.track.sums, known.row
        along, newest = top(sums, question.along, passed), top(row, question.newest, passed)
        return (along + offset, sums[along]), (newest + offset, row[newest])

    def pictures(self, indices: Sequence[int], with_images: bool = False) -> list[Picture]:
        return self._map.pictures(indices, with_images)

    def _followed(self, question: Question) -> Known | None:
        """Return what is known of a drive up to its newest frame; None if frames lack."""
        references, starts = self._map.global_descriptors, self._map.bounds.starts
        centred = self._centred = self._centred or Centred(question.usual, references, starts)
        known, told = self._known.get(question.camera), len(question.directions)
        if known is None or known.drive != question.drive:
            known = Known(question.drive, Track(question.both))
        new = question.frame - known.frame
        if new > told:
            if told < min(question.frame, KEPT):
                return None
            known, new = Known(question.drive, Track(question.both)), told
        for direction in question.directions[told - new :]:
            known.row = centred.row(references, starts, direction)
            known.track.update(known.row, starts)
        known.frame = question.frame
        self._known[question.camera] = known
        return known


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
        return getattr(self, call.method)(*call.what)

    def about(self) -> tuple[dict[str, About], dict[str, str]]:
        return {path: shard.about() for path, shard in self._shards.items()}, self._lost

    def answer(self, question: Question, offsets: Mapping[str, int]) -> Answer:
        """Answer for some of the maps together."""
        there = [(self._shards[path], at) for path, at in offsets.items() if path in self._shards]
        return merged([shard.answer(question, offset) for shard, offset in there], question)

    def pictures(
        self, wanted: Mapping[str, Sequence[int]], with_images: bool
    ) -> dict[str, list[Picture] | str]:
        found = dict[str, list[Picture] | str]()
        for path, indices in wanted.items():
            try:
                found[path] = self._shards[path].pictures(indices, with_images)
            except MapError as error:
                found[path] = str(error)
        return found


def merged(answers: Sequence[Answer], question: Question) -> Answer:
    whole = [one for one in answers if one]
    if len(whole) < len(answers):
        return None
    along = _best([one for one, _ in whole], question.along)
    return along, _best([one for _, one in whole], question.newest)


def _best(parts: Sequence[Best], count: int) -> Best:
    places = np.concatenate([np.zeros(0, np.int64), *(one for one, _ in parts)])
    scores = np.concatenate([np.zeros(0, np.float32), *(one for _, one in parts)])
    order = np.lexsort((places, -scores))[:count]
    return places[order], scores[order]
