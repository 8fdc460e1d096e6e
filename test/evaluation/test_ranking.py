# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Score matrices: the ranking, and the recogniser on given scores, say what it says itself."""

from dataclasses import replace
from functools import partial

from convseq_ros.baselines.loop_detector import Detection
from convseq_ros.config.reading_config import ReadingConfig
from convseq_ros.core.types import Reason
from convseq_ros.evaluation.given_scores import PairScores, rank_references, recognize_given
from convseq_ros.evaluation.methods import Kind, make_method, Method, MethodName, parse_method
from convseq_ros.evaluation.peers import peer_scores
from convseq_ros.evaluation.protocols import OPEN, run_protocol
from convseq_ros.evaluation.query_answers import overridden, recognize
import numpy as np
import pytest


@pytest.mark.parametrize('fixed_length', [0, 1, 5])
@pytest.mark.parametrize('matching', ['regional', 'coherent'])
def test_a_matrix_gives_the_candidates_of_the_recogniser(street, quick, fixed_length, matching):
    asked = {'fixed_length': fixed_length, 'matching': matching, 'search': 'exhaustive'}
    # Given scores have no geometry, so the margin decides.
    config = overridden(quick, asked | {'acceptance_rule': 'margin'})
    material = street.open()
    query, reference = material.drives(config.encoding)
    said = recognize(material, config)
    given, scores = recognize_given(said.rows, query, reference.reference_map, config)
    lengths = [match.sequence_length for match in said.matches]
    assert [match.sequence_length for match in given] == lengths
    assert sum(length > 0 for length in lengths) > 15
    for match, other, ranked in zip(said.matches, given, scores, strict=True):
        expected = [(item.reference_index, item.score) for item in match.candidates]
        assert [(item.reference_index, item.score) for item in other.candidates] == expected
        assert (other.status, other.reason) == (match.status, match.reason)
        if match.candidates:
            assert (int(ranked.argmax()), float(ranked.max())) == expected[0]
        assert all(ranked[index] == score for index, score in expected)


def without_pixels(match):
    """Return a match without what only the image itself tells."""
    return replace(match, shift_px=None)


def without_stamps(match):
    candidates = tuple(replace(item, reference_stamp_ns=0) for item in match.candidates)
    return replace(without_pixels(match), candidates=candidates, anchor=None)


def test_a_part_of_the_map_answers_like_a_map_of_that_part(street, quick):
    material = street.open()
    for index in (*range(4), *range(20, 24)):
        (street.folder / 'reference' / f'{index:03d}.png').unlink()
    street.write(
        'query: {path: query}\nreference: {path: reference}\ntruth: {kind: table, path: gt.csv}'
    )
    street.write('query,reference\n4,0\n', 'gt.csv')
    part = [without_stamps(one) for one in recognize(street.open(), quick).matches]
    again = [without_stamps(one) for one in recognize(material, quick, (4, 20)).matches]
    for one, other in zip(again, part, strict=True):
        places = [item.reference_index - 4 for item in one.candidates]
        assert places == [item.reference_index for item in other.candidates]
        moved = replace(one, candidates=other.candidates)
        assert moved == other


def test_rows_without_any_score_are_passed_over(street, quick):
    query, reference = street.open().drives(quick.encoding)
    rows = np.eye(24, dtype=np.float32)
    rows[5] = np.nan
    scores = rank_references(rows, query, [3] * 24)
    assert not np.isfinite(scores[5]).any()
    assert scores[6].argmax() == 6
    config = overridden(quick, {'fixed_length': 3})
    found, _ = recognize_given(rows, query, reference.reference_map, config)
    assert found[5].reason is Reason.UNINFORMATIVE and not found[5].candidates
    assert found[6].best.reference_index == 6


def test_a_method_may_decide_itself_in_every_part_of_the_map(street, quick):
    def detect(rows, first):
        assert rows.shape == (24, 12) and first in (0, 6, 12)
        return [Detection(int(row.argmax()), 30) if row.any() else Detection() for row in rows]

    pairs = PairScores(np.eye(24, dtype=np.float32), 2.0, 1.0, detect=detect, place_bytes=8)
    method = Method(MethodName('own', 'own'), Kind(lambda *_: pairs), quick)
    outcome = run_protocol(street.open(), method, OPEN)
    found = [one.accepted.reference_index if one.accepted else None for one in outcome.matches]
    expected = []
    for first in (0, 12, 6):
        expected += [index if first <= index < first + 12 else None for index in range(24)]
    assert found == expected
    assert outcome.frame_ms == 3.0


def test_keypoints_count_in_size_and_time_if_the_method_asks_them(street, quick):
    material = street.open()
    query, reference = material.drives(quick.encoding)
    counts = [len(one.keypoints) for one in reference.descriptors]
    assert query.keypoints_ms > 0 and np.mean(counts) > 50
    coherent = overridden(quick, {'matching': 'coherent'})
    by_belief, by_margin = (
        make_method(parse_method('convseq'), overridden(coherent, rule)).rows(material)
        for rule in ({'acceptance_rule': 'belief'}, {'acceptance_rule': 'margin'})
    )
    assert by_belief.place_bytes - by_margin.place_bytes == pytest.approx(34 * np.mean(counts))
    assert by_margin.encode_ms == query.encode_ms
    assert by_belief.encode_ms == query.encode_ms + query.keypoints_ms


def test_the_direct_index_at_the_root_is_none_and_at_the_words_finds_fewer(street):
    folders = f'{street.folder / "query"},{street.folder / "reference"}'
    scores = partial(peer_scores, street.open(), 'orb-bow', 0.3, folders, ReadingConfig(), 160)

    def inliers(direct):
        pairs = scores(levels=3, direct=direct)
        return [one.inliers for one in pairs.detect(pairs.scores, consistent=1)]

    everywhere, at_root, at_words = inliers(None), inliers(3), inliers(0)
    assert sum(everywhere) > 0 and at_root == everywhere
    assert 0 < sum(at_words) < sum(everywhere)
