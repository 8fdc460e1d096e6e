# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Places that are verified: found sooner, refused, or ambiguous."""

from dataclasses import replace

from convseq_ros.config import (
    AcceptanceConfig,
    Config,
    EncodingConfig,
    EVERY_FRAME,
    MatchingConfig,
    SequenceConfig,
)
from convseq_ros.core.compiled import available
from convseq_ros.core.decision.acceptance import Acceptance
from convseq_ros.core.decision.track_evidence import TRACK
from convseq_ros.core.decision.verified_evidence import VerifiedEvidence
from convseq_ros.core.encoding.descriptor import describe
from convseq_ros.core.geometry.verification import Verification
from convseq_ros.core.map.place import pack_cells, Place
from convseq_ros.core.map.reference_map import ReferenceMap
from convseq_ros.core.map_builder import build_map
from convseq_ros.core.recognizer import PlaceRecognizer
from convseq_ros.core.types import Candidate, Frame, Reason
from convseq_ros.simulation.drive import draw, Drive
from convseq_ros.simulation.street import Street
import numpy as np
import pytest

SMALL = EncodingConfig(image_size_px=256)
PLACES = 50
BY_KIND = {
    search: Config(
        encoding=SMALL,
        matching=MatchingConfig(matching='coherent', search=search, shortlist_length=20),
        sequence=SequenceConfig(fixed_length=6),
    )
    for search in ('shortlist', 'exhaustive')
}
both = pytest.mark.parametrize('config', BY_KIND.values(), ids=BY_KIND)


@pytest.fixture(scope='module')
def described(image):
    known = {}

    def of(place, seed=0):
        if (place, seed) not in known:
            known[place, seed] = describe(image(place, seed), SMALL)
        return known[place, seed]

    return of


def map_of(described, places):
    made = ReferenceMap(SMALL, keyframes=EVERY_FRAME)
    for index, place in enumerate(places):
        made.add(Place(index), pack_cells(described(place).cells))
    return made


def drive(recognizer, described, places):
    return [
        recognizer.process(Frame(index, None), described(place, 1))
        for index, place in enumerate(places)
    ]


@both
def test_the_first_frame_of_a_drive_may_be_a_match(described, config):
    recognizer = PlaceRecognizer(map_of(described, range(PLACES)), config)
    first = drive(recognizer, described, [20])[0]
    assert first.accepted.reference_index == 20
    assert first.sequence_length == 1 and first.confidence > 0.5
    assert first.accepted.inliers > 50


@both
def test_a_map_that_was_just_entered_is_recognised_at_once(described, config):
    recognizer = PlaceRecognizer(map_of(described, range(PLACES)), config)
    matches = drive(recognizer, described, [*range(200, 220), *range(20, 30)])
    assert not any(match.accepted for match in matches[:20])
    found = [match.accepted and match.accepted.reference_index for match in matches[20:]]
    assert found[2:] == [*range(22, 30)]
    assert set(found[:2]) <= {None, 20, 21}


@both
def test_a_place_that_the_map_holds_twice_is_ambiguous(described, config):
    twice = map_of(described, [*range(30), *range(30)])
    matches = drive(PlaceRecognizer(twice, config), described, range(5, 25))
    assert not any(match.accepted for match in matches)
    assert matches[-1].reason is Reason.AMBIGUOUS


@both
def test_without_verification_nothing_is_verified(described, config):
    off = replace(config, acceptance=AcceptanceConfig(verification=False))
    recognizer = PlaceRecognizer(map_of(described, range(PLACES)), off)
    matches = drive(recognizer, described, range(10, 30))
    assert {match.reason for match in matches[:5]} == {Reason.WARMING_UP}
    assert {one.inliers for match in matches for one in match.candidates} == {None}
    assert matches[-1].accepted.reference_index == 29


def test_the_papers_way_of_matching_verifies_nothing(described):
    paper = replace(
        BY_KIND['exhaustive'], matching=MatchingConfig(matching='regional', search='exhaustive')
    )
    recognizer = PlaceRecognizer(map_of(described, range(PLACES)), paper)
    matches = drive(recognizer, described, range(10, 20))
    assert {one.inliers for match in matches for one in match.candidates} == {None}


@pytest.mark.skipif(not available(), reason='needs compiled kernels')
def test_decisions_and_inliers_are_those_without_compiled_kernels(described, monkeypatch):
    def answers(kernel):
        matching = replace(BY_KIND['exhaustive'].matching, kernel=kernel)
        config = replace(BY_KIND['exhaustive'], matching=matching)
        recognizer = PlaceRecognizer(map_of(described, range(PLACES)), config)
        return [
            (match.reason, match.best and (match.best.reference_index, match.best.inliers))
            for match in drive(recognizer, described, [*range(200, 205), *range(20, 32)])
        ]

    compiled = answers('float32')
    monkeypatch.setattr('convseq_ros.core.compiled.available', lambda: False)
    assert answers('numpy') == compiled


class Given:
    """Stands in for what can be verified of a frame."""

    def __init__(self, strengths, step, row=None):
        self.strengths, self.verified_step = strengths, Verification(0, step, step / 2)
        self.row, self.asked = row, []

    def score(self, count, ends):
        self.asked.append((count, ends.tolist()))

    def verified(self, indices):
        found = {index: self.strengths.get(index, 20.0) for index in indices}
        return {
            index: one if isinstance(one, Verification) else Verification(0, one, one / 2)
            for index, one in found.items()
        }


