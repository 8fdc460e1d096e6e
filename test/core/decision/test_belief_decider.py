# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A map, a drive, and what the belief accepts, on drawn images; and what bad input makes of it."""

import functools
from types import SimpleNamespace

from convseq_ros import build_map, Frame, PlaceRecognizer
from convseq_ros.config import EncodingConfig, EVERY_FRAME, make_config, with_values
from convseq_ros.core.compiled import available
from convseq_ros.core.encoding.descriptor import describe
from convseq_ros.core.map.place import pack_cells, Place
from convseq_ros.core.map.reference_map import ReferenceMap
from convseq_ros.core.pose.estimate import places_near
from convseq_ros.core.types import LocalizationState, PoseEstimate, Reason, Status
import numpy as np
from poses import at
import pytest
from world import map_of

pytestmark = pytest.mark.once

SMALL = EncodingConfig(image_size_px=256)
PLACES = 60
STEP_NS = 10**8
OWN = make_config({'image_size_px': 256, 'fixed_length': 4})
ONLINE = with_values(OWN, {'mode': 'online'})
RESTLESS = with_values(OWN, {'stationary_glance': 0.0, 'stationary_m': 0.0})
TWO = with_values(RESTLESS, {'fixed_length': 2})
SEARCHES = [with_values(OWN, {'search': one}) for one in ('shortlist', 'exhaustive')]
both_searches = pytest.mark.parametrize('config', SEARCHES, ids=['shortlist', 'exhaustive'])


@pytest.fixture(scope='module')
def described(image):
    return functools.cache(lambda place, seed=0: describe(image(place, seed), SMALL))


@pytest.fixture(scope='module')
def showing(described):
    return lambda places, poses=(): map_of(map(described, places), SMALL, poses=poses)


@pytest.fixture(scope='module')
def street(showing):
    return showing(range(PLACES))


@pytest.fixture(scope='module')
def posed(showing):
    """Return the map of the street with the poses of its places, a metre apart."""
    return showing(range(PLACES), [*map(at, range(PLACES))])


@pytest.fixture(scope='module')
def drive(described):
    """Return a way to show places, one a step."""

    def show(recognizer, places, *, start=0, seed=1, poses=None):
        found = []
        for index, place in enumerate(places):
            pose = poses[index] if poses else None
            frame = Frame((start + index) * STEP_NS, None, pose=pose)
            found.append(recognizer.process(frame, described(place, seed)))
        return found

    return show


@pytest.fixture(scope='module')
def frames(image):
    """Return a maker of frames with images of places, one a step."""

    def make(places, seed):
        return [Frame(at * STEP_NS, image(place, seed)) for at, place in enumerate(places)]

    return make


@pytest.fixture(scope='module')
def pictured(frames):
    """Return the map of the street with keypoints."""
    return build_map(frames(range(PLACES), 0), None, OWN)


def accepted(matches):
    return [match.accepted and match.accepted.reference_index for match in matches]


@both_searches
def test_a_known_stretch_is_accepted_and_an_unknown_one_is_not(street, drive, config):
    shown_places = [*range(1000, 1015), *range(15, 40), *range(2000, 2020)]
    matches = drive(PlaceRecognizer(street, config), shown_places)
    assert accepted(matches[:15]) == [None] * 15
    assert accepted(matches[17:40]) == [*range(17, 40)]
    assert accepted(matches[45:]) == [None] * 15
    unknown = {match.reason for match in matches[:15] + matches[45:]}
    assert unknown <= {Reason.WEAK, Reason.AMBIGUOUS}


@both_searches
def test_an_accepted_match_has_confidence_score_inliers_and_localization(street, drive, config):
    for match in drive(PlaceRecognizer(street, config), range(10, 30))[2:]:
        assert match.status is Status.ACCEPTED and 0.9 <= match.confidence <= 1
        assert 0 < match.best.score <= 1 and match.best.inliers > 50
        assert match.sequence_length == min(4, match.query_index + 1)
        indices = [one.reference_index for one in match.candidates]
        assert len(indices) <= 5 and np.diff(sorted(indices)).min(initial=99) > 10
        assert match.localization.state is LocalizationState.LOCALISED
        assert match.localization.quality == match.confidence


def test_an_answer_has_five_candidates_that_are_not_near_each_other(street, drive):
    close = with_values(OWN, {'rival_distance': 1})
    for match in drive(PlaceRecognizer(street, close), range(1000, 1003)):
        indices = [one.reference_index for one in match.candidates]
        assert len(indices) == 5 and np.diff(sorted(indices)).min() > 1


