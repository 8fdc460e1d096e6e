# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A fleet of maps that workers hold, which appears as one map."""

from bisect import bisect_right
from collections.abc import Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import partial
from itertools import accumulate
from pathlib import Path
import time
from typing import Any

from convseq_ros.app.cameras import Cameras
from convseq_ros.config import Config
from convseq_ros.core.compiled import slow_path
from convseq_ros.core.encoding.first_stage import Describe, vector_length, with_first_stage
from convseq_ros.core.map.arrays import Places
from convseq_ros.core.map.format import MapSession
from convseq_ros.core.map.kept_keypoints import without_keypoints
from convseq_ros.core.map.place import Picture
from convseq_ros.core.map.reference_map import ReferenceMap
from convseq_ros.core.retrieval.coarse_scores import CoarseScores
from convseq_ros.core.retrieval.whitening import statistics_of
from convseq_ros.core.types import Descriptor, Floats, Row
from convseq_ros.errors import FleetError
from convseq_ros.fleet.shard import About, Holder
import numpy as np

_TRIES = 3  # of a question, each with a new worker
_LOOKED_AT_EVERY_S = 0.25  # checks that a worker is alive while it works


@dataclass(eq=False, slots=True)
class _Worker:
    """Sends questions to one worker, about the shards that it holds."""

    client: Any
    paths: Sequence[str]
    address: str = ''  # empty if there is no choice
    future: Any = None
    actor: Any = None
    problem: str = ''  # why it gets no more questions

    def ask(self, timeout_s: float, method: str, arguments: tuple[Any, ...]) -> Any:
        """Return the answer, by another worker if this one dies; None if all of them die."""
        until = time.monotonic() + timeout_s
        for _ in range(0 if self.problem else _TRIES):
            try:
                return self._answer(until, method, arguments)
            except TimeoutError:
                raise FleetError(f'a worker did not answer within {timeout_s:g} s') from None
            except Exception as error:
                last = error
                self.address, self.actor, self.future = '', None, None
        self.problem = self.problem or f'asked {_TRIES} workers in vain ({last})'
        return None

    def _answer(self, until: float, method: str, arguments: tuple[Any, ...]) -> Any:
        if self.actor is None:
            wish = {'workers': [self.address], 'allow_other_workers': True}
            chosen = wish if self.address else {}
            self.future = self.client.submit(Holder, self.paths, actor=True, pure=False, **chosen)
            self.actor = self.future.result(timeout=max(0.0, until - time.monotonic()))
        reply = getattr(self.actor, method)(*arguments)
        while True:
            try:
                return reply.result(timeout=_LOOKED_AT_EVERY_S)
            except TimeoutError:
                if self.future.status != 'finished':
                    raise OSError('its worker died') from None
                if time.monotonic() > until:
                    raise


class FleetScores(CoarseScores):
    """Coarse scores of one camera, which workers compute; they are summed along the drive here."""

    def __init__(self, fleet: 'Fleet', both: bool) -> None:
        super().__init__(fleet.reference_map, both, fleet.statistics)
        self._ask = fleet.row

    def update(self, descriptor: Descriptor, _usable: int | None = None) -> None:
        """Take in a query; every place is usable, as fleets do not grow."""
        self.row = self._ask(self._drive.update(descriptor, self._statistics))
        self._track.update(self.row, self._map.bounds.starts)


