# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Lost, candidate, localised: read from the belief, on made-up matches."""

from convseq_ros.config import AcceptanceConfig, Config
from convseq_ros.core.decision.localizer import Localizer
from convseq_ros.core.map.reference_map import ReferenceMap
from convseq_ros.core.types import Candidate, LocalizationState, Match, Reason
from hypothesis import given
from hypothesis import strategies as st
import pytest

LOST, CANDIDATE, LOCALISED = LocalizationState
SILENT = (
    Reason.BETWEEN_KEYFRAMES, Reason.STATIONARY, Reason.UNINFORMATIVE, Reason.UNREADABLE,
    Reason.OUT_OF_ORDER,
)  # fmt: skip


class Robot:
    """Tells a localiser what is believed."""

    def __init__(self, known=300, links=(), min_confidence=0.9):
        reference_map = ReferenceMap()
        for place, other in links:
            reference_map.links.add(place, other)
        self.localizer, self.known, self.frame = Localizer(reference_map), known, 0
        self.config = Config(acceptance=AcceptanceConfig(min_confidence=min_confidence))

    def sees(self, best=None, confidence=0.95, reason=None, others=()):
        if reason is None:
            is_sure = (confidence or 0) >= self.config.acceptance.min_confidence
            reason = Reason.ACCEPTED if is_sure else Reason.WEAK
        found = tuple(Candidate(one, one, 0.5) for one in (best, *others) if one is not None)
        self.frame += 1
        match = Match(self.frame, self.frame, reason, found, 3, 9, confidence)
        told = self.localizer.update(match, self.known)
        assert told.localization == self.localizer.localization
        return told.localization


def test_the_localizer_starts_lost_and_gives_the_reason():
    robot = Robot()
    assert robot.localizer.localization.state is LOST
    assert 'no keyframe yet' in robot.localizer.localization.problem
    assert 'more make a sequence' in robot.sees(None, None, Reason.WARMING_UP).problem
    told = robot.sees(7, 0.05, Reason.AMBIGUOUS, others=(90,))
    assert told.state is LOST and told.problem == 'ambiguous between place 7 and place 90'
    assert robot.sees(7, 0.05).problem == (
        'nothing recognised in 3 keyframes (1 warming_up, 1 ambiguous, 1 weak)'
    )
    assert 'there is no map' in robot.sees(None, None, Reason.NO_MAP).problem


@pytest.mark.parametrize(
    ('confidence', 'state'),
    [(0.0, LOST), (0.09, LOST), (0.1, CANDIDATE), (0.89, CANDIDATE), (0.9, LOCALISED)],
)
def test_the_confidence_of_a_match_decides_the_state_of_a_lost_robot(confidence, state):
    told = Robot().sees(40, confidence)
    assert told.state is state
    assert told.reference_index == (None if state is LOST else 40)
    assert (told.problem == '') == (state is LOCALISED)
    assert told.quality == (0.0 if state is LOST else confidence)


@pytest.mark.parametrize(
    'reason', [one for one in Reason if one not in (*SILENT, Reason.ACCEPTED, Reason.COOL_DOWN)]
)
def test_a_refused_frame_never_localises_a_lost_robot_and_keeps_a_localised_one(reason):
    robot = Robot()
    assert robot.sees(40, 0.97, reason).state is CANDIDATE
    assert robot.sees(40, 0.97).state is LOCALISED
    assert robot.sees(41, 0.97, reason).state is LOCALISED


@pytest.mark.parametrize('reason', SILENT)
def test_frames_without_evidence_do_not_change_the_state(reason):
    robot = Robot()
    robot.sees(40)
    assert {robot.sees(None, None, reason).state for _ in range(40)} == {LOCALISED}


def test_a_growing_map_localises_in_earlier_sessions_only():
    robot = Robot(known=100, links=[(150, 40)])
    assert robot.sees(170).state is LOST
    told = robot.sees(150)  # of this drive, and another look of what an earlier one saw
    assert told.state is LOCALISED and 32 <= told.reference_index <= 48
    assert robot.sees(50).reference_index == 50


def test_by_the_margin_matches_count_and_quality_is_unknown():
    robot = Robot()
    told = robot.sees(40, None, Reason.ACCEPTED)
    assert (told.state, told.quality, told.reference_index) == (LOCALISED, None, 40)
    assert robot.sees(41, None, Reason.COOL_DOWN).state is LOCALISED
    assert robot.sees(90, None, Reason.AMBIGUOUS).state is LOST


@given(
    st.lists(
        st.tuples(
            st.sampled_from([*Reason]),
            st.one_of(st.none(), st.integers(0, 299)),
            st.one_of(st.none(), st.floats(0, 1)),
        ),
        max_size=60,
    )
)
def test_the_localization_record_is_consistent_for_any_input(frames):
    robot, before = Robot(known=200), LOST
    for reason, best, confidence in frames:
        told = robot.sees(best, confidence, reason)
        assert told.quality is None or 0.0 <= told.quality <= 1.0
        assert (told.reference_index is None) == (told.state is LOST)
        assert (told.problem == '') == (told.state is LOCALISED)
        assert told.reference_index is None or told.reference_index < 200
        if before is not LOCALISED and told.state is LOCALISED:
            assert reason in (Reason.ACCEPTED, Reason.COOL_DOWN)
        before = told.state
