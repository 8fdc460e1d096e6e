# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Maps of which a test knows every place."""

from collections.abc import Iterable, Sequence

from convseq_ros.config import EncodingConfig, EVERY_FRAME, KeyframeConfig
from convseq_ros.core.encoding.descriptor import describe
from convseq_ros.core.map.image_coding import thumbnail
from convseq_ros.core.map.place import pack_cells, Place
from convseq_ros.core.map.reference_map import ReferenceMap
from convseq_ros.core.types import Descriptor, Pose
import numpy as np


def map_of(
    shown: Iterable[np.ndarray | Descriptor],
    encoding: EncodingConfig = EncodingConfig(),
    keyframes: KeyframeConfig = EVERY_FRAME,
    poses: Sequence[Pose | None] = (),
) -> ReferenceMap:
    """Return a map of places by their cells or descriptors; a place's stamp is its number."""
    made = ReferenceMap(encoding, keyframes=keyframes)
    for index, one in enumerate(shown):
        cells = one.cells if isinstance(one, Descriptor) else one
        made.add(Place(index, pose=poses[index] if poses else None), pack_cells(cells))
    return made


def street_of(
    pictures: Iterable[np.ndarray], step_ns: int = 1, is_posed: bool = True
) -> ReferenceMap:
    """Return a map of pictures, a metre and so many ns apart, with thumbnails."""
    made = ReferenceMap(keyframes=EVERY_FRAME)
    for index, gray in enumerate(pictures):
        pose = Pose((float(index), 2.0, 0.5), (0.0, 0.0, 0.6, 0.8)) if is_posed else None
        place = Place(index * step_ns + 1, 'street', pose)
        made.add(place, pack_cells(describe(gray).cells), thumbnail(gray, 64))
    return made
