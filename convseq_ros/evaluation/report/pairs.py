# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Pairs of pictures, of a frame and a place, with the regions and keypoints that agree."""

from convseq_ros.config.reading_config import ReadingConfig
from convseq_ros.core.encoding.descriptor import whole_descriptor
from convseq_ros.core.encoding.keypoints import agreeing, Keypoints, StoredKeypoints
from convseq_ros.core.encoding.upright import upright
from convseq_ros.core.map.image_coding import decode_jpeg, thumbnail
from convseq_ros.core.map.reference_map import ReferenceMap
from convseq_ros.core.recognizer import PlaceRecognizer
from convseq_ros.core.similarity.matcher import Features, Matcher
from convseq_ros.core.types import Doubles, Frame
import numpy as np

# The pictures of a frame and a place, JPEG, empty without one; then regions and keypoints that
# agree, 4 bytes each: across and down in the first picture, then in the second, in 255ths.
Pair = tuple[bytes, bytes, bytes, bytes]
_MOST_REGIONS, _MOST_KEYPOINTS = 150, 100  # that are drawn; more would hide the pictures


def pair_of_frame(frame: Frame, index: int, recognizer: PlaceRecognizer, width_px: int) -> Pair:
    """Return the newest frame, the last that a recogniser got, and a place of its map."""
    places, features = recognizer.reference_map, recognizer.features
    gray = np.asarray(upright(frame, places.encoding).gray, np.uint8)
    pictures = thumbnail(gray, width_px), picture_of(places, index, width_px)
    found = places.detect(gray, recognizer.config.keyframes.keypoints)
    return *pictures, *_agreement(recognizer.matcher, features, found, places, index)


def pair_of_places(
    places: ReferenceMap, first: int, second: int, matcher: Matcher | None, width_px: int
) -> Pair:
    """Return two places of a map; without a matcher it is not known what agrees."""
    pictures = picture_of(places, first, width_px), picture_of(places, second, width_px)
    if matcher is None:
        return *pictures, b'', b''
    features = matcher.extract(whole_descriptor(places.cells(first)))
    return *pictures, *_agreement(matcher, features, places.keypoints(first), places, second)


def picture_of(places: ReferenceMap, index: int, width_px: int) -> bytes:
    """Return a place's kept image, or else its thumbnail, as a JPEG; empty if it has none."""
    small, gray = places.thumbnail(index), places.image(index, ReadingConfig().max_image_mpx)
    if gray is None and (gray := decode_jpeg(small)) is not None:
        if gray.shape[1] <= width_px and len(small) <= gray.size:
            return small
    return b'' if gray is None else thumbnail(gray, width_px)


def _agreement(
    matcher: Matcher,
    features: Features | None,
    found: StoredKeypoints | None,
    places: ReferenceMap,
    index: int,
) -> tuple[bytes, bytes]:
    """Return the regions and keypoints of a frame that agree with a place."""
    if not features or not features.packed or not (shift := matcher.shift(features, index)):
        return b'', b''
    field = matcher.field(features, index, shift)
    regions = _packed(field[field[:, 4] > 0][:, [1, 0, 3, 2]], _MOST_REGIONS)
    kept, motion = places.keypoints(index), matcher.motion(features, index)
    if found is None or kept is None or motion is None:
        return regions, b''
    both = Keypoints.of_stored(found), Keypoints.of_stored(kept)
    return regions, _packed(agreeing(*both, motion, features.packed.side), _MOST_KEYPOINTS)


def _packed(shares: Doubles, most: int) -> bytes:
    rows = shares[np.linspace(0, len(shares) - 1, min(len(shares), most)).astype(int)]
    return (rows.clip(0.0, 1.0) * 255).round().astype(np.uint8).tobytes()