class Fleet:
    """
    Recognises places in all maps of a fleet, exactly as in one map merged from them.

    Workers of a `distributed.Client` hold the maps, in the order given. Maps that cannot be
    opened, or fail later, are `missing`; the others answer. `sources` name the cameras, if there
    are several, and `describe` is the maps' model, as in `Pipeline`. FleetError if a fleet cannot
    do what `config` requires, no map can be opened, or a question takes longer than `timeout_s`.
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
        self._client, self.paths, self.timeout_s = client, paths, timeout_s
        self._missing = dict[str, str]()
        self._open()
        coarse = partial(FleetScores, self, config.matching.both_directions)
        self.cameras = Cameras(self.reference_map, config, sources, coarse, describe)
        self.slow = slow_path()

    @property
    def ignored(self) -> list[str]:
        """A line for each map without keypoints, if they are to be used."""
        config = self.cameras.first.config
        lines = (without_keypoints(path, has, config) for path, has in self._has_keypoints.items())
        return [line for line in lines if line]

    @property
    def missing(self) -> list[str]:
        """A line for each map that does not answer, with the reason."""
        return [*self._missing.values()]

    def _open(self) -> None:
        names, sizes = [], []
        for path in self.paths:
            names.append(str(path.resolve()))
            sizes.append(path.stat().st_size if path.is_file() else 1)
        # If no worker is up yet, the first to start gets all maps.
        addresses = sorted(self._client.scheduler_info(n_workers=-1)['workers']) or ['']
        self._workers = [
            _Worker(self._client, paths, address)
            for paths, address in zip(_runs(names, sizes, len(addresses)), addresses, strict=False)
            if paths
        ]
        self._threads = ThreadPoolExecutor(max(1, len(self._workers)), 'fleet')
        abouts: dict[str, About] = {}
        for answer in self._ask_workers('about', [(worker, ()) for worker in self._workers]):
            opened, lost = answer or ({}, {})
            abouts |= opened
            self._missing |= lost
        abouts = {path: abouts[path] for path in names if path in abouts}
        for name in [*abouts][1:]:
            if reason := _difference(abouts[name], next(iter(abouts.values()))):
                self._missing[name] = f'{name}: {reason}'
                del abouts[name]
        for name in [name for name, about in abouts.items() if not about.count]:
            self._missing[name] = f'{name}: has no places'
            del abouts[name]
        if not abouts:
            why = next(iter(self._missing.values()), 'no map has a place')
            raise FleetError(f'no map of {len(names)} can be opened: {why}')
        starts = accumulate((about.count for about in abouts.values()), initial=0)
        *self._starts, self.count = starts
        self.offsets = dict(zip(abouts, self._starts, strict=True))
        sums = np.asarray(sum(about.sums for about in abouts.values()))
        self.statistics = statistics_of(sums, self.count)
        self.reference_map = self._joined(abouts)
        self._has_keypoints = {path: about.has_keypoints for path, about in abouts.items()}

    def _joined(self, abouts: Mapping[str, About]) -> ReferenceMap:
        """Return one map of all shards; cells and images are read from the workers."""
        first, sessions = next(iter(abouts.values())), list[MapSession]()
        places = Places(vector_length(first.encoding))
        for about in abouts.values():
            places.take(about.columns, len(sessions))
            sessions += about.sessions
        joined = ReferenceMap(
            first.encoding, places, self.pictures, first.keyframes, sessions=sessions
        )
        for path, about in abouts.items():
            for place, anchor in about.links:
                joined.links.add(self.offsets[path] + place, self.offsets[path] + anchor)
        return joined

    def row(self, direction: Floats) -> Row:
        """Return the coarse scores of all places; minus infinity where a map is missing."""
        questions = list[tuple[_Worker, tuple[Any, ...]]]()
        for worker in self._workers:
            there = [path for path in worker.paths if path not in self._missing]
            questions.append((worker, (there, direction, self.statistics)))
        row = np.full(self.count, -np.inf, np.float32)
        for reply in self._ask_workers('rows', questions):
            for path, scores in (reply or {}).items():
                row[self.offsets[path] :][: len(scores)] = scores
        return row

    def pictures(self, indices: Sequence[int], with_images: bool = False) -> list[Picture]:
        """Return cells and images of places; blank ones if their shard is missing."""
        paths, wanted = [*self.offsets], dict[str, list[int]]()
        for index in indices:
            wanted.setdefault(paths[bisect_right(self._starts, index) - 1], []).append(index)
        questions = list[tuple[_Worker, tuple[Any, ...]]]()
        for worker in self._workers:
            held = [path for path in worker.paths if path in wanted]
            if held:
                local = {path: [at - self.offsets[path] for at in wanted[path]] for path in held}
                questions.append((worker, (local, with_images)))
        replies = dict[str, list[Picture] | str]()
        for reply in self._ask_workers('pictures', questions):
            replies |= reply or {}
        pictures = dict[int, Picture]()
        for path, places in wanted.items():
            reply = replies.get(path, f'{path}: its worker is gone')
            if isinstance(reply, str):
                self._missing.setdefault(path, reply)
                blank = Picture(np.zeros(self.reference_map.cell_shape, np.float16))
                reply = [blank] * len(places)
            pictures |= zip(places, reply, strict=True)
        return [pictures[index] for index in indices]

    def _ask_workers(
        self, method: str, questions: Sequence[tuple[_Worker, tuple[Any, ...]]]
    ) -> list[Any]:
        """Ask some workers in parallel; the answer is None if all tries of a worker died."""
        waiting = [
            self._threads.submit(worker.ask, self.timeout_s, method, arguments)
            for worker, arguments in questions
        ]
        answers = [future.result() for future in waiting]
        for worker, _ in questions:
            if worker.problem:
                for path in worker.paths:
                    self._missing.setdefault(path, f'{path}: {worker.problem}')
        return answers


def _difference(about: About, first: About) -> str | None:
    """Return why a map cannot be combined with the first; None if it can."""
    if about.encoding != first.encoding:
        return f'made with {about.encoding}, the first map with {first.encoding}'
    if about.keyframes.spacing != first.keyframes.spacing:
        spacing, first_spacing = about.keyframes.spacing, first.keyframes.spacing
        return f'made with {spacing}, the first map with {first_spacing}'
    return None


def _runs(names: Sequence[str], sizes: Sequence[int], count: int) -> list[list[str]]:
    """Return names, in order, in `count` runs of similar size."""
    runs: list[list[str]] = [[] for _ in range(max(1, count))]
    total, passed = max(1, sum(sizes)), 0
    for name, size in zip(names, sizes, strict=True):
        runs[min(len(runs) - 1, (passed + size // 2) * len(runs) // total)].append(name)
        passed += size
    return runs
