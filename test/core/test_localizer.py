# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Lost, candidate, localised: worked by hand on made-up matches."""

from convseq_ros.config import Config
from convseq_ros.core.decision.neighbourhood import Neighbourhood
from convseq_ros.core.localizer import Localizer
from convseq_ros.core.map.place import Place
from convseq_ros.core.sighting import SIGHTING
from convseq_ros.core.types import Candidate, LocalizationState, Match, Pose, Reason, Status
from hypothesis import given
from hypothesis import strategies as st
import pytest

LOST, CANDIDATE, LOCALISED = LocalizationState
AHEAD = (0.0, 0.0, 0.0, 1.0)
STREET = [Place(index, pose=Pose((float(index), 0.0, 0.0), AHEAD)) for index in range(300)]
WITHOUT_POSES = [Place(index) for index in range(300)]


class Few:
    """Stands in for an acceptance: what the newest frames show alone, and what looks alike."""

    def __init__(self):
        self.places, self.entered, self.strengths = Neighbourhood(), None, {}
        self.settled = True

    def is_settled(self, _):
        return self.settled


class Robot:
    """Tells a localiser what is recognised, and how far odometry says that it went."""

    def __init__(self, places=STREET, known=300):
        self.few = Few()
        self.localizer = Localizer(places, Config(), self.few)
        self.known, self.frame = known, 0

    def sees(self, best=None, reason=Reason.ACCEPTED, at_m=None, others=(), confidence=0.9):
        indices = () if best is None else (best, *others)
        candidates = tuple(Candidate(index, index, 0.5) for index in indices)
        status = Status.ACCEPTED if reason is Reason.ACCEPTED else Status.REJECTED
        self.frame += 1
        match = Match(self.frame, self.frame, status, reason, candidates, 3, 9, confidence)
        odometry = None if at_m is None else Pose((at_m, 0.0, 0.0), AHEAD)
        return self.localizer.update(match, odometry, self.known, Config()).localization


@pytest.fixture(params=[STREET, WITHOUT_POSES], ids=['poses', 'no_poses'])
def found(request):
    """Return a robot that is localised at place 100, with odometry."""
    robot = Robot(request.param)
    assert robot.sees(99, at_m=0.0).state is CANDIDATE
    assert robot.sees(100, at_m=1.0).state is LOCALISED
    return robot


def test_it_begins_lost_and_says_why():
    robot = Robot()
    assert robot.localizer.localization.state is LOST
    assert 'too few frames' in robot.localizer.localization.problem
    assert 'more make a sequence' in robot.sees(reason=Reason.WARMING_UP).problem
    told = robot.sees(7, Reason.AMBIGUOUS, others=(90,))
    assert told.problem == 'ambiguous between place 7 and place 90' and told.quality == 0.0
    assert robot.sees(7, Reason.WEAK).problem == (
        'nothing recognised in 3 keyframes (1 warming_up, 1 ambiguous, 1 weak)'
    )
    assert 'there is no map' in robot.sees(reason=Reason.NO_MAP).problem


def test_one_match_is_a_candidate_and_two_that_agree_are_enough():
    robot = Robot()
    first = robot.sees(40, confidence=0.7)
    assert (first.state, first.reference_index, first.quality) == (CANDIDATE, 40, 0.7)
    assert first.problem == 'too few frames: 1 of 2 matches agree on place 40'
    second = robot.sees(41)
    assert (second.state, second.reference_index) == (LOCALISED, 41)
    assert second.quality == pytest.approx(1 - 0.3 * 0.1)
    assert second.problem == ''


NEARLY = SIGHTING.likely * Config().acceptance.min_evidence + 0.001


def test_two_frames_that_are_nearly_sure_and_agree_are_enough():
    robot = Robot()
    robot.few.entered = 40, NEARLY - 0.002
    assert robot.sees(reason=Reason.WARMING_UP, at_m=0.0).state is LOST
    robot.few.entered = 40, NEARLY
    first = robot.sees(reason=Reason.WARMING_UP, at_m=0.0)
    assert (first.state, first.reference_index) == (CANDIDATE, 40)
    robot.few.entered = 41, NEARLY
    second = robot.sees(120, Reason.WEAK, at_m=1.0)
    assert (second.state, second.reference_index) == (LOCALISED, 41)
    assert second.quality == pytest.approx(1 - (1 - first.quality) ** 2)


@pytest.mark.parametrize('settles', [True, False])
def test_where_a_place_beside_is_verified_better_one_more_match_is_needed(settles):
    robot = Robot()
    robot.sees(40)
    robot.few.settled = False
    told = robot.sees(42)
    assert told.state is CANDIDATE and told.problem == (
        'too few frames: 2 of 2 matches agree on place 42, but places beside it look as likely'
    )
    robot.few.settled = settles
    told = robot.sees(41)
    assert (told.state, told.reference_index) == (LOCALISED, 41)