def test_after_the_first_match_frames_are_compared_with_fewer_places(street, drive):
    matches = drive(PlaceRecognizer(street, OWN), range(10, 20))
    first = next(index for index, match in enumerate(matches) if match.accepted)
    scored = [match.pairs_scored for match in matches]
    assert min(scored[: first + 1]) > max(scored[first + 1 :]) > 0, scored


@both_searches
@pytest.mark.parametrize(('here', 'there'), [(10, 40), (40, 5), (20, 33)])
def test_matches_are_right_four_keyframes_after_a_jump(street, drive, config, here, there):
    shown_places = [*range(here, here + 12), *range(there, there + 12)]
    matches = drive(PlaceRecognizer(street, config), shown_places)
    assert accepted(matches[2:12]) == [*range(here + 2, here + 12)]
    assert accepted(matches[15:]) == [*range(there + 3, there + 12)]


def test_a_frame_that_cells_and_keypoints_deny_is_rejected_at_high_confidence(frames, pictured):
    unknown = []
    for here in range(5, 50, 5):
        recognizer = PlaceRecognizer(pictured, OWN)
        away = [*range(here, here + 9), 500]  # the last is in no map
        matches = [recognizer.process(frame) for frame in frames(away, 1)]
        assert accepted(matches[4:9]) == [*range(here + 4, here + 9)]
        unknown.append(matches[9])
    assert not any(accepted(unknown))
    sure = [match for match in unknown if match.confidence >= OWN.acceptance.min_confidence]
    assert sure and {match.reason for match in sure} == {Reason.WEAK}
    assert {match.localization.state for match in sure} == {LocalizationState.LOCALISED}


def test_a_person_before_the_camera_is_no_place_and_ends_no_drive(frames, pictured):
    before, after = range(10, 16), range(46, 52)
    shown = frames([*before, *range(1000, 1030), *after], 1)
    recognizer = PlaceRecognizer(pictured, OWN)
    found = accepted([recognizer.process(frame) for frame in shown])
    assert found[3:6] == [*before[3:]] and not any(found[6:36])
    assert found[38:] == [*after[2:]] and {*found[36:38]} <= {None, *after[:2]}


def test_a_place_that_the_map_holds_twice_is_accepted_once_its_looks_are_linked(showing, drive):
    twice = showing([*range(30), *range(30)])
    matches = drive(PlaceRecognizer(twice, OWN), range(5, 25))
    assert not any(match.accepted for match in matches)
    for place in range(30, 60):
        twice.links.add(place, place - 30)
    found = accepted(drive(PlaceRecognizer(twice, OWN), range(5, 25)))
    assert [one is not None and one % 30 for one in found[3:]] == [*range(8, 25)]


def test_the_look_most_similar_to_the_frame_is_the_match(described, showing, drive):
    whole = showing(range(30))
    for place in range(30):
        whole.add(Place(30 + place), pack_cells(described(place, 1).cells))
        whole.links.add(30 + place, place)
    recognizer = PlaceRecognizer(whole, OWN)
    assert accepted(drive(recognizer, range(5, 20), seed=0))[3:] == [*range(8, 20)]
    assert accepted(drive(recognizer, [20], start=15, seed=1)) == [50]


@pytest.mark.parametrize('levels', [1, 4], ids=['black', 'noise'])
def test_under_a_strobe_light_the_lit_frames_are_matches_and_no_dark_one_is(street, drive, levels):
    recognizer, lit, unlit = PlaceRecognizer(street, RESTLESS), [], []
    dark = np.random.default_rng(0).integers(0, levels, (120, 160), np.uint8)
    for step in range(0, 24, 2):
        lit += drive(recognizer, [10 + step], start=step)
        frame = Frame((step + 1) * STEP_NS, None)
        unlit.append(recognizer.process(frame, describe(dark, SMALL)))
    assert accepted(lit[2:]) == [*range(14, 34, 2)]
    assert not any(accepted(unlit))


@pytest.mark.parametrize(('missing', 'is_known'), [(5, True), (6, False)])
def test_more_than_five_missing_frames_restart_the_drive(street, drive, missing, is_known):
    recognizer = PlaceRecognizer(street, RESTLESS)
    drive(recognizer, range(10, 25))
    (match,) = drive(recognizer, [25 + missing], start=15 + missing)
    assert bool(match.accepted) is is_known


def test_a_repeated_frame_is_never_matched_to_another_place(street, drive):
    # Nobody asks whether it stands still.
    matches = drive(PlaceRecognizer(street, RESTLESS), [*range(20, 30), *[29] * 40])
    assert set(accepted(matches[10:])) <= {28, 29, 30, None}
    unknown = drive(PlaceRecognizer(street, RESTLESS), [777] * 40)
    assert not any(match.accepted for match in unknown)


