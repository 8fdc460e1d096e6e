# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What a map keeps of places beside cells: images as JPEGs, for keypoints, and depths."""

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from weakref import WeakMethod

from convseq_ros.core.constants import constants
from convseq_ros.core.map.depth import Depths, unpacked_depths
from convseq_ros.core.map.place import Picture
from convseq_ros.errors import MapError
from convseq_ros.picture_header import declared
import cv2
import numpy as np
import numpy.typing as npt

Gray = npt.NDArray[np.uint8]


@constants
class KEPT_IMAGE:
    """Of kept images; quality by a look at road_1 and road_2 (docs/GEOMETRY.md)."""

    quality_percent: int = 85  # of a JPEG; 70 doubles the error of poses on a corner
    longest_px: int = 1280  # side of an image as it is used; a stranger's may be of any size


def reduced(gray: Gray, longest_px: int) -> Gray:
    """Return an image (H, W) whose longer side is at most so long."""
    scale = longest_px / max(gray.shape)
    if scale >= 1:
        return gray
    height, width = (max(1, round(side * scale)) for side in gray.shape)
    return np.asarray(cv2.resize(gray, (width, height), interpolation=cv2.INTER_AREA), np.uint8)


def kept_image(gray: Gray, width_px: int) -> bytes | None:
    """Return a JPEG of an image (H, W), its longer side reduced to a length; None if that is 0."""
    if not width_px:
        return None
    how = [cv2.IMWRITE_JPEG_QUALITY, KEPT_IMAGE.quality_percent]
    return cv2.imencode('.jpg', reduced(gray, width_px), how)[1].tobytes()


class KeptImages:
    """
    The images and depths of a map, by its `pictures`; read only if any `are_kept`.

    Of what could not be decoded, `unreadable` is how often, and `problem` why the last could not.
    """

    def __init__(
        self, pictures: Callable[[Sequence[int], bool], list[Picture]], are_kept: bool = True
    ) -> None:
        # Not held, so that a map that is let go of is gone at once.
        self._pictures, self.are_kept = WeakMethod(pictures), are_kept
        self.unreadable, self.problem = 0, ''

    def _read(self, index: int) -> tuple[bytes | None, bytes | None]:
        """Return the image of a place and its depths, as far as they were kept."""
        pictures = self._pictures() if self.are_kept else None
        if pictures is None:
            return None, None
        (picture,) = pictures([index], True)
        return picture.image, picture.depths

    def image(self, index: int, max_mpx: float) -> Gray | None:
        """Return the image of a place; None if none was kept, or it cannot be decoded."""
        with self._counted('image', index):
            jpeg, _ = self._read(index)
            if jpeg is not None:
                return reduced(_decoded(jpeg, max_mpx), KEPT_IMAGE.longest_px)
        return None

    def depths(self, index: int, cells: int) -> Depths | None:
        """Return the depths of a place's regions; None if none are known, or they are damaged."""
        with self._counted('depth', index):
            _, stored = self._read(index)
            if stored is not None:
                return unpacked_depths(stored, cells)
        return None

    @contextmanager
    def _counted(self, what: str, index: int) -> Iterator[None]:
        try:
            yield
        except (MapError, ValueError, cv2.error) as error:
            self.unreadable += 1
            self.problem = f'kept {what} of reference {index}: {error}'


def _decoded(jpeg: bytes, max_mpx: float) -> Gray:
    """Return what a JPEG shows; ValueError if it is damaged or declares too many pixels."""
    size = declared(jpeg)
    if size and size.pixels * size.passes > max_mpx * 1e6:
        raise ValueError(f'it declares more than max_image_mpx, {max_mpx:g}; build the map again')
    gray = cv2.imdecode(np.frombuffer(jpeg, np.uint8), cv2.IMREAD_GRAYSCALE) if size else None
    if gray is None:
        raise ValueError('it is no JPEG that can be decoded; build the map again')
    return np.asarray(gray, np.uint8)