@pytest.mark.parametrize(
    ('step', 'session_start', 'reason'),
    [
        (600.0, 0, Reason.UNVERIFIED),
        (600.0, 31, Reason.ACCEPTED),
        (600.0, None, Reason.ACCEPTED),
        (400.0, 0, Reason.ACCEPTED),
    ],
)
def test_a_place_of_this_drive_must_look_as_this_drive_does(step, session_start, reason):
    # Its own frames are verified with 600; the place it returns to has 200.
    acceptance, rng = Acceptance(Config()), np.random.default_rng(1)
    config = AcceptanceConfig()
    row = rng.normal(0.05, 0.002, 100).astype(np.float32)
    row[30] = 0.3
    given = Given({30: 200.0}, step)
    acceptance.update(0, [row], np.arange(100), 10, geometry=given, session_start=session_start)
    found = acceptance.judge([Candidate(30, 30, 0.3)], config)
    assert found.reason is reason
    assert acceptance.inliers(30) == 0 and acceptance.inliers(50) is None


@pytest.mark.parametrize(
    ('scores', 'strengths', 'where'),
    [
        ({32: 0.25}, {30: 60.0, 32: 200.0}, 32),
        ({32: 0.25, 31: 0.3}, {30: 60.0, 32: 200.0}, 30),  # 31 scores best, and is none
        ({32: 0.25}, {30: 180.0, 32: 200.0}, 30),  # hardly better
        ({34: 0.25}, {30: 60.0, 34: 200.0}, 30),  # too far
        ({32: 0.25}, {30: 60.0, 32: Verification(0, 200.0, 5.0)}, 30),  # a zebra crossing
        ({}, {30: 60.0, 32: 200.0}, 30),  # nothing beside it was scored
    ],
)
def test_a_match_belongs_to_the_neighbour_that_the_newest_frame_shows(scores, strengths, where):
    row = np.full(40, np.nan, np.float32)
    row[30] = 0.2
    for index, score in scores.items():
        row[index] = score
    given = Given(strengths, 0.0, row)
    assert VerifiedEvidence().placed(30, given) == where
    assert given.asked == [(1, [*range(27, 34)])]


def test_a_track_whose_velocity_has_just_changed_is_looked_at_once_more():
    # The newest frame shows what lies two places behind the end of the track.
    rng, acceptance, placed = np.random.default_rng(1), Acceptance(Config()), {}
    scores = rng.normal(0.05, 0.002, (40, 100)).astype(np.float32)
    for frame in range(40):
        scores[frame, [18 + frame, 20 + frame]] = 0.2, 0.3
    for frame in range(16, 40):
        best = 20 + frame
        rows, velocity = list(scores[frame : frame - 10 : -1]), 0.5 if frame < 28 else 1.0
        given = Given({best: 100.0, best - 2: 200.0}, 0.0, rows[0])
        acceptance.update(frame, rows, np.arange(100), 10, velocity, given)
        placed[frame] = best - acceptance.placed(best, AcceptanceConfig().min_evidence)
    assert {placed[frame] for frame in range(16, 28)} == {2}  # another velocity than the map's
    assert [placed[frame] for frame in range(28, 40)] == [2] * (TRACK.window // 2) + [0] * 8


@pytest.mark.parametrize(
    ('velocity', 'strengths', 'where'),
    [
        (1.0, {30: 180.0, 33: 200.0}, 30),
        (0.5, {30: 180.0, 33: 200.0}, 33),  # better at all
        (0.5, {30: 180.0, 34: 400.0}, 30),  # too far
        (2.4, {30: 180.0, 37: 200.0, 33: 100.0}, 37),  # within 8 places
    ],
)
def test_at_another_velocity_an_end_is_less_sure(velocity, strengths, where):
    row = np.full(60, np.nan, np.float32)
    row[[30, *strengths]] = 0.2
    row[where] = 0.3
    assert VerifiedEvidence().placed(30, Given(strengths, 0.0, row), velocity) == where


@pytest.mark.parametrize(
    ('strengths', 'is_settled'),
    [
        ({30: 113.0, 31: 102.0, 27: 110.0}, True),
        ({30: 113.0, 31: 102.0, 27: 120.0}, False),
        ({30: 113.0, 31: 130.0, 27: 120.0}, True),  # one place, as far as frames tell
        ({30: 113.0, 24: 200.0}, True),  # beyond the peak: a rival, not a slip along the way
        ({30: 113.0, 34: 200.0}, True),  # beyond the map
    ],
)
def test_a_place_is_settled_if_none_further_along_its_peak_is_verified_better(
    strengths, is_settled
):
    given = Given(strengths, 0.0, np.full(34, np.nan, np.float32))
    assert VerifiedEvidence().is_settled(30, given) is is_settled


def test_the_first_frames_of_a_slower_drive_are_where_they_are():
    # Places 6 m apart, frames half a metre: sequences are taken for some of the map's velocity.
    def frames(spacing_m, count, **how):
        drive = Drive(
            frame_rate_hz=10 / spacing_m, num_frames=count, width_px=160, height_px=120, **how
        )
        return [(shot.distance_m, shot.frame) for shot in draw(Street(400.0, 901), drive)]

    mapped = frames(6.0, 25, seed=1802)
    recognizer = PlaceRecognizer(build_map([frame for _, frame in mapped]), Config())
    off_m = [
        abs(mapped[match.accepted.reference_index][0] - at_m)
        for at_m, frame in frames(0.5, 14, seed=1803, light='evening', lane_offset_m=-0.5)
        if (match := recognizer.process(frame)).accepted
    ]
    assert len(off_m) >= 6 and max(off_m) <= 6.0
