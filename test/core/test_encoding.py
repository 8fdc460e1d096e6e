# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Cells, entropy and regions, against their definition in float64; masks and turned cameras."""

from dataclasses import replace
import os

from convseq_ros import build_map, Config, open_map, PlaceRecognizer
from convseq_ros.config import EncodingConfig
from convseq_ros.core import compiled
from convseq_ros.core.encoding.descriptor import (
    cell_entropies,
    cell_histograms,
    describe,
    local_entropy,
    salient_regions,
    visible_cells,
)
from convseq_ros.core.encoding.mask import masked
from convseq_ros.core.geometry.map_view import upright
from convseq_ros.core.types import Camera, Frame
from convseq_ros.errors import ConfigError, MapError
from convseq_ros.io.mask_file import read_mask
import cv2
from hypothesis import given, settings
from hypothesis import strategies as st
import numpy as np
import pytest
from skimage.filters.rank import entropy as rank_entropy
from skimage.morphology import disk

KERNELS = ['compiled', 'plain']
SIZES = [64, 112, 512, 528]


def choose(kernels, monkeypatch):
    if kernels == 'compiled' and not compiled.available():
        pytest.skip(f'no compiled kernels: {compiled.library().problem}')
    monkeypatch.setattr(compiled, 'available', lambda: kernels == 'compiled')


@pytest.fixture(params=KERNELS)
def kernels(request, monkeypatch):
    choose(request.param, monkeypatch)


def histograms_by_definition(gray):
    """Return the cells of an image, every step for the whole image and in float64."""
    side = gray.shape[0] // 16
    corrected = np.sqrt(gray / max(float(gray.max()), 1)) * 255.0
    gx = cv2.Sobel(corrected, cv2.CV_64F, 1, 0, ksize=5)
    gy = cv2.Sobel(corrected, cv2.CV_64F, 0, 1, ksize=5)
    strength = np.abs(gx + gy) / 2
    position = cv2.phase(gx, gy, angleInDegrees=True) / 45
    lower = np.floor(position).astype(int)
    cells = np.zeros((side, side, 8))
    row, column = np.indices(gray.shape) // 16
    np.add.at(cells, (row, column, lower % 8), strength * (1 - position + lower))
    np.add.at(cells, (row, column, (lower + 1) % 8), strength * (position - lower))
    return cells


def entropy_by_definition(gray):
    small = cv2.resize(gray, (100, 100), interpolation=cv2.INTER_LINEAR)
    return cv2.resize(
        rank_entropy(small, disk(5)), gray.shape[::-1], interpolation=cv2.INTER_LINEAR
    )


