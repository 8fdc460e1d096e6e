# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The recogniser, with keyframes, stops, dropped frames and jumps; what a frame takes."""

from dataclasses import replace

from convseq_ros import build_map, Frame, open_map, PlaceRecognizer
from convseq_ros.config import EVERY_FRAME, KeyframeConfig, make_config, with_values
from convseq_ros.core.encoding.descriptor import describe
from convseq_ros.core.map.reference_map import ReferenceMap
from convseq_ros.core.types import Camera, Reason, Status
from convseq_ros.errors import ConfigError
import numpy as np
from poses import at
import pytest
from world import map_of

STEP_NS = 100_000_000
PLACES, MAPPED = 90, 60
BY_TIME = KeyframeConfig(keyframe_interval_s=0.3)
BY_DISTANCE = KeyframeConfig(keyframe_distance_m=2.5)
OWN = make_config({'image_size_px': 256, 'fixed_length': 4})
SMALL = OWN.encoding
PAPER = with_values(OWN, {'matching': 'regional', 'search': 'exhaustive', 'fixed_length': 0})
ONLINE = with_values(OWN, {'mode': 'online', 'keyframe_interval_s': 0.3})


@pytest.fixture(scope='module')
def third_places(image):
    return [describe(image(place), SMALL) for place in range(0, PLACES, 3)]


@pytest.fixture(scope='module')
def reference_map(image):
    shown = (describe(image(place), SMALL) for place in range(MAPPED))
    return map_of(shown, SMALL, poses=[*map(at, range(MAPPED))])


@pytest.fixture(scope='module')
def drive(image):
    """Return a way to show places, one a step; None never comes; odometry is of place 0."""

    def show(recognizer, places, start_ns=0, seed=1, odometry=None):
        found = []
        for index, place in enumerate(places):
            if place is not None:
                pose = None if odometry is None else at(place + odometry)
                frame = Frame(start_ns + index * STEP_NS, image(place, seed), pose=pose)
                found.append(recognizer.process(frame))
        return found

    return show


def test_by_odometry_the_velocity_of_the_query_does_not_matter(third_places, drive):
    recognizer = PlaceRecognizer(map_of(third_places, SMALL, BY_DISTANCE), OWN)
    slowly = np.repeat(np.arange(30, 48), 2).tolist()
    places = [*slowly, *range(48, 60), *range(60, 88, 3)]
    matches = drive(recognizer, places, odometry=0)
    asked = [match for match in matches if match.reason is not Reason.BETWEEN_KEYFRAMES]
    assert [match.best.reference_index for match in asked[4:]] == [*range(14, 30)]
    assert all(match.accepted for match in asked[-6:])
    # The views are the same; only an accepted match tells how much of them is common.
    assert all(bool(match.overlap) == bool(match.accepted) for match in matches)
    assert min(match.overlap for match in asked[-6:]) > 0.9


def test_pair_scores_and_features_are_those_of_the_newest_keyframe(third_places, drive):
    recognizer = PlaceRecognizer(map_of(third_places, SMALL, BY_TIME), OWN)
    assert recognizer.pair_scores is None and recognizer.features is None
    *_, match = drive(recognizer, range(30, 40))
    scores = recognizer.pair_scores
    assert len(scores) == len(third_places)
    (again,) = recognizer.matcher.scores_of([(recognizer.features, np.arange(len(scores)))])
    assert np.nanargmax(scores) == again.argmax() == match.best.reference_index
    known = np.isfinite(scores)
    assert np.array_equal(scores[known], again[known])


def test_after_a_clock_jump_the_first_frame_is_a_described_keyframe(drive):
    grown = ReferenceMap(SMALL, keyframes=BY_DISTANCE)
    config = replace(ONLINE, keyframes=BY_DISTANCE)
    recognizer = PlaceRecognizer(grown, config)
    drive(recognizer, range(7), start_ns=10**12, odometry=0)
    drive(recognizer, range(6, 12), odometry=0)
    assert recognizer.resets == 1 and recognizer.mapping.session_start == 3
    assert [int(place.pose.position[0]) for place in grown.places] == [0, 3, 6, 6, 9]
    assert all(grown.cells(index).any() for index in range(5))