@pytest.mark.parametrize('places', [1, 2, 3, 8])
@pytest.mark.parametrize('sessions', [False, True])
def test_a_map_of_a_few_places_has_too_few_rivals(described, drive, places, sessions):
    small = ReferenceMap(SMALL, keyframes=EVERY_FRAME)
    for place in range(places):
        if sessions:
            small.begin_session(place)
        small.add(Place(place, session=place * sessions), pack_cells(described(place).cells))
    shown_places = [*range(places)] * 6
    poses = [at(one) for one in shown_places]
    for shown in (None, poses):
        matches = drive(PlaceRecognizer(small, RESTLESS), shown_places, poses=shown)
        assert {match.reason for match in matches} <= {Reason.TOO_FEW_RIVALS, Reason.WEAK}
        assert all(0 <= match.confidence < 0.9 for match in matches)
        assert not any(np.isnan(one.score) for match in matches for one in match.candidates)


def test_a_map_of_looks_of_one_place_accepts_no_match(showing, drive):
    alike = showing(range(16))
    for place in range(1, 16):
        alike.links.add(place, 0)
    matches = drive(PlaceRecognizer(alike, OWN), range(16))
    assert not any(match.accepted for match in matches)
    assert all(0 <= match.confidence <= 1 for match in matches)


@pytest.mark.parametrize(
    'jumps',
    [
        {8: 1e6},
        {8: -300.0, 9: 300.0},
        {4: 0.0},
        dict.fromkeys(range(6, 25), 5.0),
        {index: index - 8.0 for index in range(8, 25)},
    ],
)
def test_odometry_that_jumps_resets_or_stops_disturbs_a_few_frames_only(posed, drive, jumps):
    shown_places = [*range(10, 35)]
    poses = [at(jumps.get(index, place)) for index, place in enumerate(shown_places)]
    matches, first = drive(PlaceRecognizer(posed, RESTLESS), shown_places, poses=poses), min(jumps)
    stands = len({*jumps.values()}) < len(jumps)
    for place, match in zip(shown_places, matches, strict=True):
        assert 0 <= match.confidence <= 1
        most = 3 if stands else 2  # places off
        is_right = match.accepted is None or abs(match.accepted.reference_index - place) <= most
        assert is_right or 0 <= match.query_index - first < 5
    # From the fourth frame after the last jump on. Odometry that stands holds the belief back, but
    # only among places that a single frame hardly tells apart.
    start = 3 + (first if len(jumps) > 2 else max(jumps) + 1)
    behind = np.array(shown_places[start:]) - accepted(matches[start:])
    assert set(behind) <= ({0, 1, 2, 3} if stands else {0})


@pytest.mark.parametrize('own', [False, True])
def test_without_keypoints_a_robot_that_left_a_place_does_not_return_to_it(street, described, own):
    recognizer = PlaceRecognizer(street, TWO)  # two frames are kept
    if own:
        recognizer.mapping.session_start = recognizer.mapping.drive_start = 0
    shown = [described(place, 1) for place in range(10, 21)] + [described(20, 0), described(20, 1)]
    stamped = [Frame(step * STEP_NS, None) for step in range(len(shown))]
    reasons = [match.reason for match in map(recognizer.process, stamped, shown)]
    # The last frame shows place 20 less than the one before, which is the map's.
    assert set(reasons[4:-1]) == {Reason.ACCEPTED}
    assert reasons[-1] is (Reason.RECENT if own else Reason.ACCEPTED)


def test_places_that_show_the_scene_count_by_the_share_of_it(street):
    decider, shares = PlaceRecognizer(street, OWN).decider, {20: 0.5, 30: 0.0}
    believed = {3: 0.6, 20: 0.3, 30: 0.05}
    places, mass = (np.array([*some]) for some in (believed, believed.values()))
    decider._belief = SimpleNamespace(places=places, mass=mass)

    def shares_of(place, others):
        assert place == 3
        return np.array([shares[one] for one in others.tolist()])

    decider._covisibility = SimpleNamespace(shares=shares_of)
    assert decider._shown(3, np.array([True, False, False])) == pytest.approx(0.75)


