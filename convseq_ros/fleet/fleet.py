# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A fleet of maps that workers hold, seen as one map."""

from bisect import bisect_right
from collections import OrderedDict
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import accumulate
from pathlib import Path
import time
from typing import Any
from uuid import uuid4

from convseq_ros.core.map.place import Picture, Place
from convseq_ros.core.map.reference_map import ReferenceMap
from convseq_ros.core.map.sessions import SessionBounds
from convseq_ros.core.sequence.centred import usual_of
from convseq_ros.errors import FleetError
from convseq_ros.fleet.scores import FleetScores
from convseq_ros.fleet.shard import About, Answer, Call, Holder, merged, Pictures, Question
import numpy as np

_TRIES = 3  # of a question, each with a new worker
_LOOKED_AT_EVERY_S = 0.25  # whether a worker lives, while it is waited for
# Places whose pictures are remembered, without and with kept images: 20 MB, and 2 or more.
_KEPT = {False: 1024, True: 64}


@dataclass(eq=False, slots=True)
class _Worker:
    """What asks one worker about the shards that it holds."""

    client: Any
    paths: Sequence[str]
    where: str = ''  # its address, if there is a choice
    future: Any = None
    actor: Any = None
    is_given_up: bool = False

    def send(self, until: float, method: str, *what: Any) -> Any:
        """Ask, and return what will hold the answer; anew on another worker, if this one died."""
        if self.actor is None:
            chosen = {'workers': [self.where], 'allow_other_workers': True} if self.where else {}
            self.future = self.client.submit(Holder, self.paths, actor=True, pure=False, **chosen)
            self.actor = self.future.result(timeout=max(0.0, until - time.monotonic()))
        return self.actor.ask(Call(method, what))

    def receive(self, reply: Any, until: float) -> Any:
        """Return the answer; OSError if the worker died, TimeoutError if it takes too long."""
        while True:
            try:
                return reply.result(timeout=_LOOKED_AT_EVERY_S)
            except TimeoutError:
                if self.future.status != 'finished':
                    raise OSError('its worker died') from None
                if time.monotonic() > until:
                    raise

    def forget(self) -> None:
        """Have the next question go to another worker."""
        self.where, self.actor, self.future = '', None, None


@dataclass(eq=False)
class Fleet:
    """
    Maps that the workers of a `distributed.Client` hold, in the order given.

    What cannot be opened, or fails later, is `missing`, by its path and with the reason; the rest
    answers. FleetError if nothing can be opened, or a question takes longer than `timeout_s`.
    """

    client: Any
    paths: Sequence[Path]
    timeout_s: float = 60.0
    missing: dict[str, str] = field(default_factory=dict)

    def __post_init__(self) -> None:
        self._key = str(uuid4())
        names, sizes = [], []
        for path in self.paths:
            names.append(str(path.resolve()))
            sizes.append(path.stat().st_size if path.is_file() else 1)
        addresses = sorted(self.client.scheduler_info(n_workers=-1)['workers'])
        self._workers = [
            _Worker(self.client, some, where)
            for some, where in zip(
                _shared_out(names, sizes, len(addresses)), addresses, strict=False
            )
            if some
        ]
        self._of = {path: worker for worker in self._workers for path in worker.paths}
        abouts: dict[str, About] = {}
        for answer in self._ask_all('about', [()] * len(self._workers)):
            found, lost = answer or ({}, {})
            abouts |= found
            self.missing |= lost
        abouts = {path: abouts[path] for path in names if path in abouts}
        for name in [*abouts][1:]:
            if reason := _unlike(abouts[name], next(iter(abouts.values()))):
                self.missing[name] = f'{name}: {reason}'
                del abouts[name]
        for name in [name for name, about in abouts.items() if not about.count]:
            self.missing[name] = f'{name}: has no places'
            del abouts[name]
        if not abouts:
            why = next(iter(self.missing.values()), 'no map has a place')
            raise FleetError(f'no map of {len(names)} can be opened: {why}')
        starts = accumulate((about.count for about in abouts.values()), initial=0)
        *self._starts, self.count = starts
        self._abouts = abouts
        self.offsets = dict(zip(abouts, self._starts, strict=True))
        sessions = accumulate((len(about.sessions) for about in abouts.values()), initial=0)
        self._first_sessions = dict(zip(abouts, sessions, strict=False))

    def reference_map(self) -> ReferenceMap:
        """Return the map that they make together; what is large is read from workers."""
        first = next(iter(self._abouts.values()))
        sessions = [one for about in self._abouts.values() for one in about.sessions]
        places: Any = _Places(self)
        settings = first.encoding, places, places.pictures, first.keyframes
        return ReferenceMap(*settings, sessions=sessions)

    def scores(self, reference_map: ReferenceMap, index_above: int) -> FleetScores:
        """Return what knows their coarse scores, given the map that they make."""
        sums = sum(about.sums for about in self._abouts.values())
        usual = usual_of(np.asarray(sums), self.count), self._key
        return FleetScores(self.ask, reference_map.pictures, *usual, self.count, index_above)

    def ask(self, question: Question) -> Answer:
        """Ask all shards."""
        offsets = [
            {path: self.offsets[path] for path in worker.paths if path not in self.missing}
            for worker in self._workers
        ]
        found = self._ask_all('answer', [(question, some) for some in offsets])
        return merged([one for one in found if one is not None], question)

    def bounds(self) -> SessionBounds:
        """Return where their sessions begin."""
        return SessionBounds(
            tuple(
                self.offsets[path] + start
                for path, about in self._abouts.items()
                for start in about.starts.tolist()
            )
        )

    def pictures(
        self, indices: Sequence[int], with_images: bool = False
    ) -> Mapping[int, tuple[Place, Picture]]:
        """Return places and pictures, by their numbers; blank ones of a shard that is missing."""
        paths, asked = [*self._abouts], dict[str, list[int]]()
        for index in indices:
            asked.setdefault(paths[bisect_right(self._starts, index) - 1], []).append(index)
        found = dict[int, tuple[Place, Picture]]()
        questions: list[tuple[_Worker, tuple[dict[str, list[int]], bool]]]
        questions = [(worker, ({}, with_images)) for worker in self._workers]
        for path, some in asked.items():
            own = questions[self._workers.index(self._of[path])][1][0]
            own[path] = [one - self.offsets[path] for one in some]
        replies = dict[str, Pictures | str]()
        for reply in self._ask_some('pictures', [one for one in questions if one[1][0]]):
            replies |= reply or {}
        for path, some in asked.items():
            sessions, reply = self._first_sessions[path], replies.get(path)
            if not isinstance(reply, Pictures):
                self.missing.setdefault(path, reply or f'{path}: its worker is gone')
                shape = ReferenceMap(self._abouts[path].encoding).cell_shape
                blank = Place(0, session=sessions), Picture(np.zeros(shape, np.float16))
                found |= dict.fromkeys(some, blank)
                continue
            each = zip(reply.packed, reply.thumbnails, reply.images, reply.depths, strict=True)
            for index, place, what in zip(some, reply.places, each, strict=True):
                place = replace(place, session=place.session + sessions)
                found[index] = place, Picture(*what)
        return found

    def _ask_all(self, method: str, what: Sequence[tuple[Any, ...]]) -> Iterator[Any]:
        yield from self._ask_some(method, [*zip(self._workers, what, strict=True)])

    def _ask_some(
        self, method: str, asked: Sequence[tuple[_Worker, tuple[Any, ...]]]
    ) -> list[Any]:
        """Ask some workers at once; None for each that has died again and again."""
        found: list[Any] = [None] * len(asked)
        until = time.monotonic() + self.timeout_s
        waiting = [one for one, (worker, _) in enumerate(asked) if not worker.is_given_up]
        errors = dict[int, Exception]()
        for _ in range(_TRIES):
            again: list[int] = []
            replies = [
                (one, _tried(asked[one][0].send, until, method, *asked[one][1])) for one in waiting
            ]
            for one, reply in replies:
                worker = asked[one][0]
                answer = reply
                if not isinstance(reply, Exception):
                    answer = _tried(worker.receive, reply, until)
                if isinstance(answer, TimeoutError):
                    raise FleetError(f'a worker did not answer within {self.timeout_s:g} s')
                if isinstance(answer, Exception):
                    worker.forget()
                    errors[one] = answer
                    again.append(one)
                else:
                    found[one] = answer
            if not (waiting := again):
                return found
        for one in waiting:
            worker = asked[one][0]
            worker.is_given_up = True
            for path in worker.paths:
                why = f'{path}: asked {_TRIES} workers in vain ({errors[one]})'
                self.missing.setdefault(path, why)
        return found