@pytest.mark.parametrize('keyframes', [BY_TIME, KeyframeConfig(), EVERY_FRAME])
def test_an_unreadable_frame_has_no_candidates_wherever_it_comes(third_places, drive, keyframes):
    recognizer = PlaceRecognizer(map_of(third_places, SMALL, keyframes), OWN)
    known = drive(recognizer, range(30, 61))
    assert known[-1].candidates
    stamps_ns = [(31 + index) * STEP_NS for index in range(8)]
    lost = [recognizer.process(Frame(stamp_ns, None, problem='cut')) for stamp_ns in stamps_ns]
    assert {one.status for one in lost} == {Status.SKIPPED}
    assert {one.reason for one in lost} == {Reason.UNREADABLE}
    assert not any(match.candidates or match.confidence for match in lost)


def test_at_standstill_the_last_answer_is_repeated_and_is_no_match(reference_map, drive):
    recognizer = PlaceRecognizer(reference_map, OWN)
    matches = drive(recognizer, [*range(10, 30), *[29] * 30, *range(30, 45)])
    assert matches[19].accepted.reference_index == 29
    for one in matches[20:50]:
        assert (one.status, one.reason) == (Status.REJECTED, Reason.STATIONARY)
        assert (one.best.reference_index, one.pairs_scored) == (29, 0)
    assert [match.accepted.reference_index for match in matches[50:]] == [*range(30, 45)]


def test_the_paper_takes_equal_frames_as_they_come(reference_map, drive):
    matches = drive(PlaceRecognizer(reference_map, PAPER), [20] * 16)
    assert Reason.STATIONARY not in {match.reason for match in matches}
    assert matches[-1].sequence_length == 15


@pytest.mark.parametrize('search', ['shortlist', 'exhaustive'])
def test_frames_that_never_came_hold_their_places(reference_map, search, drive):
    config = with_values(OWN, {'search': search})
    places = [None if place in (25, 26, 30, 38) else place for place in range(5, 50)]
    matches = drive(PlaceRecognizer(reference_map, config), places)
    found = [match.accepted.reference_index for match in matches[14:]]
    assert found == [place for place in places if place is not None][14:]


def test_matches_come_at_the_stated_rate(reference_map, drive):
    config = with_values(OWN, {'closure_interval_s': 1.0})
    matches = drive(PlaceRecognizer(reference_map, config), range(5, 55))
    first, *accepted = [match.query_index for match in matches if match.accepted]
    assert accepted == list(range(first + 10, 50, 10))
    reasons = {match.reason for match in matches[first:]}
    assert reasons == {Reason.ACCEPTED, Reason.COOL_DOWN}


def test_the_shift_is_given_in_cells_in_pixels_and_as_a_turn(reference_map, image):
    config = with_values(OWN, {'fixed_length': 1})
    camera = Camera(160, 120, 100.0, 100.0, 80.0, 60.0)
    moved = np.roll(image(20), -20, axis=1)
    match = PlaceRecognizer(reference_map, config).process(Frame(0, moved, camera=camera))
    assert match.best.reference_index == 20
    assert match.best.shift == (0.0, 2.0) and match.shift_px == (0.0, 20.0)
    assert match.relative_yaw_rad == pytest.approx(-0.2, abs=0.01)
    unknown = PlaceRecognizer(reference_map, config).process(Frame(0, moved))
    assert unknown.shift_px == (0.0, 20.0) and unknown.relative_yaw_rad is None
    frame = Frame(0, moved, camera=replace(camera, fx_px=0.0))
    assert PlaceRecognizer(reference_map, config).process(frame).relative_yaw_rad is None


def test_what_is_no_map_or_no_frame_is_refused(reference_map):
    with pytest.raises(ConfigError, match=r"expected a map, got 'm.db'; open_map opens a file"):
        PlaceRecognizer('m.db')
    with pytest.raises(ConfigError, match='expected a Frame, got tuple'):
        PlaceRecognizer(reference_map).process((0, None))
    with pytest.raises(ConfigError, match='expected a Frame, got tuple'):
        build_map([(0, None)])