def test_a_jump_between_two_keyframes_is_a_jump(posed, image):
    recognizer = PlaceRecognizer(posed, with_values(RESTLESS, {'keyframe_interval_s': 1.0}))
    for number in range(20):  # 5 frames a second at 1 m/s; after the 12th, odometry is 12 m ahead
        pose = at(10 + 0.2 * number + 12 * (number > 12))
        recognizer.process(Frame(number * 200_000_000, image(10 + number // 5), pose=pose))
    assert recognizer.decider.odometry_jumps == 1


def test_an_odometry_restart_makes_no_place_implausible(posed, drive):
    # The second part is in no map.
    shown_places = [*range(10, 20), *range(1000, 1010), *range(40, 50)]
    poses = [at(x) for x in (*range(10, 30), *range(5000, 5010))]
    matches = drive(PlaceRecognizer(posed, RESTLESS), shown_places, poses=poses)
    assert accepted(matches[23:]) == [*range(43, 50)]
    assert not any(match.implausible_m for match in matches[20:])


def test_a_match_that_images_are_sure_of_says_how_far_odometry_denies_it(posed, drive):
    # By odometry, the robot stands while it leaves the map and comes back 30 m further on.
    shown_places = [*range(10, 20), *range(1000, 1010), *range(50, 60)]
    poses = [at(x) for x in (*range(10, 20), *[20] * 10, *range(20, 30))]
    matches = drive(PlaceRecognizer(posed, RESTLESS), shown_places, poses=poses)
    first, *later = (match for match in matches[20:] if match.accepted)
    # Of these 30 m, ten places and a tenth of the way are allowed.
    assert first.accepted.reference_index == 51 and first.implausible_m == pytest.approx(19.9)
    assert {match.implausible_m for match in later} == {None}  # it counts from the last match


@pytest.mark.skipif(not available(), reason='needs compiled kernels')
def test_decisions_and_inliers_are_those_without_compiled_kernels(street, drive, monkeypatch):
    def answers():
        config = with_values(OWN, {'search': 'exhaustive'})
        matches = drive(PlaceRecognizer(street, config), [*range(200, 205), *range(20, 32)])
        best = [one.best and (one.best.reference_index, one.best.inliers) for one in matches]
        return best, [one.reason for one in matches]

    compiled = answers()
    for room in ('compiled', 'similarity.kernels', 'retrieval.whitening'):
        monkeypatch.setattr(f'convseq_ros.core.{room}.available', lambda: False)
    assert answers() == compiled


def test_a_wrong_link_causes_few_further_errors(image):
    """A robot drives round three times; one link of the first round is put in by hand."""
    lap, grown = 55, ReferenceMap(SMALL, keyframes=EVERY_FRAME)
    recognizer, found = PlaceRecognizer(grown, ONLINE), []
    for index in range(3 * lap):
        if index == lap:
            grown.links.add(45, 8)
        found.append(recognizer.process(Frame(index * STEP_NS, image(index % lap, index))))
    wrong = [pair for pair in grown.links if (pair[0] - pair[1]) % lap]
    assert (45, 8) in wrong and len(wrong) <= 3  # itself, and its look of each round
    for start in (lap, 2 * lap):
        places = [one and one % lap for one in accepted(found[start : start + lap])]
        false = [one for index, one in enumerate(places) if one not in (None, index)]
        assert len(false) <= 1 and places.count(None) <= 3


# Where others say that the robot is.


def told(x, sigma_m=1.0):
    return PoseEstimate(at(x, 2.0), np.diag([sigma_m**2] * 6))


@pytest.mark.parametrize('place', [7, 30])
def test_a_robot_is_found_at_once_where_others_say_that_it_is(posed, drive, place):
    assert accepted(drive(PlaceRecognizer(posed, OWN), [place])) == [None]
    recognizer = PlaceRecognizer(posed, OWN)
    drive(recognizer, range(50, 54))
    assert recognizer.expect(told(place)) == 7  # 3 sigmas of sqrt(2) m, 2 m aside
    assert recognizer.localizer.localization.state is LocalizationState.LOST
    assert accepted(drive(recognizer, [place], start=4)) == [place]


def test_a_wrong_pose_that_others_tell_is_overruled_and_one_far_off_changes_nothing(posed, drive):
    recognizer = PlaceRecognizer(posed, OWN)
    drive(recognizer, range(10, 14))
    assert recognizer.expect(told(500.0)) == 0
    assert accepted(drive(recognizer, range(14, 16), start=4)) == [14, 15]
    assert recognizer.expect(told(60.0))
    assert accepted(drive(recognizer, range(16, 22), start=6))[2:] == [18, 19, 20, 21]


def test_poses_without_places_and_places_without_poses_are_not_near(street, posed):
    wide = told(-3.0, 100.0)
    assert PlaceRecognizer(street, OWN).expect(wide) == 0
    recognizer = PlaceRecognizer(posed, OWN)
    places, weights = places_near(posed, wide, 5)
    assert places.tolist() == [0, 1, 2, 3, 4] and weights.sum() == pytest.approx(1.0)
    assert (np.diff(weights) < 0).all() and recognizer.expect(wide) == PLACES
