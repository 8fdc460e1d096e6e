# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Score matrices through the sequence stage: the same answers as the recogniser."""

from dataclasses import replace

from convseq_ros.core.sequence.diagonals import BACKWARD, FORWARD
from convseq_ros.core.types import Reason
from convseq_ros.evaluation.cache import Cache
from convseq_ros.evaluation.recognition import answer_again, pair_scores, recognize, with_known
from convseq_ros.evaluation.sequence_matching import choose_lengths, decide_frames, score_sequences
import numpy as np
import pytest


@pytest.mark.parametrize('fixed_length', [0, 1, 5])
@pytest.mark.parametrize('matching', ['regional', 'coherent'])
def test_a_matrix_gives_the_candidates_of_the_recogniser(street, quick, fixed_length, matching):
    config = with_known(
        quick, {'fixed_length': fixed_length, 'matching': matching, 'search': 'exhaustive'}
    )
    material = street.open()
    query, reference = material.drives(config.encoding)
    said = recognize(material, config)
    rows, _ = pair_scores(material, config)
    lengths = choose_lengths(query, config.sequence, BACKWARD, Cache(None))
    partial = matching == 'coherent'
    scores = score_sequences(rows, query, lengths, partial_windows=partial)
    ours = decide_frames(scores, query, reference.reference_map.places, lengths, config)
    assert [one.sequence_length for one in ours] == [one.sequence_length for one in said.matches]
    for one, other in zip(ours, said.matches, strict=True):
        assert [(item.reference_index, item.score) for item in one.candidates] == [
            (item.reference_index, item.score) for item in other.candidates
        ]


def without_pixels(match):
    """Return a match without what only the image itself tells."""
    return replace(match, shift_px=None)


def without_stamps(match):
    candidates = tuple(replace(item, reference_stamp_ns=0) for item in match.candidates)
    return replace(without_pixels(match), candidates=candidates)


@pytest.mark.parametrize('fixed_length', [0, 3])
@pytest.mark.parametrize('matching', ['regional', 'coherent'])
@pytest.mark.parametrize('search', ['exhaustive', 'shortlist'])
def test_the_recogniser_says_the_same_again_of_images_that_are_described(
    street, quick, fixed_length, matching, search
):
    config = with_known(
        quick,
        {
            'fixed_length': fixed_length,
            'matching': matching,
            'search': search,
            'shortlist_length': 6,
            'image_size_px': 192,
        },
    )
    material = street.open()
    first = [without_pixels(one) for one in recognize(material, config).matches]
    assert answer_again(material, config, 0, 24) == first


def test_a_part_of_the_map_answers_like_a_map_of_that_part(street, quick):
    material = street.open()
    for index in (*range(4), *range(20, 24)):
        (street.folder / 'reference' / f'{index:03d}.png').unlink()
    street.write(
        'query: {path: query}\nreference: {path: reference}\ntruth: {kind: table, path: gt.csv}'
    )
    street.write('query,reference\n4,0\n', 'gt.csv')
    part = [without_stamps(one) for one in recognize(street.open(), quick).matches]
    again = [without_stamps(one) for one in answer_again(material, quick, 4, 20)]
    assert again == part


def test_a_forward_window_answers_for_its_first_frame(street, quick):
    material = street.open()
    query, reference = material.drives(quick.encoding)
    config = with_known(quick, {'fixed_length': 3})
    lengths = choose_lengths(query, config.sequence, FORWARD, Cache(None))
    assert lengths == [3] * 22 + [0, 0]
    rows = np.eye(24, dtype=np.float32)
    scores = score_sequences(rows, query, lengths, FORWARD)
    found = decide_frames(scores, query, reference.reference_map.places, lengths, config)
    assert [one.best.reference_index for one in found[:22]] == list(range(22))
    assert found[22].reason is Reason.WARMING_UP


def test_chosen_lengths_are_kept(street, quick, tmp_path):
    cache = Cache(tmp_path / 'cache')
    query, _ = street.open(cache).drives(quick.encoding)
    first = choose_lengths(query, quick.sequence, BACKWARD, cache)
    assert list((tmp_path / 'cache' / 'lengths').iterdir())
    assert choose_lengths(query, quick.sequence, BACKWARD, cache) == first
    assert first != choose_lengths(query, quick.sequence, FORWARD, cache)


def test_rows_without_any_score_are_passed_over(street, quick):
    query, _ = street.open().drives(quick.encoding)
    rows = np.eye(24, dtype=np.float32)
    rows[5] = np.nan
    scores = score_sequences(rows, query, [3] * 24)
    assert not np.isfinite(scores[5]).any()
    assert scores[6].argmax() == 6
