# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The similarity of two frames of one drive: the paper's, and how much moved together."""

from convseq_ros.core.decision.paper.pair_score import pair_scores, paper_regions
from convseq_ros.core.encoding.descriptor import describe
from convseq_ros.core.encoding.regions import projected_regions
from convseq_ros.core.gate.near_duplicate import Overlap
from convseq_ros.core.similarity.coherent import extract
from convseq_ros.core.similarity.kernels.numpy_coherent import coherent_score, normalized
from convseq_ros.core.types import Descriptor
import cv2
import numpy as np
import pytest


def test_a_region_joins_its_four_cells_row_by_row_at_unit_length():
    cells = np.zeros((2, 2, 1), np.float32)
    assert not paper_regions(cells).any()  # without gradients
    cells[0, 1], cells[1, 0] = 3, 4
    assert paper_regions(cells).tolist() == [[0, pytest.approx(0.6), pytest.approx(0.8), 0]]


@pytest.mark.parametrize(
    ('salient', 'score'), [([True, True], (0.6 + 0.8) / 2), ([False, True], 0.8)]
)
def test_a_pair_scores_the_mean_of_the_best_similarities_of_salient_regions(salient, score):
    query = np.zeros((2, 3, 1), np.float32)
    query[0, :, 0] = [1, 0, 1]
    reference = np.zeros((2, 2, 1), np.float32)
    reference[0, :, 0] = [3, 4]
    described = Descriptor(query, np.array(salient), np.zeros((2, 3)), 0.5)
    regions = paper_regions(described.cells)[described.salient]
    assert pair_scores(regions, [paper_regions(reference)])[0] == pytest.approx(score)


SCENE = cv2.resize(np.random.default_rng(0).random((30, 60), np.float32), (640, 320)) * 200


def view(scale=1.0, noise=0.0, seed=0):
    """Return what a camera sees of a wall from nearer (scale above 1)."""
    turned = cv2.getRotationMatrix2D((320, 160), 0, scale)
    shown = cv2.warpAffine(SCENE, turned, (640, 320))[40:280, 160:480]
    shown = shown + np.random.default_rng(seed).normal(0, noise or 1e-9, shown.shape)
    return describe(np.clip(shown, 0, 255).astype(np.uint8))


def test_scene_overlap_is_the_coherent_score_of_normalised_cells():
    one, other = view(noise=2), view(1.1, noise=2, seed=1)
    features = extract(other, 4.0, projected_regions(normalized(other.cells)))
    expected, _ = coherent_score(features, projected_regions(normalized(one.cells)))
    assert Overlap(0.5)(other, one) == pytest.approx(expected, abs=0.01)


def test_the_overlap_with_a_view_falls_as_the_camera_approaches():
    overlap, first = Overlap(0.5), view()
    shares = [overlap(view(scale), first) for scale in (1.0, 1.05, 1.1, 1.2, 1.4)]
    assert shares[0] > 0.95 and shares[-1] < 0.5
    assert sorted(shares, reverse=True) == shares
