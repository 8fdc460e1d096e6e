# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Which topics carry the pictures of a camera, by their names."""

from collections.abc import Callable, Iterable
import re
from typing import Any

COMPRESSED = '/compressed'  # ends the name of the topic beside raw images

# Last parts of the topics of a camera, the best first, as drivers and image_proc name them.
_USUAL = (
    'image_raw', 'image', 'image_color', 'image_rect_color', 'image_rect', 'image_rect_raw',
    'image_mono',
)  # fmt: skip
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


def best(topics: Iterable[str], rank: Callable[[str], Any]) -> list[str]:
    """Return the topics of the lowest rank, in order of their names."""
    ranks = {topic: rank(topic) for topic in sorted(topics)}
    return [topic for topic, value in ranks.items() if value == min(ranks.values())]


def image_rank(topic: str, namespace: str = '/') -> tuple[bool, ...]:
    """
    Return the rank of an image topic, the lowest for the best one, below a namespace.

    Colour cameras with usual names come first, then other cameras, infrared and lidar images,
    and last depth.
    """
    parts = topic.removeprefix(namespace).split('/')
    words = {*re.findall('[a-z]+', ' '.join(set(parts).difference(_USUAL)).lower())}
    is_usual = _last(topic) in _USUAL
    return bool(words & _NO_PICTURE), bool(words & _INFRARED), not is_usual, not words & _COLOUR


def one_of_each_camera(topics: Iterable[str]) -> list[str]:
    """Return one topic of each camera: the first of `image_raw`, `image_rect` and so on."""
    cameras: dict[str, list[str]] = {}
    for topic in topics:
        name = topic.removesuffix(COMPRESSED)
        camera = name.rpartition('/')[0] if _last(topic) in _USUAL else name
        cameras.setdefault(camera, []).append(topic)
    order = {name: at for at, name in enumerate(_USUAL)}
    return [min(it, key=lambda topic: order.get(_last(topic), 0)) for it in cameras.values()]


def _last(topic: str) -> str:
    return topic.removesuffix(COMPRESSED).rpartition('/')[2]


def camera_info_beside(image: str) -> str:
    """Return the conventional topic of a camera's CameraInfo, given that of its images."""
    return f'{image.removesuffix(COMPRESSED).rpartition("/")[0]}/camera_info'
