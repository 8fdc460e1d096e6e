# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The worker's side: it holds some maps, its shards, and answers for them together."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from convseq_ros.config import EncodingConfig, KeyframeConfig
from convseq_ros.core.map.format import MapSession
from convseq_ros.core.map.place import Picture
from convseq_ros.core.map.reader import open_map
from convseq_ros.core.retrieval.coarse_scores import top
from convseq_ros.core.retrieval.track import Track
from convseq_ros.core.retrieval.whitening import Statistics, sums_of, WhitenedReferences
from convseq_ros.core.types import Floats, Indices, Row
from convseq_ros.errors import MapError
import numpy as np
import numpy.typing as npt

# Frames to rebuild a track from: earlier ones have the weight 0.8**256, less than a bit.
KEPT = 256


@dataclass(frozen=True, eq=False, slots=True)
class About:
    """A shard's description for its fleet."""

    encoding: EncodingConfig
    keyframes: KeyframeConfig
    sessions: Sequence[MapSession]
    count: int
    columns: Mapping[str, Any]  # of its places, as in `Places`
    links: Sequence[tuple[int, int]]  # places and their anchors
    sums: npt.NDArray[np.float64]  # of its global descriptors, (2, n)


@dataclass(frozen=True, eq=False, slots=True)
class Question:
    """A question to every shard: which places the newest frame of a drive may show."""

    usual: Statistics
    both: bool  # whether drives may pass the map in both directions
    camera: int
    drive: int  # of the camera
    frame: int  # number of frames of the drive so far
    directions: Sequence[Floats]  # of the last frames in descriptor space, the newest last
    along: int  # number of places wanted by the drive so far
    newest: int  # number of places wanted by the newest frame
    passed: Sequence[range] = ()  # the fleet's places to leave out


Best = tuple[Indices, Row]  # places of the fleet and their scores, best first; ties by index
# By the drive so far, and by the newest frame; None if a shard lacks frames of the drive.
Answer = tuple[Best, Best] | None


@dataclass(eq=False, slots=True)
class DriveState:
    """A shard's state of a drive."""

    drive: int
    track: Track
    frame: int = 0
    row: Row = field(default_factory=lambda: np.zeros(0, np.float32))


class Shard:
    """One map; MapError if it cannot be opened, or turns out to be damaged later."""

    def __init__(self, path: Path) -> None:
        self._map = open_map(path)
        self._whitened: WhitenedReferences | None = None
        self._drives = dict[int, DriveState]()  # by camera

    def about(self) -> About:
        opened = self._map
        settings = opened.encoding, opened.keyframes, tuple(opened.sessions), len(opened)
        sums = sums_of(opened.global_descriptors)
        return About(*settings, opened.places.columns, tuple(opened.links), sums)

    def answer(self, question: Question, offset: int) -> Answer:
        """Answer for this map, whose first place has the index `offset` in the fleet."""
        if (state := self._updated(question)) is None:
            return None
        passed = [range(run.start - offset, run.stop - offset) for run in question.passed]
        sums, row = state.track.sums, state.row
        along, newest = top(sums, question.along, passed), top(row, question.newest, passed)
        return (along + offset, sums[along]), (newest + offset, row[newest])

    def pictures(self, indices: Sequence[int], with_images: bool = False) -> list[Picture]:
        return self._map.pictures(indices, with_images)

    def _updated(self, question: Question) -> DriveState | None:
        """Return the state of a drive after its newest frame; None if frames are missing."""
        references, starts = self._map.global_descriptors, self._map.bounds.starts
        centred = self._whitened = self._whitened or WhitenedReferences(
            question.usual, references, starts
        )
        state, count = self._drives.get(question.camera), len(question.directions)
        if state is None or state.drive != question.drive:
            state = DriveState(question.drive, Track(question.both))
        new = question.frame - state.frame
        if new > count:
            if count < min(question.frame, KEPT):
                return None
            state, new = DriveState(question.drive, Track(question.both)), count
        for direction in question.directions[count - new :]:
            state.row = centred.row(references, starts, direction)
            state.track.update(state.row, starts)
        state.frame = question.frame
        self._drives[question.camera] = state
        return state


@dataclass(frozen=True, eq=False, slots=True)
class Call:
    """A method of a holder and its arguments, in one object that Dask does not take apart."""

    method: str
    arguments: tuple[Any, ...]


class Holder:
    """The shards of one worker, in the fleet's order; an actor of Dask."""

    def __init__(self, paths: Sequence[str]) -> None:
        self._shards, self._lost = dict[str, Shard](), dict[str, str]()
        for path in paths:
            try:
                self._shards[path] = Shard(Path(path))
            except (MapError, OSError) as error:
                self._lost[path] = str(error)

    def ask(self, call: Call) -> Any:
        return getattr(self, call.method)(*call.arguments)

    def about(self) -> tuple[dict[str, About], dict[str, str]]:
        return {path: shard.about() for path, shard in self._shards.items()}, self._lost

    def answer(self, question: Question, offsets: Mapping[str, int]) -> Answer:
        """Answer for some of the maps together."""
        held = [(self._shards[path], at) for path, at in offsets.items() if path in self._shards]
        return merged([shard.answer(question, offset) for shard, offset in held], question)

    def pictures(
        self, wanted: Mapping[str, Sequence[int]], with_images: bool
    ) -> dict[str, list[Picture] | str]:
        pictures = dict[str, list[Picture] | str]()
        for path, indices in wanted.items():
            try:
                pictures[path] = self._shards[path].pictures(indices, with_images)
            except MapError as error:
                pictures[path] = str(error)
        return pictures


def merged(answers: Sequence[Answer], question: Question) -> Answer:
    complete = [answer for answer in answers if answer]
    if len(complete) < len(answers):
        return None
    along = _best([best for best, _ in complete], question.along)
    return along, _best([best for _, best in complete], question.newest)


def _best(parts: Sequence[Best], count: int) -> Best:
    places = np.concatenate([np.zeros(0, np.int64), *(indices for indices, _ in parts)])
    scores = np.concatenate([np.zeros(0, np.float32), *(row for _, row in parts)])
    order = np.lexsort((places, -scores))[:count]
    return places[order], scores[order]
