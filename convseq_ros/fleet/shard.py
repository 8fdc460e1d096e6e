# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The worker's side: it holds some maps, its shards, and answers for them together."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from convseq_ros.config import EncodingConfig, KeyframeConfig
from convseq_ros.core.map.format import MapSession
from convseq_ros.core.map.kept_keypoints import has_keypoints
from convseq_ros.core.map.place import Picture
from convseq_ros.core.map.reader import open_map
from convseq_ros.core.retrieval.whitening import Statistics, sums_of, WhitenedReferences
from convseq_ros.core.types import Doubles, Floats, Row
from convseq_ros.errors import MapError


@dataclass(frozen=True, eq=False, slots=True)
class About:
    """A shard's description for its fleet."""

    encoding: EncodingConfig
    keyframes: KeyframeConfig
    sessions: Sequence[MapSession]
    count: int
    columns: Mapping[str, Any]  # of its places, as in `Places`
    links: Sequence[tuple[int, int]]  # places and their anchors
    sums: Doubles  # of its global descriptors, (2, n)
    has_keypoints: bool


class Shard:
    """One map; MapError if it cannot be opened, or turns out to be damaged later."""

    def __init__(self, path: Path) -> None:
        self._map = open_map(path)
        self._whitened: WhitenedReferences | None = None

    def about(self) -> About:
        opened = self._map
        settings = opened.encoding, opened.keyframes, tuple(opened.sessions), len(opened)
        sums = sums_of(opened.global_descriptors)
        content = opened.places.columns, tuple(opened.links), sums, has_keypoints(opened)
        return About(*settings, *content)

    def row(self, direction: Floats, statistics: Statistics) -> Row:
        """Return the coarse scores of all places with a query's direction in descriptor space."""
        references, starts = self._map.global_descriptors, self._map.bounds.starts
        self._whitened = self._whitened or WhitenedReferences(statistics, references, starts)
        return self._whitened.row(references, starts, direction)

    def pictures(self, indices: Sequence[int], with_images: bool = False) -> list[Picture]:
        return self._map.pictures(indices, with_images)


class Holder:
    """The shards of one worker, in the fleet's order; an actor of Dask."""

    def __init__(self, paths: Sequence[str]) -> None:
        self._shards, self._lost = dict[str, Shard](), dict[str, str]()
        for path in paths:
            try:
                self._shards[path] = Shard(Path(path))
            except (MapError, OSError) as error:
                self._lost[path] = str(error)

    def about(self) -> tuple[dict[str, About], dict[str, str]]:
        return {path: shard.about() for path, shard in self._shards.items()}, self._lost

    def rows(
        self, paths: Sequence[str], direction: Floats, statistics: Statistics
    ) -> dict[str, Row]:
        """Return the coarse scores of some of the maps."""
        return {path: self._shards[path].row(direction, statistics) for path in paths}

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
