# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The pictures of the report and of ~/debug_image."""

from convseq_ros.app.match_picture import match_picture
from convseq_ros.core.map.image_coding import thumbnail
from convseq_ros.core.types import Candidate, Frame, Match, Reason
from convseq_ros.evaluation.report.results import reduced
import numpy as np
import pytest


@pytest.fixture(autouse=True)
def drawing():
    pytest.importorskip('matplotlib')


def test_a_large_matrix_is_reduced_and_keeps_its_thin_path():
    scores = np.zeros((1000, 700), np.float32)
    scores[500, 333] = 1
    small = reduced(scores)
    assert max(small.shape) <= 320 and small.max() == 1


ACCEPTED = Match(3, 9, Reason.ACCEPTED, (Candidate(5, 8, 0.75),), 2)

SKIPPED = Match(3, 9, Reason.UNREADABLE)

NONE = np.zeros((0, 5))


def flat(value):
    return np.full((120, 160), value, np.uint8)


def test_query_is_left_and_reference_right():
    picture = match_picture(Frame(9, flat(50)), ACCEPTED, thumbnail(flat(200), 64), NONE)
    assert picture.shape == (264, 640, 3)
    assert picture.dtype == np.uint8
    assert (picture[24:, :320] == 50).all()
    assert np.abs(picture[24:, 320:].astype(int) - 200).max() <= 2


def test_the_caption_is_green_only_if_accepted():
    green = match_picture(Frame(9, flat(50)), ACCEPTED, b'', NONE)[:24].reshape(-1, 3)
    grey = match_picture(Frame(9, flat(50)), SKIPPED, b'', NONE)[:24].reshape(-1, 3)
    assert green[:, 1].max() > green[:, 2].max()
    assert (grey == grey[:, :1]).all()
    assert grey.any()


@pytest.mark.parametrize('small', [b'', b'not a jpeg'])
def test_an_unreadable_picture_is_shown_as_a_grey_field(small):
    picture = match_picture(Frame(9, None, problem='cut short'), SKIPPED, small, NONE)
    assert picture.shape == (264, 480, 3)
    assert (picture[24:] == 64).all()


def test_inliers_are_dots_of_one_colour_in_both_pictures_and_others_grey():
    field = np.array([[0.5, 0.25, 0.75, 0.5, 1], [0.25, 0.25, 0.25, 0.25, 0]])
    black = flat(0)
    picture = match_picture(Frame(9, black), ACCEPTED, thumbnail(black, 64), field)[24:]
    assert np.ptp(picture[60, 80].astype(int)) == 0 and picture[60, 80, 0] > 50
    one, other = picture[120, 80], picture[180, 480]
    assert (one == other).all() and np.ptp(one.astype(int)) > 100
    coloured = np.ptp(picture.astype(int), axis=2) > 100
    assert 10 < coloured.sum() < 100
