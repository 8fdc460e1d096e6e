# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Which places of a session the other sessions of its map can do without."""

from dataclasses import dataclass

from convseq_ros.core.linking import recognised
from convseq_ros.core.map.lifelong import is_alike, known_as, Sieve
from convseq_ros.core.map.reference_map import ReferenceMap


@dataclass(frozen=True, slots=True)
class Needed:
    """The places of a session that are to be kept, and why the others are not."""

    runs: tuple[range, ...]  # of indices in the map
    unknown: int  # places that no other session recognises
    unlike: int  # places that another session recognises, but that look otherwise there
    known: int  # places that another session recognises, and that look alike there


def needed(whole: ReferenceMap, session: int) -> Needed:
    """
    Return which places of a session the others could not answer as well for.

    Where half of the places within `window` are recognised, and half look alike, a place can be
    done without; the others are kept, with so many places before and after, as sequences take
    them.
    """
    found = list(recognised(whole, session))
    if not found:
        return Needed((), 0, 0, 0)
    cells, sieve, runs = whole.cell_shape[0], Sieve[int](), list[range]()
    known = [known_as(match) for _, match in found]
    alike = [is_alike(match, cells) for _, match in found]
    for places in (*map(sieve.put, (index for index, _ in found), known, alike), sieve.end()):
        for kept in places:
            start = kept.item if kept.begins else runs.pop().start
            runs.append(range(start, kept.item + 1))
    spare = sum(one is not None and like for one, like in zip(known, alike, strict=True))
    unknown = known.count(None)
    return Needed(tuple(runs), unknown, len(found) - unknown - spare, spare)
