# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Maps keep so many looks of a place: of more, the one that is most like another goes."""

from dataclasses import replace
from pathlib import Path

from convseq_ros.core.map.editing import Part, parts_of, Watch, write_parts
from convseq_ros.core.map.looks import Looks
from convseq_ros.core.map.reference_map import ReferenceMap


def surplus(reference_map: ReferenceMap, max_looks: int) -> list[int]:
    """Return which places a map does without that keeps so many looks of each; 0 is no limit."""
    return sorted(Looks(reference_map, max_looks).surplus)


def without(parts: list[Part], indices: list[int]) -> list[Part]:
    """Return the sessions of one map without some of its places."""
    out = {*indices}
    left = [replace(one, places=[at for at in one.places if at not in out]) for one in parts]
    return [one for one in left if one.places]


def bound(path: Path, max_looks: int, watch: Watch = iter) -> int:
    """
    Leave the `surplus` out of a map file, in one step, or not at all; return how many went.

    MapError as for `write_parts`.
    """
    parts = parts_of(path)
    if not parts or not (out := surplus(parts[0].reference_map, max_looks)):
        return 0
    write_parts(without(parts, out), path, watch, replaces=True)
    return len(out)