def test_whoever_was_lost_needs_a_sure_match():
    robot = Robot()
    for place in (10, 11):
        robot.sees(place, at_m=float(place))
    assert robot.sees(12, at_m=12.0).state is LOCALISED
    for place in (60, 61):
        robot.few.entered = place, NEARLY
        found = robot.sees(120, Reason.WEAK, at_m=12.0)
    assert found.state is not LOCALISED
    robot.few.entered = 62, NEARLY
    assert robot.sees(120, Reason.WEAK, at_m=13.0).state is CANDIDATE
    robot.few.entered = None
    assert robot.sees(63, at_m=14.0).state is LOCALISED


@pytest.mark.parametrize('reason', [Reason.IMPLAUSIBLE, Reason.UNVERIFIED, Reason.STATIONARY])
def test_what_is_denied_or_no_keyframe_is_never_nearly_sure(reason):
    robot = Robot()
    robot.few.entered = 40, 9.0
    assert [robot.sees(40, reason).state for _ in range(3)] == [LOST] * 3


def test_nearly_sure_frames_must_agree_and_be_of_an_earlier_session():
    robot = Robot(known=100)
    for place in (40, 90, 150, 151):
        robot.few.entered = place, NEARLY
        assert robot.sees(reason=Reason.WARMING_UP, at_m=float(robot.frame)).state is CANDIDATE


def test_two_matches_of_different_places_are_not_enough():
    robot = Robot()
    robot.sees(40)
    assert robot.sees(200).state is CANDIDATE
    assert robot.sees(40).state is CANDIDATE
    assert robot.sees(41).state is LOCALISED


def test_odometry_tells_a_way_along_the_map_from_a_leap():
    robot = Robot()
    robot.sees(40, at_m=0.0)
    # As many places as a quick drive moves on, but odometry says that the robot went one metre.
    assert robot.sees(50, at_m=1.0).state is CANDIDATE
    robot = Robot()
    robot.sees(40, at_m=0.0)
    assert robot.sees(80, at_m=38.0).state is LOCALISED


def test_a_candidate_that_nothing_repeats_is_forgotten():
    robot = Robot()
    robot.sees(40)
    states = [robot.sees(40, Reason.WEAK).state for _ in range(5)]
    assert states == [CANDIDATE] * 3 + [LOST] * 2


def test_a_match_of_long_ago_agrees_with_nothing():
    robot = Robot(WITHOUT_POSES)
    robot.sees(40)
    for _ in range(SIGHTING.silent_keyframes):
        robot.sees(40, Reason.WEAK)
    assert robot.sees(41).state is CANDIDATE
    assert robot.sees(42).state is LOCALISED


def test_it_stays_localised_while_nothing_speaks_against_it(found):
    for metres in range(2, 2 + SIGHTING.silent_keyframes - 1):
        told = found.sees(99 + metres, Reason.WEAK, at_m=float(metres))
        assert (told.state, told.reference_index) == (LOCALISED, 100)
        assert told.quality == pytest.approx(0.99)
    assert found.sees(130, Reason.WEAK, at_m=31.0).state is LOST


def test_frames_that_say_nothing_change_nothing(found):
    for reason in (Reason.BETWEEN_KEYFRAMES, Reason.STATIONARY, Reason.UNREADABLE):
        for _ in range(40):
            assert found.sees(reason=reason).state is LOCALISED


def test_kidnapped_it_is_lost_in_four_keyframes_and_found_again(found):
    told = [found.sees(250 + step, Reason.INCONSISTENT, at_m=2.0 + step) for step in range(4)]
    assert [each.state for each in told] == [LOCALISED] * 3 + [LOST]
    assert [each.quality for each in told] == pytest.approx([0.7425, 0.495, 0.2475, 0.0])
    assert found.sees(254, at_m=6.0).state is CANDIDATE
    assert found.sees(255, at_m=7.0).state is LOCALISED


def test_sure_of_another_place_it_is_lost_sooner(found):
    assert found.sees(250, at_m=2.0).state is LOCALISED
    assert found.sees(251, at_m=3.0).state is LOST
    told = found.sees(252, at_m=4.0)
    assert (told.state, told.reference_index) == (LOCALISED, 252)


def test_one_slip_does_not_make_it_lost(found):
    for _ in range(5):
        assert found.sees(250, Reason.WEAK, at_m=2.0).state is LOCALISED
        assert found.sees(101, at_m=2.0).state is LOCALISED


