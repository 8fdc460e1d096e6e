# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The worker's side of a fleet: functions about maps, which a worker opens once."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from convseq_ros.config import EncodingConfig, KeyframeConfig
from convseq_ros.core.map.format import MapSession
from convseq_ros.core.map.place import Picture
from convseq_ros.core.map.reader import open_map
from convseq_ros.core.map.reference_map import ReferenceMap
from convseq_ros.core.retrieval.whitening import products, Statistics, sums_of, WhitenedReferences
from convseq_ros.core.types import Doubles, Floats, Row
from convseq_ros.errors import MapError
import numpy as np

Version = tuple[str, int]  # of a map: its path, and the time at which its file changed, ns


@dataclass(frozen=True, eq=False, slots=True)
class About:
    """A map's description for its fleet."""

    encoding: EncodingConfig
    keyframes: KeyframeConfig
    sessions: Sequence[MapSession]
    count: int
    columns: Mapping[str, Any]  # of its places, as in `Places`
    links: Sequence[tuple[int, int]]  # places and their anchors
    sums: Doubles  # of its global descriptors, (2, n)


class _Shard:
    """One map, held by a worker."""

    def __init__(self, version: Version) -> None:
        self.version = version
        self.map: ReferenceMap = open_map(Path(version[0]))
        self.whitened: WhitenedReferences | None = None


_HELD = dict[str, _Shard]()  # by path; the newest version


def _held(version: Version) -> _Shard:
    """Return an open map; MapError or OSError if it cannot be opened."""
    shard = _HELD.get(version[0])
    if shard is None or shard.version != version:
        shard = _HELD[version[0]] = _Shard(version)
    return shard


def abouts(versions: Sequence[Version]) -> list[About | str]:
    """Return descriptions of maps, or why they cannot be opened."""
    found = list[About | str]()
    for version in versions:
        try:
            one = _held(version).map
        except (MapError, OSError) as error:
            found.append(str(error))
            continue
        settings = one.encoding, one.keyframes, tuple(one.sessions), len(one)
        content = one.places.columns, tuple(one.links), sums_of(one.global_descriptors)
        found.append(About(*settings, *content))
    return found


def rows(versions: Sequence[Version], direction: Floats, statistics: Statistics) -> list[Row]:
    """Return the coarse scores of each map's places with a query's direction."""
    found = []
    for shard in map(_held, versions):
        references, starts = shard.map.global_descriptors, shard.map.bounds.starts
        shard.whitened = shard.whitened or WhitenedReferences(statistics, references, starts)
        found.append(shard.whitened.row(references, starts, direction))
    return found


def descriptor(version: Version, index: int) -> Floats:
    """Return the global descriptor (n,) of a map's place."""
    return _held(version).map.global_descriptors[index].astype(np.float32)


def likeness(versions: Sequence[Version], direction: Floats) -> list[Row]:
    """Return the products of the descriptors of each map's places with a direction."""
    return [products(one.map.global_descriptors, direction) for one in map(_held, versions)]


def pictures(version: Version, indices: Sequence[int], with_images: bool) -> list[Picture]:
    """Return cells and images of a map's places; MapError if it is damaged."""
    return _held(version).map.pictures(indices, with_images)
