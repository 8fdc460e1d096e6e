# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""How much of an image moved together since another."""

from convseq_ros.config import EncodingConfig
from convseq_ros.core.encoding.descriptor import blank_descriptor, describe
from convseq_ros.core.encoding.regions import projected_regions
from convseq_ros.core.similarity.coherent import extract
from convseq_ros.core.similarity.kernels.numpy_coherent import coherent_score
from convseq_ros.core.similarity.kernels.numpy_normalization import normalized
from convseq_ros.core.similarity.overlap import Overlap
import cv2
import numpy as np
import pytest

SCENE = cv2.resize(np.random.default_rng(0).random((30, 60), np.float32), (640, 320)) * 200
HEIGHT, WIDTH = 240, 320


def view(scale=1.0, light=1.0, noise=0.0, seed=0):
    """Return what a camera sees of a wall from nearer (scale above 1) or in less light."""
    turned = cv2.getRotationMatrix2D((320, 160), 0, scale)
    shown = cv2.warpAffine(SCENE, turned, (640, 320))[40 : 40 + HEIGHT, 160 : 160 + WIDTH] * light
    shown = shown + np.random.default_rng(seed).normal(0, noise or 1e-9, shown.shape)
    return describe(np.clip(shown, 0, 255).astype(np.uint8))


def since(first, *others):
    overlap = Overlap(0.5)
    prepared = overlap.prepare(first)
    return [overlap.since(prepared, other) for other in others]


def test_it_is_the_coherent_score_with_normalised_cells():
    one, other = view(noise=2), view(1.1, noise=2, seed=1)
    features = extract(other, 4.0, projected_regions(normalized(other.cells)))
    expected, _ = coherent_score(features, projected_regions(normalized(one.cells)))
    assert since(one, other) == pytest.approx([expected], abs=1e-6)


def test_the_same_view_overlaps_and_it_gets_less_and_less_on_the_way():
    shares = since(view(), *(view(scale) for scale in (1.0, 1.05, 1.1, 1.2, 1.4)))
    assert shares[0] > 0.95 and shares[-1] < 0.5
    assert sorted(shares, reverse=True) == shares


def test_nothing_remembered_or_nothing_shown_is_no_overlap():
    assert Overlap(0.5).since(None, view()) == 0.0
    assert since(view(), blank_descriptor(EncodingConfig())) == [0.0]


def test_above_a_share_is_what_its_exact_score_is():
    overlap = Overlap(0.5)
    first, others = view(noise=1), [view(scale, noise=1) for scale in (1.0, 1.1, 1.2)]
    prepared = overlap.prepare(first)
    for other in others:
        exact = overlap.since(prepared, other)
        for share in (exact - 0.1, exact - 1e-5, exact + 1e-5, exact + 0.1):
            assert overlap.is_above(prepared, other, share) == (exact > share)
    assert not overlap.is_above(None, first, 0.0)