class _Places(Sequence[Place]):
    """The places of a fleet; the last that were asked for, and with images, are remembered."""

    def __init__(self, fleet: Fleet) -> None:
        self._fleet, self.bounds = fleet, fleet.bounds()
        self._kept = {whole: OrderedDict[int, tuple[Place, Picture]]() for whole in _KEPT}

    def __len__(self) -> int:
        return self._fleet.count

    def __getitem__(self, index: Any) -> Any:
        if isinstance(index, slice):
            return [self[each] for each in range(len(self))[index]]
        return self._found([range(len(self))[index]])[0][0]

    def pictures(self, indices: Sequence[int], with_images: bool = False) -> list[Picture]:
        """Return what is large of places."""
        return [picture for _, picture in self._found(indices, with_images)]

    def _found(
        self, indices: Sequence[int], with_images: bool = False
    ) -> list[tuple[Place, Picture]]:
        kept = self._kept[with_images]
        missing = [index for index in dict.fromkeys(indices) if index not in kept]
        found = {index: kept[index] for index in indices if index in kept}
        if missing:
            found |= self._fleet.pictures(missing, with_images)
        for index, one in found.items():
            kept[index] = one
            kept.move_to_end(index)
        while len(kept) > _KEPT[with_images]:
            kept.popitem(last=False)
        return [found[index] for index in indices]


def _tried(work: Callable[..., Any], *what: Any) -> Any:
    """Return what a work returns, or its error."""
    try:
        return work(*what)
    except Exception as error:
        return error


def _unlike(one: About, first: About) -> str | None:
    """Return why a map does not go together with the first, if so."""
    if one.encoding != first.encoding:
        return f'made with {one.encoding}, the first map with {first.encoding}'
    if one.keyframes.spacing != first.keyframes.spacing:
        own, other = one.keyframes.spacing, first.keyframes.spacing
        return f'made with {own}, the first map with {other}'
    return None


def _shared_out(names: Sequence[str], sizes: Sequence[int], shares: int) -> list[list[str]]:
    """Return names in order in so many runs, about alike in size."""
    runs: list[list[str]] = [[] for _ in range(max(1, shares))]
    whole, passed = max(1, sum(sizes)), 0
    for name, size in zip(names, sizes, strict=True):
        runs[min(len(runs) - 1, (passed + size // 2) * len(runs) // whole)].append(name)
        passed += size
    return runs
