# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Lifelong mapping: what the map knows already is passed over, and what answers is counted."""

from collections import deque
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from itertools import islice
from typing import Generic, TypeVar

from convseq_ros.config import Config
from convseq_ros.core.constants import constants
from convseq_ros.core.map.online import known_as, OnlineMap, PreloadedMap
from convseq_ros.core.map.reference_map import ReferenceMap
from convseq_ros.core.types import Descriptor, Frame, Match

Item = TypeVar('Item')
# With what it was recognised as, and the metres after which it was passed.
Waiting = tuple[Frame, Descriptor, Match | None, float]


@constants
class KNOWN:
    """Of what is passed over or left out; by drawn drives of one town (docs/MATCHING.md)."""

    enough: float = 0.8  # share of places near each other that are recognised: no more are needed
    window: int = 16  # places to either side over which that is asked, and that are kept for it


@dataclass(frozen=True, slots=True)
class Kept(Generic[Item]):
    """A place of a drive that is kept."""

    item: Item
    begins: bool  # whether the place before it was not kept
    look_of: int | None  # the place that it is another look of, if it is


class Sieve(Generic[Item]):
    """
    Keeps the places of a drive that are new, one by one, 32 later.

    Where `enough` of the places within `window` are recognised, a place can be done without; the
    others are kept, with so many places before and after, as sequences take them. What is kept
    between two places that are recognised, both within `window`, is a look of what the first of
    them was recognised as.
    """

    def __init__(self) -> None:
        self._waiting, self._looks = deque[Item](), deque[int | None]()
        self._near = deque[int | None](maxlen=2 * KNOWN.window + 1)
        self._count = self._judged = self._out = 0
        self._new = -KNOWN.window - 1  # the last place that cannot be done without
        self._is_open = False  # whether the last place was kept

    def put(self, item: Item, known: int | None) -> Iterator[Kept[Item]]:
        """Take in a place, and what it is recognised as; yield what is to be kept."""
        self._waiting.append(item)
        self._near.append(known)
        self._count += 1
        if self._count > KNOWN.window:
            self._judge()
        if self._count > 2 * KNOWN.window:
            yield from self._next()

    def end(self) -> Iterator[Kept[Item]]:
        """
        Yield what is left of a drive that ended; to be asked once.

        Of the last 32 places all are kept up to one that cannot be done without, and 16 after it.
        """
        while self._judged < self._count:
            if self._count - len(self._near) < self._judged - KNOWN.window:
                self._near.popleft()
            self._judge()
        while self._waiting:
            yield from self._next()

    def _judge(self) -> None:
        """Judge a place by those near it."""
        is_known = [one is not None for one in self._near]
        if sum(is_known) < KNOWN.enough * len(is_known):
            self._new = self._judged
        middle = self._judged - (self._count - len(is_known))  # the place itself
        before = [one for one in islice(self._near, middle + 1) if one is not None]
        self._looks.append(before[-1] if before and any(is_known[middle:]) else None)
        self._judged += 1

    def _next(self) -> Iterator[Kept[Item]]:
        item, look_of = self._waiting.popleft(), self._looks.popleft()
        was_open, self._is_open = self._is_open, self._new >= self._out - KNOWN.window
        self._out += 1
        if self._is_open:
            yield Kept(item, not was_open, look_of)


class LifelongMap(OnlineMap):
    """
    Adds what is new of this session, 32 places later, and counts what answers.

    What waits is lost in a crash, however long it waited; not at a reset or the end.
    `is_full` tells whether the map may not grow any more.
    """

    def __init__(
        self, reference_map: ReferenceMap, config: Config, name: str = '', frame: str = ''
    ) -> None:
        self._sieve = Sieve[Waiting]()
        self.is_full: Callable[[], bool] = lambda: False
        super().__init__(reference_map, config, name, frame)

    def reset(self) -> None:
        self.finish()
        super().reset()

    def add(self, frame: Frame, descriptor: Descriptor, _match: Match | None = None) -> None:
        """Take in a frame and its answer; add what turns out to be new."""
        if frame.gray is None:
            return
        known = known_as(_match)
        if known is not None:
            self._map.uses.answered(known, frame.stamp_ns)
        self._keep(self._sieve.put((frame, descriptor, _match, self._travelled_m), known))

    def finish(self) -> None:
        """Add what is new of the last places."""
        self._keep(self._sieve.end())
        self._sieve = Sieve()

    def _keep(self, places: Iterator[Kept[Waiting]]) -> None:
        for kept in places:
            if not self.is_full():
                self._append(*kept.item, kept.begins)
                if kept.look_of is not None:
                    self._map.uses.looks_like(len(self._map) - 1, kept.look_of)


def make_mapping(reference_map: ReferenceMap, config: Config) -> PreloadedMap:
    """Return the map as the mode has it."""
    if not config.online.grows:
        return PreloadedMap(reference_map)
    kind = LifelongMap if config.online.mode == 'lifelong' else OnlineMap
    return kind(reference_map, config)
