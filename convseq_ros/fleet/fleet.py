# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A fleet of maps that workers hold, which appears as one map."""

from bisect import bisect_right
from collections.abc import Sequence
from contextlib import suppress
from functools import partial
from itertools import accumulate
from pathlib import Path
import time
from typing import Any

from convseq_ros.app.cameras import Cameras
from convseq_ros.config import Config
from convseq_ros.core.encoding.first_stage import Describe, vector_length, with_first_stage
from convseq_ros.core.map.arrays import Places
from convseq_ros.core.map.format import MapSession
from convseq_ros.core.map.place import Picture
from convseq_ros.core.map.reference_map import ReferenceMap
from convseq_ros.core.retrieval.coarse_scores import CoarseScores
from convseq_ros.core.retrieval.whitening import statistics_of
from convseq_ros.core.types import Descriptor, Floats, Row
from convseq_ros.errors import ConvseqError, FleetError, one_line
from convseq_ros.fleet import shard
from convseq_ros.fleet.shard import About, Version
import numpy as np

_LOOKED_AT_EVERY_S = 1.0  # checks that workers are alive while they work


class FleetScores(CoarseScores):
    """Coarse scores of one camera, which workers compute; they are summed along the drive here."""

    def __init__(self, fleet: 'Fleet', both: bool) -> None:
        super().__init__(fleet.reference_map, both, fleet.statistics)
        self._ask, self._ask_likeness = fleet.row, fleet.likeness

    def update(self, descriptor: Descriptor, _usable: int | None = None) -> None:
        """Take in a query; every place is usable, as fleets do not grow."""
        self.row = self._ask(self._drive.update(descriptor, self._statistics))
        self._track.update(self.row, self._map.bounds.starts)

    def _likeness(self, place: int) -> Row:
        return self._ask_likeness(place)


