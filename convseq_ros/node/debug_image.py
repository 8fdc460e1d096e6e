# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The picture on `~/debug_image`: the query beside its best reference."""

from convseq_ros.core.reference_map import Place
from convseq_ros.core.thumbnail import picture
from convseq_ros.core.types import Frame, Match
import cv2
import numpy as np
import numpy.typing as npt

_HEIGHT_PX = 240
_CAPTION_PX = 24
_BLANK = np.full((_HEIGHT_PX, _HEIGHT_PX), 64, np.uint8)
_GREEN, _GREY = (80, 220, 80), (200, 200, 200)


def debug_image(frame: Frame, match: Match, place: Place | None) -> npt.NDArray[np.uint8]:
    """
    Return the query (left) beside the thumbnail of its best reference (right), with a caption.

    Parameters
    ----------
    frame : Frame
        The query; a grey field stands for one that could not be read.
    match : Match
        What came of it; the caption is green if it was accepted.
    place : Place, optional
        The best reference; a grey field stands for none, or one without a thumbnail.

    Returns
    -------
    ndarray of uint8, shape (264, width, 3)
        BGR.

    """
    sides = [_to_height(frame.gray), _to_height(picture(place.thumbnail) if place else None)]
    pictures = np.hstack(sides)[:, :, None].repeat(3, axis=2)
    caption = np.zeros((_CAPTION_PX, pictures.shape[1], 3), np.uint8)
    colour = _GREEN if match.accepted else _GREY
    cv2.putText(
        caption, _caption(match), (4, 17), cv2.FONT_HERSHEY_SIMPLEX, 0.45, colour, 1, cv2.LINE_AA
    )
    return np.vstack([caption, pictures])


def _caption(match: Match) -> str:
    text = f'{match.query_index}: {match.reason.value}, k {match.sequence_length}'
    if match.best:
        text += f', reference {match.best.reference_index}, score {match.best.score:.3f}'
    return text


def _to_height(gray: npt.NDArray[np.uint8] | None) -> npt.NDArray[np.uint8]:
    if gray is None:
        return _BLANK
    height, width = gray.shape
    size = max(1, round(width * _HEIGHT_PX / height)), _HEIGHT_PX
    return np.asarray(cv2.resize(gray, size, interpolation=cv2.INTER_AREA), np.uint8)
