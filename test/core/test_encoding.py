# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Cells, entropy and salient regions, against their definition in float64, compiled and not."""

from convseq_ros.config import EncodingConfig
from convseq_ros.core import compiled
from convseq_ros.core.encoding.descriptor import cell_histograms, describe, salient_regions
from convseq_ros.core.encoding.entropy import cell_entropies
import cv2
from hypothesis import given, settings
from hypothesis import strategies as st
import numpy as np
import pytest
from skimage.filters.rank import entropy as rank_entropy
from skimage.morphology import disk

from test.core.entropy_map import entropy_map

WAYS = ['compiled', 'plain']

SIZES = [64, 112, 512, 528]


@pytest.fixture(params=WAYS)
def way(request, monkeypatch):
    choose(request.param, monkeypatch)
    return request.param


def choose(way, monkeypatch):
    if way == 'compiled' and not compiled.available():
        pytest.skip(f'no compiled kernels: {compiled.library().problem}')
    monkeypatch.setattr(compiled, 'available', lambda: way == 'compiled')


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
    bits = rank_entropy(small, disk(5))
    return cv2.resize(bits, gray.shape[::-1], interpolation=cv2.INTER_LINEAR)


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


@pytest.mark.parametrize('way', WAYS)
@settings(max_examples=25, deadline=None, derandomize=True)
@given(gray=pictures)
def test_histograms_are_those_of_the_definition(way, gray):
    with pytest.MonkeyPatch.context() as patch:
        choose(way, patch)
        cells = cell_histograms(gray)
    expected = histograms_by_definition(gray)
    assert cells.dtype == np.float32 and cells.shape == expected.shape
    assert np.abs(cells - expected).max() <= 1e-6 * max(expected.max(), 1)


@pytest.mark.parametrize('way', WAYS)
@settings(max_examples=25, deadline=None, derandomize=True)
@given(gray=pictures)
def test_entropy_is_that_of_scikit_image_up_to_the_edges(way, gray):
    with pytest.MonkeyPatch.context() as patch:
        choose(way, patch)
        bits = entropy_map(gray)
        by_cell = cell_entropies(gray, len(gray) // 16, cv2.INTER_LINEAR)
    expected = entropy_by_definition(gray)
    assert np.abs(bits - expected).max() < 1e-9
    cells = len(gray) // 16
    means = expected.reshape(cells, 16, cells, 16).mean(axis=(1, 3))
    assert np.abs(by_cell - means).max() < 1e-9
    assert by_cell.min() >= 0


@pytest.mark.parametrize('kind', ['blurred noise', 'few values', 'two values'])
def test_the_same_regions_are_salient_as_by_definition(way, kind):
    gray = picture(kind, 512, 3)
    means = entropy_by_definition(gray).reshape(32, 16, 32, 16).mean(axis=(1, 3))
    threshold = float(np.median(means)) / 8 * 1.01
    found = describe(gray, EncodingConfig(saliency_threshold=threshold, resize='linear'))
    assert 0 < found.salient.sum() < found.salient.size
    assert (found.salient == salient_regions(means, threshold)).all()


def residue(grey, brightest):
    """Return what float64 leaves of the horizontal gradient among equal pixels."""
    value = np.sqrt(grey / brightest) * 255.0
    return 16 * (-value - 2 * value + 2 * value + value)


def test_a_flat_patch_keeps_the_rounding_of_float64_as_the_released_script_does(way):
    greys = np.arange(1, 256, dtype=np.uint8).reshape(15, 17)
    seen = set()
    for patch in greys.ravel():
        gray = np.full((32, 96), patch, np.uint8)
        gray[:, 64:] = 255
        left = cell_histograms(np.vstack([gray, gray, gray]))[2, 1]
        expected = np.zeros(8)
        left_over = residue(float(patch), 255.0)
        expected[0 if left_over >= 0 else 4] = 128 * abs(left_over)
        assert left.tolist() == expected.astype(np.float32).tolist()
        seen.add(np.sign(left_over))
    assert seen == {-1, 0, 1}


@pytest.mark.parametrize('shape', [(1, 1), (1, 9), (480, 640)])
@pytest.mark.parametrize('side', [64, 80, 2048])
def test_images_of_any_size_are_encoded_at_every_size(way, shape, side):
    image = np.random.default_rng(0).integers(0, 256, shape, np.uint8)
    found = describe(image, EncodingConfig(image_size_px=side))
    cells = side // 16
    assert found.cells.shape == (cells, cells, 8) and found.salient.shape == ((cells - 1) ** 2,)
    assert np.isfinite(found.cells).all() and found.cells.min() >= 0
    assert 0 <= found.entropy <= np.log2(81) / 8


@pytest.mark.parametrize('value', [0, 1, 128, 255])
@pytest.mark.parametrize('shape', [(1, 1), (1, 700), (480, 640)])
def test_a_flat_image_of_any_size_is_uninformative_and_has_no_nan(value, shape):
    found = describe(np.full(shape, value, np.uint8))
    assert not found.informative
    assert np.isfinite(found.cells).all() and found.entropy == 0


@pytest.mark.parametrize(
    'image', [np.zeros((0, 5), np.uint8), np.zeros((4, 4, 3), np.uint8), np.zeros((4, 4))]
)
def test_what_is_no_grey_image_is_refused(image):
    with pytest.raises(ValueError, match='expected'):
        describe(image)