class Fleet:
    """
    Recognises places in all maps of a fleet, exactly as in one map merged from them.

    Workers of a `distributed.Client` hold the maps, in the order given; if one dies, another opens
    its maps. `missing` says which maps cannot be opened, and why; the others answer. `cameras`
    takes frames; `sources` name several cameras, and `describe` is the maps' model, as in
    `Pipeline`. FleetError if a fleet cannot do what `config` requires, no map can be opened, or a
    question takes longer than `timeout_s`.
    """

    def __init__(
        self,
        client: Any,
        paths: Sequence[Path],
        config: Config,
        timeout_s: float = 60.0,
        sources: Sequence[str] = (),
        describe: Describe | None = None,
    ) -> None:
        config = with_first_stage(config, describe)
        if config.matching.search != 'shortlist':
            raise FleetError('search exhaustive: a fleet answers by shortlist; leave it out')
        if config.online.mode != 'preloaded':
            mode = config.online.mode
            raise FleetError(f'mode {mode}: maps of a fleet do not grow; leave it out')
        self._client, self._timeout_s = client, timeout_s
        self.missing = list[str]()
        abouts = self._open(paths)
        *self.starts, self.count = accumulate((one.count for one in abouts), initial=0)
        sums = np.asarray(sum(about.sums for about in abouts))
        self.statistics = statistics_of(sums, self.count)
        self.reference_map = self._joined(abouts)
        coarse = partial(FleetScores, self, config.matching.both_directions)
        self.cameras = Cameras(self.reference_map, config, sources, coarse, describe)

    def _open(self, paths: Sequence[Path]) -> list[About]:
        """Let workers open the maps; return what they hold, in order."""
        sizes = [path.stat().st_size if path.is_file() else 1 for path in paths]
        changed = [path.stat().st_mtime_ns if path.is_file() else 0 for path in paths]
        versions = [(str(path.resolve()), at) for path, at in zip(paths, changed, strict=True)]
        # If no worker is up yet, the first to start gets all maps.
        addresses = sorted(self._client.scheduler_info(n_workers=-1)['workers']) or ['']
        runs = _runs(versions, sizes, len(addresses))
        self._held = [(address, run) for address, run in zip(addresses, runs, strict=True) if run]
        abouts = dict[Version, About]()
        answers = self._ask([(where, shard.abouts, (run,)) for where, run in self._held])
        for (_, run), answer in zip(self._held, answers, strict=True):
            for version, about in zip(run, answer, strict=True):
                if isinstance(about, str):
                    self.missing.append(about)
                elif reason := _unfit(about, next(iter(abouts.values()), about)):
                    self.missing.append(f'{version[0]}: {reason}')
                else:
                    abouts[version] = about
        if not abouts:
            raise FleetError(f'no map of {len(paths)} can be opened: {self.missing[0]}')
        self._held = [
            (where, [version for version in run if version in abouts]) for where, run in self._held
        ]
        self._maps = [(version, where) for where, run in self._held for version in run]
        return [abouts[version] for version, _ in self._maps]

    def _joined(self, abouts: Sequence[About]) -> ReferenceMap:
        """Return one map of all; cells and images are read from the workers."""
        first, sessions = abouts[0], list[MapSession]()
        places = Places(vector_length(first.encoding))
        for about in abouts:
            places.take(about.columns, len(sessions))
            sessions += about.sessions
        joined = ReferenceMap(
            first.encoding, places, self.pictures, first.keyframes, sessions=sessions
        )
        for start, about in zip(self.starts, abouts, strict=True):
            for place, anchor in about.links:
                joined.links.add(start + place, start + anchor)
        return joined

    def row(self, direction: Floats) -> Row:
        """Return the coarse scores of all places."""
        asked = [(at, shard.rows, (run, direction, self.statistics)) for at, run in self._held]
        return np.concatenate([row for rows in self._ask(asked) for row in rows])

    def likeness(self, place: int) -> Row:
        """Return the products of the descriptors of all places with that of one."""
        at = bisect_right(self.starts, place) - 1
        version, where = self._maps[at]
        local = place - self.starts[at]
        (direction,) = self._ask([(where, shard.descriptor, (version, local))])
        asked = [(where, shard.likeness, (run, direction)) for where, run in self._held]
        return np.concatenate([row for rows in self._ask(asked) for row in rows])

    def pictures(self, indices: Sequence[int], with_images: bool = False) -> list[Picture]:
        """Return cells and images of places."""
        wanted = dict[int, list[int]]()
        for index in indices:
            wanted.setdefault(bisect_right(self.starts, index) - 1, []).append(index)
        asked = []
        for at, places in wanted.items():
            version, where = self._maps[at]
            local = [index - self.starts[at] for index in places]
            asked.append((where, shard.pictures, (version, local, with_images)))
        found = dict[int, Picture]()
        for places, reply in zip(wanted.values(), self._ask(asked), strict=True):
            found |= zip(places, reply, strict=True)
        return [found[index] for index in indices]

    def _ask(self, questions: list[tuple[str, Any, tuple[Any, ...]]]) -> list[Any]:
        """Ask workers in parallel; each question has an address, a function and its arguments."""
        from distributed import wait

        futures = [self._submitted(*question) for question in questions]
        until = time.monotonic() + self._timeout_s
        while not all(future.done() for future in futures):
            with suppress(TimeoutError):
                wait(futures, timeout=_LOOKED_AT_EVERY_S)
                continue
            if time.monotonic() > until:
                raise FleetError(f'a worker did not answer within {self._timeout_s:g} s')
            # What waits for a worker that died is given to no new one: ask anew.
            alive = self._client.scheduler_info(n_workers=-1)['workers']
            for at, (address, function, arguments) in enumerate(questions):
                if alive and address and address not in alive and not futures[at].done():
                    questions[at] = '', function, arguments
                    futures[at] = self._submitted(*questions[at])
        try:
            return list(self._client.gather(futures))
        except ConvseqError:
            raise
        except Exception as error:  # of any library, from a worker
            raise FleetError(f'a worker failed: {one_line(error)}') from None

    def _submitted(self, address: str, function: Any, arguments: tuple[Any, ...]) -> Any:
        where = {'workers': [address], 'allow_other_workers': True} if address else {}
        return self._client.submit(function, *arguments, pure=False, **where)


def _unfit(about: About, first: About) -> str:
    """Return why a map cannot be combined with the first; empty if it can."""
    if about.encoding != first.encoding:
        return f'made with {about.encoding}, the first map with {first.encoding}'
    if about.keyframes.spacing != first.keyframes.spacing:
        spacing, first_spacing = about.keyframes.spacing, first.keyframes.spacing
        return f'made with {spacing}, the first map with {first_spacing}'
    return '' if about.count else 'has no places'


def _runs(versions: Sequence[Version], sizes: Sequence[int], count: int) -> list[list[Version]]:
    """Return maps, in order, in `count` runs of similar size."""
    runs: list[list[Version]] = [[] for _ in range(count)]
    total, passed = max(1, sum(sizes)), 0
    for version, size in zip(versions, sizes, strict=True):
        runs[min(count - 1, (passed + size // 2) * count // total)].append(version)
        passed += size
    return runs
