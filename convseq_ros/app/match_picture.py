# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The query beside its best reference: on `~/debug_image`, and drawn by `convseq locate`."""

from convseq_ros.core.geometry.map_view import upright
from convseq_ros.core.map.image_coding import decode_jpeg
from convseq_ros.core.recognizer import PlaceRecognizer
from convseq_ros.core.types import Frame, Match
import cv2
import numpy as np
import numpy.typing as npt

Image = npt.NDArray[np.uint8]
Regions = npt.NDArray[np.float64]  # (n, 5), from `Matcher.field`
_HEIGHT_PX = 240
_CAPTION_PX = 24
_WIDEST_PX = 4 * _HEIGHT_PX  # a wider image is squeezed; limits an image of a single row
_BLANK = np.full((_HEIGHT_PX, _HEIGHT_PX), 64, np.uint8)
_GREEN, _GREY, _OUTLIER = (80, 220, 80), (200, 200, 200), (110, 110, 110)


def answer_picture(frame: Frame, match: Match, recognizer: PlaceRecognizer) -> Image:
    """Return the picture of the newest frame and its answer, as `match_picture`."""
    best, reference_map = match.best, recognizer.reference_map
    thumbnail = reference_map.thumbnail(best.reference_index) if best else b''
    image = upright(frame, reference_map.encoding, recognizer.config.robot)
    return match_picture(
        recognizer.view.brought(image), match, thumbnail, recognizer.displacements(best)
    )


def match_picture(frame: Frame, match: Match, thumbnail: bytes, field: Regions) -> Image:
    """
    Return the query (left) beside the thumbnail of its best reference, BGR (264, width, 3).

    A missing picture is grey. The regions of `field` (n, 5), from `Matcher.field`, are dots:
    an inlier has the same colour in both pictures, an outlier is grey.
    """
    sides = [_to_height(frame.gray), _to_height(decode_jpeg(thumbnail))]
    pictures = np.hstack(sides)[:, :, None].repeat(3, axis=2)
    _draw_field(pictures, sides[0].shape[1], field)
    caption = np.zeros((_CAPTION_PX, pictures.shape[1], 3), np.uint8)
    colour = _GREEN if match.accepted else _GREY
    cv2.putText(
        caption, _caption(match), (4, 17), cv2.FONT_HERSHEY_SIMPLEX, 0.45, colour, 1, cv2.LINE_AA
    )
    return np.vstack([caption, pictures])


def _draw_field(pictures: Image, middle_px: int, field: Regions) -> None:
    """Draw the regions; the hue of an inlier encodes its column in the query."""
    hues = np.full((1, len(field), 3), (0, 200, 255), np.uint8)
    hues[0, :, 0] = 150 * field[:, 1]
    colours = cv2.cvtColor(hues, cv2.COLOR_HSV2BGR)[0] if len(field) else hues[0]
    colours[field[:, 4] == 0] = _OUTLIER
    widths = middle_px, pictures.shape[1] - middle_px
    for (row, column, other_row, other_column, _), colour in zip(field, colours, strict=True):
        for x, y in ((column * widths[0], row), (middle_px + other_column * widths[1], other_row)):
            centre = round(x), round(y * _HEIGHT_PX)
            cv2.circle(pictures, centre, 2, colour.tolist(), -1, cv2.LINE_AA)


def _caption(match: Match) -> str:
    text = f'{match.query_index}: {match.reason.value}, k {match.sequence_length}'
    if match.best:
        text += f', reference {match.best.reference_index}, score {match.best.score:.3f}'
    return text


def _to_height(gray: Image | None) -> Image:
    if gray is None:
        return _BLANK
    height, width = gray.shape
    size = min(max(1, round(width * _HEIGHT_PX / height)), _WIDEST_PX), _HEIGHT_PX
    return np.asarray(cv2.resize(gray, size, interpolation=cv2.INTER_AREA), np.uint8)
