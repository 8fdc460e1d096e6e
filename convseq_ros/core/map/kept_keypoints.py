# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Whether a map keeps keypoints, and what is said if it does not."""

from convseq_ros.config import Config
from convseq_ros.core.map.reference_map import ReferenceMap
import numpy as np

_LOOKED_AT = 10  # places of a map, to know whether it has keypoints


def has_keypoints(reference_map: ReferenceMap) -> bool:
    """Return whether a map has keypoints, by a few of its places; also true if it is empty."""
    if not len(reference_map):
        return True
    some = np.unique(np.linspace(0, len(reference_map) - 1, _LOOKED_AT).astype(int)).tolist()
    return any(reference_map.keypoints(index) is not None for index in some)


def without_keypoints(name: object, has: bool, config: Config) -> str:
    """Return a line about a map that has no keypoints; empty if it has, or none are used."""
    if has or not (config.believes and config.keyframes.keypoints):
        return ''
    return (
        f'{name} has no keypoints, so alike aisles may be confused; build the map again to add '
        'them'
    )
