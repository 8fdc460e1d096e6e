# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Limits of a map that is driven for life: which looks are left out where there are too many."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise
import math

from convseq_ros.core.map.editing import Part, runs_of, Watch, write_parts
from convseq_ros.core.map.lifelong import KNOWN
from convseq_ros.core.map.reference_map import ReferenceMap
from convseq_ros.online_config import OnlineConfig

_STRETCH = 2 * KNOWN.window  # first looks along a way over which the others are counted
_ROOM = 0.9  # of a file's limit: what is left when it was reached


def within_limits(
    parts: list[Part], online: OnlineConfig, watch: Watch = lambda steps: steps
) -> tuple[list[Part], int]:
    """
    Leave looks out of a map file, given as its parts, in one step, or not at all.

    A look is a place that was recognised as another one when it came. Looks go by their
    session along up to 32 places; those go that were no answer for longest, or, if they never were
    one, are oldest, and what would be left of their session in less than 16 places. First looks
    stay, so that no place is forgotten, whatever the limits. Return the sessions of the map now,
    and how many places went. MapError as for `write_parts`.
    """
    if not parts:
        return parts, 0
    path, whole = parts[0].path, parts[0].reference_map
    size_mb = path.stat().st_size / 1e6
    stretches, out = _stretches(whole), set[int]()
    firsts = {at for one in stretches for at in one.firsts}
    left = [
        looks for one in stretches for looks in _beyond(whole, one, online.max_places_per_m, out)
    ]
    if online.max_map_mb and size_mb > online.max_map_mb:
        most = math.floor(len(whole) * _ROOM * online.max_map_mb / size_mb)
        for looks in sorted(left, key=lambda one: one.used_ns):
            if len(whole) - len(out) > most:
                out.update(looks.places)
    for part in parts if out else ():
        for run in _runs(part.places, out):
            if run != part.places and len(run) < KNOWN.window and not firsts.intersection(run):
                out.update(run)
    if out:
        parts = [one for part in parts for one in runs_of(part, _runs(part.places, out))]
        write_parts(parts, path, watch, replaces=True)
    return parts, len(out)


@dataclass(frozen=True, slots=True)
class _Looks:
    """Of places along a stretch of way, in one session."""

    places: tuple[int, ...]
    used_ns: int  # when one of them was an answer last, or was taken


@dataclass(frozen=True, slots=True)
class _Stretch:
    """First looks along a way, and the others of the same places."""

    firsts: tuple[int, ...]
    looks: tuple[_Looks, ...]  # those first that were used longest ago


def _stretches(whole: ReferenceMap) -> list[_Stretch]:
    firsts, number_of = list[list[int]](), dict[int, int]()
    looks = dict[tuple[int, int], list[int]]()
    uses, session, others = whole.uses, -1, list[tuple[int, int]]()
    for at, place in enumerate(whole.places):
        if uses[at].look_of is not None:
            others.append((at, place.session))
            continue
        if place.session != session or len(firsts[-1]) == _STRETCH:
            firsts.append([])
        session = place.session
        firsts[-1].append(at)
        number_of[at] = len(firsts) - 1
    for at, session in others:
        looks.setdefault((number_of[uses.first(at)], session), []).append(at)
    found: list[list[_Looks]] = [[] for _ in firsts]
    for (number, _), some in looks.items():
        used_ns = max(max(uses[at].last_ns, whole.places[at].stamp_ns) for at in some)
        found[number].append(_Looks(tuple(some), used_ns))
    return [
        _Stretch(tuple(own), tuple(sorted(some, key=lambda one: one.used_ns)))
        for own, some in zip(firsts, found, strict=True)
    ]


def _beyond(
    whole: ReferenceMap, stretch: _Stretch, most_per_m: float, out: set[int]
) -> Iterator[_Looks]:
    """Add to `out` the looks of a stretch that are too many a metre; yield the others."""
    most = most_per_m * _way_m(whole, stretch.firsts) if most_per_m else math.inf
    count = len(stretch.firsts) + sum(len(looks.places) for looks in stretch.looks)
    for looks in stretch.looks:
        if count > most:
            out.update(looks.places)
            count -= len(looks.places)
        else:
            yield looks


def _way_m(whole: ReferenceMap, some: Sequence[int]) -> float:
    """Return how much way places stand for; infinity if a pose is not known, or there is one."""
    poses = [whole.places[one].pose for one in some]
    known = [pose.position for pose in poses if pose]
    if len(known) < max(2, len(some)):
        return math.inf
    return sum(math.dist(*both) for both in pairwise(known)) * len(some) / (len(some) - 1)


def _runs(places: range, out: set[int]) -> list[range]:
    """Return the stretches of places that are not left out."""
    runs, start = list[range](), places.start
    for at in [*(one for one in places if one in out), places.stop]:
        runs += [range(start, at)] if at > start else []
        start = at + 1
    return runs
