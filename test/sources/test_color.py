# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Frames keep their colours for a model that wants them, and only then."""

from types import SimpleNamespace

from convseq_ros.reading_config import ReadingConfig
from convseq_ros.sources import open_source
from convseq_ros.sources.images import (
    compressed_pixels,
    decode_image,
    gray_and_color,
    image_pixels,
)
import cv2
import numpy as np
import pytest

KEPT = ReadingConfig(keeps_color=True)
BGR = np.full((8, 10, 3), (20, 60, 240), np.uint8)


def message(pixels, encoding):
    height, width = pixels.shape[:2]
    return SimpleNamespace(
        height=height,
        width=width,
        encoding=encoding,
        is_bigendian=0,
        step=pixels.size // height,
        data=pixels.tobytes(),
    )


def mosaic():
    """Return what a sensor with red, green, green and blue squares sees."""
    pixels = np.full((8, 10), 60, np.uint8)
    pixels[::2, ::2], pixels[1::2, 1::2] = 240, 20
    return pixels


@pytest.mark.parametrize(
    ('pixels', 'encoding'), [(BGR, 'bgr8'), (BGR[:, :, ::-1], 'rgb8'), (mosaic(), 'bayer_rggb8')]
)
def test_colours_of_messages_are_blue_green_red(pixels, encoding):
    fields = message(np.ascontiguousarray(pixels), encoding)
    gray, color = gray_and_color(image_pixels(fields, KEPT), KEPT)
    assert (color == BGR).all()
    assert (gray == decode_image(fields)).all()
    assert color.flags.owndata and gray.shape == (8, 10)
    assert gray_and_color(image_pixels(fields), ReadingConfig())[1] is None


def test_a_jpeg_keeps_its_colours():
    data = cv2.imencode('.jpg', BGR)[1].tobytes()
    pixels = compressed_pixels(SimpleNamespace(format='jpeg', data=data), KEPT)
    _, color = gray_and_color(pixels, KEPT)
    assert np.abs(color.astype(int) - BGR).max() < 8


def test_a_folder_and_a_video_keep_their_colours(tmp_path):
    folder = tmp_path / 'folder'
    folder.mkdir()
    cv2.imwrite(str(folder / '1.png'), BGR)
    video = tmp_path / 'drive.avi'
    large = cv2.resize(BGR, (64, 48))
    writer = cv2.VideoWriter(str(video), cv2.VideoWriter_fourcc(*'MJPG'), 20, (64, 48))
    if writer.isOpened():
        writer.write(large)
        writer.release()
    for path in (folder, *([video] if video.exists() else [])):
        (kept,) = open_source(path, reading=KEPT)
        assert np.abs(kept.color.reshape(-1, 3).mean(axis=0) - (20, 60, 240)).max() < 8
        (plain,) = open_source(path)
        assert plain.color is None and (plain.gray == kept.gray).all()
