# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Which topics and files carry the pictures of a camera, by their names."""

import re

COMPRESSED = '/compressed'  # ends the name of the topic beside raw images

# Last parts of the topics of a camera, as drivers and image_proc name them.
_USUAL = frozenset({
    'image', 'image_color', 'image_mono', 'image_raw', 'image_rect', 'image_rect_color',
    'image_rect_raw',
})  # fmt: skip
# Words in the names of topics.
_COLOUR = frozenset({'color', 'colour', 'rgb', 'rgbd', 'bgr'})
_INFRARED = frozenset({
    'ambient', 'infra', 'infrared', 'intensity', 'ir', 'lwir', 'nearir', 'nir', 'reflec',
    'reflectivity', 'signal', 'swir', 'thermal',
})  # fmt: skip
_NO_PICTURE = frozenset({
    'compresseddepth', 'confidence', 'depth', 'disparity', 'label', 'labels', 'mask', 'range',
    'segmentation', 'zstd',
})  # fmt: skip


def image_rank(topic: str) -> tuple[bool, ...]:
    """
    Return the rank of an image topic, the lowest for the best one.

    Colour cameras with usual names come first, then other cameras, infrared and lidar images, and
    last depth.
    """
    words = _words(' '.join(set(topic.split('/')).difference(_USUAL)))
    is_usual = topic.removesuffix(COMPRESSED).rpartition('/')[2] in _USUAL
    return bool(words & _NO_PICTURE), bool(words & _INFRARED), not is_usual, not words & _COLOUR


def shows_no_picture(name: str) -> bool:
    """Return whether a word of a name says depth, labels or the like."""
    return bool(_words(name) & _NO_PICTURE)


def _words(name: str) -> set[str]:
    return {*re.findall('[a-z]+', name.lower())}


def camera_info_beside(image: str) -> str:
    """Return the conventional topic of a camera's CameraInfo, given that of its images."""
    return f'{image.removesuffix(COMPRESSED).rpartition("/")[0]}/camera_info'
