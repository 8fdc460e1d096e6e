# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The paper's pair scores, best sequences, and the margin between them, worked by hand."""

from dataclasses import replace

from convseq_ros.config import AcceptanceConfig, Config, SequenceConfig
from convseq_ros.core.decision.decider import Query
from convseq_ros.core.decision.paper.decider import decide_by_margin, PaperDecider
from convseq_ros.core.decision.paper.pair_score import pair_scores, paper_regions
from convseq_ros.core.retrieval.coarse_scores import AllPlaces
from convseq_ros.core.types import Candidate, Descriptor, Frame, Reason
import numpy as np
import pytest

RULE = AcceptanceConfig(min_margin=0.01, rival_distance=2, num_candidates=3)


class Given:
    """Stands in for a buffer: what sequences score, by where they end."""

    def __init__(self, scores):
        self.scores, self.asked = np.array(scores, float), []
        self.newest, self.descriptors = type('Newest', (), {'descriptor': None}), [None] * 16

    def score(self, count, ends):
        self.asked.append((count, ends.tolist()))
        return count * len(ends)

    def best_scores(self, _length, ends):
        return self.scores[ends]


def decided(a_map, scores, config=RULE, length=3, lengths=None):
    buffer = Given(scores)
    whole = a_map(*(lengths or [len(scores)]))
    sequence = replace(SequenceConfig(), fixed_length=length)
    config = replace(Config(), acceptance=config, sequence=sequence)
    query = Query(Frame(0, None), None, buffer, len(scores), 0, config)
    return PaperDecider(whole, AllPlaces(), Config()).decide(query), buffer


def test_candidates_come_best_first_without_neighbours(a_map):
    said, buffer = decided(a_map, [0.1, 0.8, 0.9, 0.85, 0.2, 0.3, 0.7])
    assert [each.reference_index for each in said.candidates] == [2, 6]
    assert said.candidates[0] == Candidate(2, 2 * 10**9, 0.9)
    assert said.length == 3 and said.confidence is None and said.pairs_scored == 21
    assert buffer.asked == [(3, [*range(7)])]


def test_candidates_are_limited_in_number_and_always_include_a_rival(a_map):
    scores = np.linspace(0, 1, 50)
    assert len(decided(a_map, scores)[0].candidates) == 3
    one = replace(RULE, num_candidates=1)
    assert len(decided(a_map, scores, one)[0].candidates) == 2


def test_neighbours_of_another_session_are_rivals_and_name_their_session(a_map):
    scores = np.full(30, 0.1)
    scores[[9, 10, 12]] = 0.9, 0.8, 0.7
    said, _ = decided(a_map, scores, lengths=[10, 20])
    assert [(one.reference_index, one.session) for one in said.candidates[:2]] == [(9, 0), (10, 1)]
    assert decided(a_map, scores)[0].candidates[1].reference_index == 12


@pytest.mark.parametrize(
    ('scores', 'reason'),
    [
        ([0.9, 0, 0, 0.88], Reason.ACCEPTED),
        ([0.9, 0, 0, 0.895], Reason.AMBIGUOUS),
        ([0.9, 0.899, 0.1, 0.2], Reason.ACCEPTED),
        ([0.9, 0.8, 0.1], Reason.TOO_FEW_RIVALS),
    ],
)
def test_the_margin_to_the_best_rival_decides(a_map, scores, reason):
    said, _ = decided(a_map, scores)
    assert said.reason is reason is decide_by_margin(said.candidates, RULE)
    always, _ = decided(a_map, scores, replace(RULE, acceptance_rule='always'))
    assert (always.reason, always.candidates) == (Reason.ACCEPTED, said.candidates)


@pytest.mark.parametrize(
    ('length', 'lengths', 'reason'),
    [
        (16, [10, 15, 5], Reason.MAP_TOO_SHORT),
        (15, [10, 15, 5], Reason.WARMING_UP),
        (16, [30], Reason.WARMING_UP),
    ],
)
def test_without_a_sequence_map_or_drive_are_too_short(a_map, length, lengths, reason):
    said, _ = decided(a_map, [-np.inf] * 30, length=length, lengths=lengths)
    assert (said.reason, said.candidates, said.length) == (reason, (), length)


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