@pytest.mark.parametrize('search', ['shortlist', 'exhaustive'])
@pytest.mark.parametrize('matching', ['coherent', 'regional'])
def test_after_a_reset_answers_are_those_of_a_fresh_start(reference_map, drive, matching, search):
    config = with_values(OWN, {'matching': matching, 'search': search})
    used, fresh = (PlaceRecognizer(reference_map, config) for _ in range(2))
    drive(used, range(40, 60), seed=7, odometry=0)
    used.reset()
    anew = {'start_ns': 100 * STEP_NS, 'odometry': 500}  # it begins at other coordinates
    matches = (drive(one, range(5, 35), **anew) for one in (used, fresh))
    again, first = ([replace(one, query_index=0) for one in some] for some in matches)
    assert again == first and any(match.accepted for match in first)


@pytest.mark.parametrize('search', ['shortlist', 'exhaustive'])
def test_a_drive_in_reverse_gear_is_recognised_sooner_if_expected(reference_map, drive, search):
    def accepted(both):
        config = with_values(OWN, {'both_directions': both, 'search': search})
        matches = drive(PlaceRecognizer(reference_map, config), range(50, 10, -1))
        return [match.accepted and match.accepted.reference_index for match in matches]

    ahead, both = accepted(False), accepted(True)
    assert both[3:] == list(range(47, 10, -1))
    assert both.count(None) <= ahead.count(None)


def test_a_longer_fixed_length_set_while_running_waits_for_its_frames(reference_map, drive):
    recognizer = PlaceRecognizer(reference_map, with_values(PAPER, {'fixed_length': 3}))
    drive(recognizer, range(4))
    recognizer.config = with_values(PAPER, {'fixed_length': 6})
    matches = drive(recognizer, range(4, 8), start_ns=4 * STEP_NS)
    assert [match.reason for match in matches][:2] == [Reason.WARMING_UP] * 2
    assert matches[-1].accepted.reference_index == 7
    assert {match.pairs_scored for match in matches[2:]} == {MAPPED}


def test_a_map_of_blank_images_gives_no_match(image):
    dark, black = np.zeros((64, 64), np.uint8), ReferenceMap(SMALL)
    for index in range(3):
        black.add_frame(Frame(index + 1, dark), describe(dark, SMALL), 0)
    assert PlaceRecognizer(black, OWN).process(Frame(10**9, image(0))).accepted is None


def test_without_a_frame_or_a_candidate_there_are_no_displacements():
    assert PlaceRecognizer(ReferenceMap()).displacements(None).shape == (0, 5)


@pytest.mark.parametrize('kind', [np.int64, np.int32, np.uint64])
def test_a_map_of_numpy_stamps_can_be_opened(tmp_path, image, kind):
    stamps_ns = np.arange(1, 4, dtype=kind) * kind(10**8)
    built = build_map(
        [Frame(stamp_ns, image(at)) for at, stamp_ns in enumerate(stamps_ns)], tmp_path / 'map.db'
    )
    opened = open_map(tmp_path / 'map.db')
    assert [place.stamp_ns for place in opened.places] == stamps_ns.tolist()
    assert len(built) == 3


@pytest.mark.parametrize('stamp_ns', [1.5, np.float64(10**9), '10', None, 2**63, -(2**63) - 1])
def test_a_stamp_that_is_no_integer_of_64_bits_is_refused(stamp_ns):
    with pytest.raises(ValueError, match=r'stamp_ns: .*; give ns'):
        Frame(stamp_ns, None)


@pytest.mark.parametrize(
    ('change', 'got'),
    [
        (np.ndarray.tolist, 'list'),
        (np.ndarray.tobytes, 'bytes'),
        (lambda gray: gray / 255, 'float64'),
        (lambda gray: gray.astype(np.int64), 'int64'),
        (lambda gray: gray > 9, 'bool'),
        (lambda gray: np.dstack([gray] * 3), r'4, 6, 3\) uint8'),
        (lambda gray: gray[:0], r'\(0, 6\) uint8'),
    ],
)
def test_an_image_that_is_not_gray_is_refused(change, got):
    with pytest.raises(ValueError, match=rf'expected \(H, W\) uint8, got .*{got}'):
        Frame(1, change(np.zeros((4, 6), np.uint8)))
