# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Masks and turned cameras: the robot itself is not the world, and up is up."""

from dataclasses import replace
import os

from convseq_ros import build_map, Config, open_map, PlaceRecognizer
from convseq_ros.config import EncodingConfig
from convseq_ros.core.encoding.descriptor import describe, seen_cells
from convseq_ros.core.encoding.view import upright, with_mask_read
from convseq_ros.core.types import Camera, Frame
from convseq_ros.errors import ConfigError, MapError
import cv2
import numpy as np
import pytest


@pytest.fixture
def mask(tmp_path):
    """Return the path of a mask that hides the lower half, drawn at twice the images' size."""
    picture = np.full((240, 320), 255, np.uint8)
    picture[120:] = 0
    path = tmp_path / 'mask.png'
    cv2.imwrite(str(path), picture)
    return str(path)


def bonnet(gray, seed):
    """Return an image whose lower half is a robot that looks otherwise each time."""
    hidden = gray.copy()
    hidden[60:] = np.random.default_rng(seed).integers(0, 256, hidden[60:].shape)
    return hidden


def test_what_is_hidden_changes_nothing_of_a_descriptor(image, mask):
    encoding = with_mask_read(EncodingConfig(image_mask=mask))
    one, other = (describe(bonnet(image(3), seed), encoding) for seed in (1, 2))
    assert np.array_equal(one.cells, other.cells)
    seen = seen_cells(encoding.image_mask, 32)
    assert seen[:15].all() and not seen[15:].any()  # 2 px below the 16th row of cells are hidden
    assert not one.cells[15:].any() and one.cells[:15].any(axis=-1).all()
    salient = one.salient.reshape(31, 31)
    assert salient[:14].any() and not salient[14:].any()
    assert 0 < one.entropy < 1


@pytest.mark.parametrize('kind', ['black', 'absent', 'text', 'pipe', 'bomb', 'folder'])
def test_a_mask_that_shows_nothing_is_refused_in_one_line(tmp_path, kind):
    path = tmp_path / 'mask.png'
    if kind == 'black':
        cv2.imwrite(str(path), np.zeros((48, 64), np.uint8))
    elif kind == 'text':
        path.write_text('no picture')
    elif kind == 'pipe':
        os.mkfifo(path)
    elif kind == 'bomb':
        path.write_bytes(b'P5 30000 30000 255\n' + bytes(1000))
    elif kind == 'folder':
        path.mkdir()
    with pytest.raises(ConfigError, match=r'image_mask: .*mask\.png[: ][^\n]*$'):
        build_map([], config=Config(encoding=EncodingConfig(image_mask=str(path))))


def frames(image, **changes):
    """Return 30 frames of places that no other frame shows, the robot in their lower halves."""
    return [Frame(index * 10**8, bonnet(image(index, 1), index)) for index in range(1, 31)]


def test_a_map_keeps_its_mask_and_compares_it(image, mask, tmp_path):
    config = Config(encoding=EncodingConfig(image_mask=mask))
    build_map(frames(image), tmp_path / 'map.db', config)
    (tmp_path / 'mask.png').unlink()
    kept = open_map(tmp_path / 'map.db')
    assert not kept.cells(4)[15:].any()
    # Whoever says nothing of a mask takes the map's own; so the same frames are the same places.
    recognizer = PlaceRecognizer(kept)
    found = [recognizer.process(frame).best for frame in frames(image)]
    assert [one.reference_index for one in found[5:]] == list(range(5, 30))
    picture = np.full((64, 64), 255, np.uint8)
    picture[:, :20] = 0
    cv2.imwrite(str(tmp_path / 'other.png'), picture)
    with pytest.raises(MapError, match='made with another image_mask'):
        open_map(tmp_path / 'map.db', EncodingConfig(image_mask=str(tmp_path / 'other.png')))


def test_a_camera_turns_with_its_image():
    camera = Camera(160, 120, 100.0, 110.0, 70.0, 55.0)
    frame = Frame(0, np.arange(120 * 160, dtype=np.uint32).astype(np.uint8).reshape(120, 160))
    frame = replace(frame, camera=camera)
    left = upright(frame, EncodingConfig(image_rotation_deg=90))
    assert left.gray.shape == (160, 120)
    assert left.camera == Camera(120, 160, 110.0, 100.0, 55.0, 89.0)
    # What lies on the optical axis, row 55 and column 70, does so still.
    assert left.gray[89, 55] == frame.gray[55, 70]
    back = upright(left, EncodingConfig(image_rotation_deg=270))
    assert back.camera == camera and np.array_equal(back.gray, frame.gray)
    with pytest.raises(ConfigError, match='image_rotation_deg: 45 is not a multiple of 90'):
        EncodingConfig(image_rotation_deg=45)