@pytest.mark.parametrize(
    ('reason', 'strength', 'state'),
    [
        (Reason.ACCEPTED, 90.0, LOST),
        (Reason.AMBIGUOUS, 90.0, LOST),
        (Reason.ACCEPTED, 150.0, LOCALISED),  # as usual, though the corridor repeats
        (Reason.AMBIGUOUS, 150.0, LOST),
    ],
)
def test_a_place_like_another_speaks_against_what_sequences_still_see(reason, strength, state):
    robot = Robot()
    for step in range(8):
        robot.few.strengths = {98 + step: 200.0, 250: 100.0}
        robot.sees(98 + step, at_m=float(step))
    robot.few.strengths = {106: strength, 250: strength}
    states = [robot.sees(106, reason, at_m=8.0).state for _ in range(4)]
    assert states == [LOCALISED] * 3 + [state]


def test_a_frame_that_says_nothing_makes_what_spoke_against_the_place_no_less(found):
    for step, (rival, state) in enumerate(
        [(40.0, LOCALISED), (40.0, LOCALISED), (39.0, LOCALISED), (90.0, LOCALISED), (40.0, LOST)]
    ):
        found.few.strengths = {100: 50.0, 250: rival}
        assert found.sees(102 + step, Reason.WEAK, at_m=2.0 + step).state is state


def test_a_place_of_this_very_drive_does_not_speak_against_the_map():
    robot = Robot(known=200)
    for place in range(100, 110):
        robot.few.strengths = {place: 50.0, 250: 90.0}
        told = robot.sees(place, at_m=float(place))
    assert told.state is LOCALISED and told.quality == pytest.approx(0.99)


def test_a_place_that_looks_like_itself_at_another_visit_is_no_other():
    robot = Robot([*STREET[:150], *STREET[:150]])
    for place in range(20, 30):
        robot.few.strengths = {place: 50.0, place + 150: 60.0}
        told = robot.sees(place, at_m=float(place))
    assert told.state is LOCALISED


def test_once_lost_the_old_place_needs_as_many_matches_as_a_new_one(found):
    found.few.strengths = {100: 200.0}
    found.sees(101)
    found.few.strengths = {250: 40.0}
    for place in range(101, 105):
        told = found.sees(place)
    assert told.state is LOST
    assert found.sees(105).state is CANDIDATE
    assert found.sees(250).state is CANDIDATE
    assert found.sees(251).reference_index == 251


def test_once_lost_what_odometry_said_before_denies_nothing(found):
    assert found.sees(250, Reason.IMPLAUSIBLE, at_m=2.0).state is LOCALISED
    for step in range(3, 6):
        told = found.sees(250, Reason.INCONSISTENT, at_m=float(step))
    assert told.state is LOST
    assert found.sees(252, Reason.IMPLAUSIBLE, at_m=6.0).state is CANDIDATE
    told = found.sees(253, Reason.IMPLAUSIBLE, at_m=7.0)
    assert (told.state, told.reference_index) == (LOCALISED, 253)


def test_the_same_place_under_another_number_is_no_contradiction():
    twice = [*STREET[:150], *STREET[:150]]
    robot = Robot(twice)
    robot.sees(20, at_m=0.0)
    assert robot.sees(171, at_m=1.0).state is LOCALISED
    for step in range(2, 8):
        assert robot.sees(20 + step, at_m=float(step)).quality == pytest.approx(0.99)


def test_a_growing_map_localises_in_earlier_sessions_only():
    robot = Robot(known=100)
    robot.sees(150)
    assert robot.sees(151).state is LOST
    robot.sees(50)
    assert robot.sees(51).state is LOCALISED


def test_quality_is_unknown_where_confidence_is():
    robot = Robot()
    robot.sees(40, confidence=None)
    assert robot.sees(41, confidence=None).quality is None


def test_reset_forgets_the_drive(found):
    found.localizer.reset()
    assert found.localizer.localization.state is LOST
    assert found.sees(100, at_m=3.0).state is CANDIDATE


@given(
    st.lists(
        st.tuples(
            st.sampled_from([*Reason]),
            st.integers(0, 299),
            st.one_of(st.none(), st.floats(-1e6, 1e6)),
        ),
        max_size=60,
    )
)
def test_whatever_is_seen_the_record_makes_sense(frames):
    robot, before = Robot(), LOST
    for reason, best, at_m in frames:
        told = robot.sees(best, reason, at_m)
        assert 0.0 <= told.quality <= 1.0
        assert (told.reference_index is None) == (told.state is LOST)
        assert (told.problem == '') == (told.state is LOCALISED)
        # Never from one place to another without being lost in between.
        assert not (before is LOCALISED and told.state is CANDIDATE)
        # What odometry alone denies is sure, too: it may be what the robot was carried away from.
        sure = Reason.ACCEPTED, Reason.COOL_DOWN, Reason.IMPLAUSIBLE
        assert not (before is LOST and told.state is LOCALISED and reason not in sure)
        before = told.state
