# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A part of a map, as a map that reads its places where they are."""

from collections.abc import Sequence
from dataclasses import replace

from convseq_ros.config import EVERY_FRAME
from convseq_ros.core.map.place import Picture, Places
from convseq_ros.core.map.reference_map import ReferenceMap


def selected(whole: ReferenceMap, indices: Sequence[int]) -> ReferenceMap:
    """
    Return some places of a map, in their order, with all its sessions.

    Its queries are places of the same map: upright already, and a keyframe each.
    """
    places = Places(whole.cell_shape, len(indices))
    for index in indices:
        places.append(whole.places[index], whole.global_descriptors[index])

    def read(wanted: Sequence[int], with_images: bool) -> list[Picture]:
        return whole.pictures([indices[one] for one in wanted], with_images)

    encoding = replace(whole.encoding, image_rotation_deg=0)
    return ReferenceMap(encoding, places, read, EVERY_FRAME, whole.map_id, whole.sessions)
