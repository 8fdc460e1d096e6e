# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Which places of a session the other sessions of its map can do without."""

from dataclasses import dataclass

from convseq_ros.core.linking import recognised
from convseq_ros.core.map.lifelong import Sieve
from convseq_ros.core.map.online import known_as
from convseq_ros.core.map.reference_map import ReferenceMap


@dataclass(frozen=True, slots=True)
class Needed:
    """The places of a session that are to be kept, and why the others are not."""

    runs: tuple[range, ...]  # of indices in the map
    unknown: int  # places that no other session recognises
    known: int  # places that another session recognises


def needed(whole: ReferenceMap, session: int) -> Needed:
    """
    Return which places of a session the others could not answer as well for.

    Where `enough` of the places within `window` are recognised, a place can be done without; the
    others are kept, with so many places before and after, as sequences take them.
    """
    found = list(recognised(whole, session))
    if not found:
        return Needed((), 0, 0)
    sieve, runs = Sieve[int](), list[range]()
    known = [known_as(match) for _, match in found]
    for places in (*map(sieve.put, (index for index, _ in found), known), sieve.end()):
        for kept in places:
            start = kept.item if kept.begins else runs.pop().start
            runs.append(range(start, kept.item + 1))
    unknown = known.count(None)
    return Needed(tuple(runs), unknown, len(found) - unknown)