def picture(kind, side, seed):
    rng = np.random.default_rng(seed)
    value = int(rng.integers(1, 256))
    if kind == 'flat':
        return np.full((side, side), value, np.uint8)
    if kind == 'two values':
        return rng.choice(np.array([0, value], np.uint8), (side, side))
    if kind == 'saturated':
        return (rng.normal(255, 20, (side, side)).clip(0, 255)).astype(np.uint8)
    if kind == 'one pixel':
        image = np.full((side, side), value, np.uint8)
        image[tuple(rng.integers(0, side, 2))] ^= 255
        return image
    if kind == 'few values':
        coarse = rng.integers(0, 9, (side // 16, side // 16), np.uint8) * 28
        return np.kron(coarse, np.ones((16, 16), np.uint8))
    if kind == 'noise':
        return rng.integers(0, 256, (side, side), np.uint8)
    return cv2.GaussianBlur(rng.integers(0, 256, (side, side), np.uint8), (0, 0), 3)


KINDS = ['flat', 'two values', 'saturated', 'one pixel', 'few values', 'noise', 'blurred noise']

pictures = st.builds(
    picture, st.sampled_from(KINDS), st.sampled_from(SIZES), st.integers(0, 2**32 - 1)
)


@pytest.mark.parametrize('kernels', KERNELS)
@settings(max_examples=25, deadline=None, derandomize=True)
@given(gray=pictures)
def test_histograms_and_entropies_are_those_of_their_definitions(kernels, gray):
    with pytest.MonkeyPatch.context() as patch:
        choose(kernels, patch)
        cells = cell_histograms(gray)
        small = local_entropy(gray, cv2.INTER_LINEAR)
        by_cell = cell_entropies(gray, len(gray) // 16, cv2.INTER_LINEAR)
    expected = histograms_by_definition(gray)
    assert cells.dtype == np.float32 and cells.shape == expected.shape
    assert np.abs(cells - expected).max() <= 1e-6 * max(expected.max(), 1)
    # Of scikit-image, up to the edges.
    bits = cv2.resize(small, gray.shape[::-1], interpolation=cv2.INTER_LINEAR)
    expected = entropy_by_definition(gray)
    assert np.abs(bits - expected).max() < 1e-9
    means = expected.reshape(len(by_cell), 16, len(by_cell), 16).mean(axis=(1, 3))
    assert np.abs(by_cell - means).max() < 1e-9
    assert by_cell.min() >= 0


@pytest.mark.parametrize('kind', ['blurred noise', 'few values', 'two values'])
def test_the_same_regions_are_salient_as_by_definition(kernels, kind):
    gray = picture(kind, 512, 3)
    means = entropy_by_definition(gray).reshape(32, 16, 32, 16).mean(axis=(1, 3))
    threshold = float(np.median(means)) / 8 * 1.01
    found = describe(gray, EncodingConfig(saliency_threshold=threshold, resize='linear'))
    assert 0 < found.salient.sum() < found.salient.size
    assert (found.salient == salient_regions(means, threshold)).all()


def test_a_flat_patch_keeps_the_rounding_of_float64_as_the_released_script_does(kernels):
    signs = set()
    for patch in range(1, 256):
        gray = np.full((96, 96), patch, np.uint8)
        gray[:, 64:] = 255
        # What float64 leaves of the horizontal gradient among equal pixels.
        value = np.sqrt(float(patch) / 255.0) * 255.0
        left_over = 16 * (-value - 2 * value + 2 * value + value)
        expected = np.zeros(8)
        expected[0 if left_over >= 0 else 4] = 128 * abs(left_over)
        assert cell_histograms(gray)[2, 1].tolist() == expected.astype(np.float32).tolist()
        signs.add(np.sign(left_over))
    assert signs == {-1, 0, 1}


@pytest.mark.parametrize('shape', [(1, 1), (1, 9), (480, 640)])
@pytest.mark.parametrize('side', [64, 80, 2048])
def test_images_of_any_size_are_encoded_at_every_size(kernels, shape, side):
    image = np.random.default_rng(0).integers(0, 256, shape, np.uint8)
    found = describe(image, EncodingConfig(image_size_px=side))
    cells = side // 16
    assert found.cells.shape == (cells, cells, 8) and found.salient.shape == ((cells - 1) ** 2,)
    assert np.isfinite(found.cells).all() and found.cells.min() >= 0
    assert 0 <= found.entropy <= np.log2(81) / 8


@pytest.mark.parametrize('shape', [(1, 1), (1, 700), (480, 640)])
def test_a_flat_image_of_any_size_is_uninformative_and_has_no_nan(shape):
    for value in (0, 1, 128, 255):
        found = describe(np.full(shape, value, np.uint8))
        assert not found.informative
        assert np.isfinite(found.cells).all() and found.entropy == 0


@pytest.mark.parametrize(
    'image', [np.zeros((0, 5), np.uint8), np.zeros((4, 4, 3), np.uint8), np.zeros((4, 4))]
)
def test_an_invalid_grey_image_is_refused(image):
    with pytest.raises(ValueError, match='expected'):
        describe(image)


@pytest.fixture
def mask(tmp_path):
    """Return the path of a mask that hides the lower half, drawn at twice the images' size."""
    picture = np.full((240, 320), 255, np.uint8)
    picture[120:] = 0
    path = tmp_path / 'mask.png'
    cv2.imwrite(str(path), picture)
    return str(path)


def with_mask(path):
    """Return a configuration with a mask, which is read."""
    config = Config(encoding=EncodingConfig(image_mask=str(path)))
    return masked(config, read_mask(config))


def bonnet(gray, seed):
    """Return an image whose lower half is a robot that looks otherwise each time."""
    body = np.random.default_rng(seed).integers(0, 256, gray[60:].shape, np.uint8)
    return np.vstack((gray[:60], body))


def test_hidden_parts_of_an_image_do_not_change_its_descriptor(image, mask):
    encoding = with_mask(mask).encoding
    one, other = (describe(bonnet(image(3), seed), encoding) for seed in (1, 2))
    assert np.array_equal(one.cells, other.cells)
    visible = visible_cells(encoding.image_mask, 32)
    # 2 px below the 16th row of cells are hidden.
    assert visible[:15].all() and not visible[15:].any()
    assert not one.cells[15:].any() and one.cells[:15].any(axis=-1).all()
    salient = one.salient.reshape(31, 31)
    assert salient[:14].any() and not salient[14:].any()
    assert 0 < one.entropy < 1


BLACK = cv2.imencode('.png', np.zeros((48, 64), np.uint8))[1].tobytes()
BAD_MASKS = {
    'black': lambda path: path.write_bytes(BLACK), 'absent': lambda _: None,
    'text': lambda path: path.write_text('no picture'), 'pipe': os.mkfifo,
    'bomb': lambda path: path.write_bytes(b'P5 30000 30000 255\n' + bytes(1000)),
    'folder': lambda path: path.mkdir(),
}  # fmt: skip


@pytest.mark.parametrize('kind', BAD_MASKS)
def test_an_invalid_mask_is_refused_in_one_line(tmp_path, kind):
    BAD_MASKS[kind](tmp_path / 'mask.png')
    with pytest.raises(ConfigError, match=r'image_mask: .*mask\.png[: ][^\n]*$'):
        with_mask(tmp_path / 'mask.png')


def test_the_core_opens_no_mask(image, mask, tmp_path):
    encoding = EncodingConfig(image_mask=mask)
    build_map([Frame(1, image(1))], tmp_path / 'map.db')
    for use in (
        lambda: build_map([], config=Config(encoding=encoding)),
        lambda: build_map([], tmp_path / 'new.db', Config(encoding=encoding)),
        lambda: open_map(tmp_path / 'map.db', encoding),
    ):
        with pytest.raises(ConfigError, match=r'image_mask: .*mask\.png is a file; use .*masked'):
            use()
    assert not (tmp_path / 'new.db').exists()


def test_a_map_keeps_its_mask_and_compares_it(image, mask, tmp_path):
    # Places that no other frame shows, the robot in their lower halves.
    frames = [Frame(one * 10**8, bonnet(image(one, 1), one)) for one in range(1, 31)]
    build_map(frames, tmp_path / 'map.db', with_mask(mask))
    (tmp_path / 'mask.png').unlink()
    kept = open_map(tmp_path / 'map.db')
    assert not kept.cells(4)[15:].any()
    # Whoever says nothing of a mask takes the map's own; so the same frames are the same places.
    recognizer = PlaceRecognizer(kept)
    found = [recognizer.process(frame).best for frame in frames]
    assert [one.reference_index for one in found[5:]] == list(range(5, 30))
    picture = np.full((64, 64), 255, np.uint8)
    picture[:, :20] = 0
    cv2.imwrite(str(tmp_path / 'other.png'), picture)
    with pytest.raises(MapError, match='made with another image_mask'):
        open_map(tmp_path / 'map.db', with_mask(tmp_path / 'other.png').encoding)


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
