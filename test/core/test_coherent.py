# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Coherent matching: where regions went, less the background, and by global similarity."""

import importlib.util
from itertools import product
from pathlib import Path
from types import SimpleNamespace

from convseq_ros.config import EncodingConfig, MatchingConfig
from convseq_ros.core.compiled import available
from convseq_ros.core.encoding.descriptor import describe, ENTROPY
from convseq_ros.core.encoding.regions import (
    global_descriptor,
    joined_regions,
    projected_regions,
    projection,
)
from convseq_ros.core.map.place import pack_cells, Place, unpack_cells
from convseq_ros.core.similarity.coherent import extract, global_similarity, region_blocks, widened
from convseq_ros.core.similarity.feature_cache import Background
from convseq_ros.core.similarity.kernels.numpy_coherent import (
    coherent_score,
    less_background,
    normalized,
    NumpyCoherent,
)
from convseq_ros.core.similarity.matcher import Matcher
from convseq_ros.core.types import Descriptor
import cv2
import numpy as np
import pytest
from world import map_of

REPOSITORY = Path(__file__).resolve().parents[2]
LEAST_BITS = 0.5 * ENTROPY.max_bits


def texture(seed, shape=(512, 512)):
    rng = np.random.default_rng(seed)
    coarse = cv2.resize(rng.random((24, 24)).astype(np.float32), shape[::-1])
    return ((coarse + rng.random(shape)) * 120).astype(np.uint8)


def oracle(query, entropy, reference):
    """Return score and shift as the definition says it, region by region."""
    size, sigma = len(query) - 2, 1.5
    mean, axes = projection()

    def regions(cells):
        found = {}
        for row, column in product(range(size), repeat=2):
            joined = cells[row : row + 3, column : column + 3].ravel().astype(float)
            length = np.linalg.norm(joined)
            projected = ((joined / length if length else joined) - mean) @ axes
            found[row, column] = projected / np.linalg.norm(projected)
        return found

    own, other = regions(query), regions(reference)
    bits = {(row, column): entropy[row : row + 3, column : column + 3] for row, column in own}
    salient = [place for place in own if bits[place].mean() >= LEAST_BITS]
    votes = []
    for place in salient:
        best = max(other, key=lambda there, place=place: own[place] @ other[there])
        votes.append((best[0] - place[0], best[1] - place[1], 1.0))
    for there in other:
        best = max(salient, key=lambda place, there=there: own[place] @ other[there])
        weight = len(salient) / len(other)
        votes.append((there[0] - best[0], there[1] - best[1], weight))
    rows, columns, weights = np.array(votes).T
    peaks = {}
    for row, column in product(range(1 - size, size), repeat=2):
        away = (rows - row) ** 2 + (columns - column) ** 2
        peaks[row, column] = (weights * np.exp(-away / (2 * sigma**2))).sum()
    best = max(peaks, key=peaks.get)
    return peaks[best] / (2 * len(salient)), best


def test_score_and_shift_are_those_of_the_definition():
    encoding = EncodingConfig(image_size_px=256)
    query = describe(texture(0), encoding)
    reference = describe(np.roll(texture(0), 64, axis=1) // 2 + 9, encoding)
    found = coherent_score(extract(query, LEAST_BITS), projected_regions(reference.cells))
    expected = oracle(query.cells, query.cell_entropy, reference.cells)
    assert found[0] == pytest.approx(expected[0], abs=1e-3) and found[1] == expected[1]
    assert found[1] == (0, 2)


def test_regions_are_of_unit_length_and_flat_ones_have_a_place_too():
    cells = np.zeros((32, 32, 8), np.float32)
    assert not joined_regions(cells).any()
    assert np.linalg.norm(projected_regions(cells), axis=1) == pytest.approx(1.0)


def test_the_script_reproduces_the_projection(shared_data):
    script = REPOSITORY / 'scripts' / 'make_projection.py'
    spec = importlib.util.spec_from_file_location('make_projection', script)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    fitted = module.fit(shared_data / 'rtabmap84')
    mean, axes = projection()
    assert np.abs(fitted[:, 0] - mean).max() < 1e-5
    assert np.abs(fitted[:, 1:] - axes).max() < 0.02
    published = np.load(shared_data / 'coherent' / 'projection.npz', allow_pickle=False)
    assert np.abs(axes @ axes.T - published['projection'] @ published['projection'].T).max() < 0.2


EVERYTHING = np.full((32, 32), 8.0)


def drawn(seed, share=0.0):
    """Return cells that are a background, the same for all, to some share."""
    own, common = (np.random.default_rng(one).random((32, 32, 8)) ** 3 for one in (seed, 99))
    return unpack_cells(pack_cells(((1 - share) * own + share * common).astype(np.float32)))


def described(cells):
    return Descriptor(cells, np.ones(961, bool), EVERYTHING, 0.5)


def matcher(reference_map):
    return Matcher(reference_map, MatchingConfig(), 0.5)


def test_with_a_background_up_to_half_is_lost_where_images_differ_globally():
    references = [drawn(seed, 0.5) for seed in range(24)]
    query, one = described(drawn(3, 0.6)), matcher(map_of(references))
    found = one.scores_of([(one.extract(query), np.arange(24))])[0]
    background = Background(map_of(references), NumpyCoherent())
    background.update_map()
    cells = normalized(query.cells)
    regions = projected_regions(cells)
    own, _ = less_background(regions, background.update(regions))
    for score, reference in zip(found, references, strict=True):
        other, _ = less_background(projected_regions(normalized(reference)), background.of_map)
        share, _ = coherent_score(extract(query, 4.0, own), other)
        (same,) = alike(own, other)
        # The matcher rounds regions to bytes.
        assert score == pytest.approx(share * (1 + same) / 2, abs=2e-3)


def test_subtracting_the_background_lowers_the_scores_of_wrong_places(monkeypatch):
    reference_map, query = map_of(drawn(seed, 0.6) for seed in range(40)), drawn(7, 0.55)

    def mean_of_wrong_places():
        one = matcher(reference_map)
        scores = one.scores_of([(one.extract(described(query)), np.arange(40))])[0]
        assert scores.argmax() == 7
        return np.delete(scores, 7).mean()

    subtracted = mean_of_wrong_places()
    monkeypatch.setattr(Background, 'update_map', lambda _: False)
    assert subtracted < mean_of_wrong_places() / 3


def test_the_global_descriptor_is_the_cosine_transform_of_the_leading_axes():
    cells = describe(texture(0)).cells
    image = projected_regions(cells).reshape(30, 30, 32)
    found = global_descriptor(cells)
    assert found.shape == (252,) and found.dtype == np.float16
    middles = (np.arange(30) + 0.5) / 30
    waves = [(np.sqrt(2) if one else 1) * np.cos(np.pi * one * middles) for one in range(6)]
    expected = [
        np.mean(image[:, :, axis] * np.outer(waves[down], waves[across]))
        for down, across, axis in product(range(6), range(6), range(12))
        if down + across < 6
    ]
    assert found == pytest.approx(expected, abs=2e-4)


def drawn_regions(seed):
    return np.random.default_rng(seed).normal(size=(900, 32)).astype(np.float32)


def alike(query, *references):
    others = np.array([region_blocks(one) for one in references], np.float64)
    return global_similarity(widened(region_blocks(query), 30), others)


def test_blocks_are_the_sums_of_nine_regions():
    found = region_blocks(drawn_regions(0)).reshape(10, 10, 32)
    sums = drawn_regions(0).reshape(10, 3, 10, 3, 32).sum(axis=(1, 3))
    assert found / 2**17 == pytest.approx(sums, abs=1e-5)
    assert (found == np.rint(found)).all()


@pytest.mark.parametrize('right', [12, -9, 3])
def test_an_image_that_moved_a_few_blocks_to_the_side_is_still_alike(right):
    moved = np.roll(drawn_regions(1).reshape(30, 30, 32), right, 1).reshape(900, 32)
    found, other, nothing = alike(drawn_regions(1), moved, drawn_regions(2), 0 * moved)
    left = 1 - abs(right) / 30
    assert found == pytest.approx(left, abs=0.05) and found > other + 0.4 and nothing == 0


def test_an_image_without_gradients_is_similar_to_none():
    assert alike(np.zeros((900, 32), np.float32), drawn_regions(1))[0] == 0


def lit(seed):
    return np.random.default_rng(seed).random((32, 32, 8), np.float32) ** 3


def background_of(count, blank=()):
    """Return the background of a map of textures, some of them blank, and the map."""
    reference_map = map_of(lit(index) * (index not in blank) for index in range(count))
    pair = SimpleNamespace(normalize=lambda cells: cells, project=projected_regions)
    return Background(reference_map, pair), reference_map


def test_a_cell_loses_the_minimum_of_its_bins_and_is_saturated():
    cells = np.array([1, 3, 1, 1, 1, 1, 1, 1], np.float32).reshape(1, 1, 8)
    mean = 2 / 8
    expected = [0, 2 / (2 + 6 * mean), 0, 0, 0, 0, 0, 0]
    assert normalized(cells).ravel() == pytest.approx(expected, abs=1e-6)


def test_neighbouring_cells_are_blended_with_weights_of_a_gaussian():
    cells = np.zeros((5, 5, 8), np.float32)
    cells[2, 2, 0] = 100
    found = normalized(cells)[:, :, 0]
    # Of x / (x + u), with u six times the mean, which blending does not change.
    typical = 6 * 100 / cells.size
    blended = found * typical / (1 - found)
    beside = np.exp(-1 / (2 * 0.4**2))
    middle, side = 1 / (1 + 2 * beside), beside / (1 + 2 * beside)
    assert blended[2, 2] == pytest.approx(100 * middle**2, rel=2e-3)
    assert blended[1, 2] == pytest.approx(100 * middle * side, rel=2e-3)
    assert blended[2, 1] == pytest.approx(100 * middle * side, rel=2e-3)
    assert blended[1, 1] == pytest.approx(100 * side**2, rel=4e-3)
    assert not blended[0].any()


@pytest.mark.skipif(not available(), reason='no compiled kernels')
@pytest.mark.parametrize('side', [1, 2, 7, 32])
def test_compiled_normalisation_is_the_definition(side):
    from convseq_ros.core.similarity.kernels.coherent import normalized as compiled

    for cells in (1000 * lit(0)[:side, :side], np.zeros((side, side, 8), np.float32)):
        assert compiled(cells) == pytest.approx(normalized(cells), abs=1e-6)


def test_the_background_is_subtracted_and_the_rest_has_unit_length():
    regions = np.array([[3.0, 4.0], [1.0, 0.0]], np.float32)
    background = np.array([[0.0, 4.0], [1.0, 1.0]], np.float32)
    assert less_background(regions, background)[0].tolist() == [[1.0, 0.0], [0.0, -1.0]]
    assert less_background(regions, None)[0] is regions


def test_the_background_of_a_map_is_the_mean_of_its_references():
    background, reference_map = background_of(20, blank=(3,))
    assert background.update_map()
    shown = (reference_map.cells(index) for index in range(20) if index != 3)
    expected = np.mean([projected_regions(cells) for cells in shown], axis=0)
    assert background.of_map == pytest.approx(expected, abs=1e-6)


def test_a_background_needs_20_places_and_is_updated_when_the_map_doubles():
    (background, reference_map), updated = background_of(19), []
    assert not background.update_map() and background.of_map is None
    assert background.update(projected_regions(lit(0))) is None
    for index in range(19, 90):
        reference_map.add(Place(index), pack_cells(lit(index)))
        if background.update_map():
            updated.append(len(reference_map))
    assert updated == [20, 40, 80]


def test_the_drive_is_averaged_the_map_counts_as_5_frames_and_standing_still_as_one():
    background, _ = background_of(25)
    background.update_map()
    one, two = projected_regions(lit(100)), projected_regions(lit(101))
    first = background.update(one)
    assert first == pytest.approx((one + 5 * background.of_map) / 6, abs=1e-6)
    for seed in range(50):  # a robot that hardly moves
        again = lit(100) + np.float32(0.02) * lit(seed)
        assert np.array_equal(background.update(projected_regions(again)), first)
    second = background.update(two)
    assert second == pytest.approx((one + two + 5 * background.of_map) / 7, abs=1e-6)
