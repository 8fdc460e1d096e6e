# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What geometry adds to the evidence, and what a few newest frames say alone."""

from convseq_ros.core.decision.confidence import balance
from convseq_ros.core.decision.likeliest import LIKELIEST
from convseq_ros.core.decision.verified_evidence import VERIFIED, VerifiedEvidence
from convseq_ros.core.geometry.verification import Verification
import pytest

FAR = 40  # from all places of these tests


def verified(strength, upper=None):
    """Return what geometry says of a place, half of it by the upper half unless told."""
    return Verification(int(2 * strength), strength, strength / 2 if upper is None else upper)


def strengths(**of):
    """Return what geometry says of some places, by their numbers: _12=200."""
    return {int(name[1:]): verified(one) for name, one in of.items()}


def driven(*frames, start=0):
    """Return the evidence of frames: a place, its lead in deviations, strengths here and there."""
    evidence = VerifiedEvidence()
    for number, (place, deviations, here, there) in enumerate(frames, start):
        found = {place: verified(here), place + FAR: verified(there)}
        evidence.update(found, 10)
        evidence.see(number, place, deviations)
    return evidence


def test_a_lead_counts_in_square_roots_of_the_rivals_strength():
    evidence = VerifiedEvidence()
    evidence.update(strengths(_5=150.0, _60=100.0), 10)
    assert evidence.lead(5) == pytest.approx((150 - 100) / 10)
    assert evidence.lead(60) == pytest.approx((100 - 150) / 150**0.5)


def test_a_rival_that_is_hardly_verified_counts_as_unrelated_images_do():
    evidence = VerifiedEvidence()
    evidence.update(strengths(_5=90.0, _60=3.0), 10)
    assert evidence.lead(5) == pytest.approx((90 - 3) / VERIFIED.least_strength**0.5)


def test_a_place_that_one_side_of_the_image_verifies_is_out_of_balance():
    evidence, least = VerifiedEvidence(), VERIFIED.least_strength
    for left in (20.0, 180.0):
        evidence.update({5: Verification(0, 200.0, 90.0, left), 6: verified(90.0)}, 10)
        assert balance(evidence.shown(6)) == (20 + least) / (180 + least)
    in_the_dark = Verification(0, 40.0, 20.0, 30.0)
    assert balance(in_the_dark) > 0.6 and balance(evidence.shown(60)) == 1


def test_without_a_rival_there_is_no_lead():
    evidence = VerifiedEvidence()
    evidence.update(strengths(_5=500.0, _9=400.0), 10)
    assert evidence.lead(5) is None and evidence.beside_scores(5) == 0
    evidence.see(0, 5, 3.0)
    assert evidence.likeliest.alone(0) == (5, 0.0)


def test_nothing_verified_says_nothing():
    evidence = VerifiedEvidence()
    evidence.update({}, 10)
    assert evidence.lead(5) is None and evidence.strength(5) is None
    assert evidence.rival_strength(5) is None and not evidence.is_rivalled(5)
    assert evidence.likeliest.alone(0) is None and evidence.recent_strength(0, 5) is None


def test_a_place_that_is_verified_worse_than_its_rival_is_not_held_against_its_scores():
    evidence = VerifiedEvidence()
    evidence.update(strengths(_5=40.0, _60=90.0), 10)
    assert evidence.lead(5) < 0 and evidence.beside_scores(5) == 0


@pytest.mark.parametrize(('rival', 'is_rivalled'), [(100.0, False), (170.0, True)])
def test_a_rival_that_is_verified_nearly_as_well_makes_a_place_ambiguous(rival, is_rivalled):
    evidence = VerifiedEvidence()
    evidence.update(strengths(_5=200.0, _60=rival), 10)
    assert evidence.is_rivalled(5) == is_rivalled


@pytest.mark.parametrize(('rival', 'denied'), [(40.0, False), (90.0, True), (120.0, True)])
def test_a_place_that_is_verified_no_better_than_by_chance_is_denied(rival, denied):
    evidence = VerifiedEvidence()
    evidence.update(strengths(_5=100.0, _60=rival), 10)
    assert evidence.denies(5) == evidence.denies(6) == denied
    assert not evidence.denies(30)  # nobody has looked there


def test_one_frame_that_is_verified_far_better_is_evidence_alone():
    # 30 deviations by scores and (400 - 36) / 6 by geometry.
    (place, evidence) = driven((7, 30.0, 400.0, 36.0)).likeliest.alone(0)
    assert place == 7
    assert evidence == pytest.approx((30 + VERIFIED.deviations * 364 / 6) / LIKELIEST.alone)
    assert evidence > 1.7
    assert driven((7, 2.0, 60.0, 50.0)).likeliest.alone(0)[1] < 0.2


def test_a_zebra_crossing_is_no_evidence_alone():
    # One of a drawn street, by far the best verified place of the map: all of it on the ground.
    evidence = VerifiedEvidence()
    evidence.update({39: verified(224.0, 30.0), 104: verified(48.0, 27.0)}, 10)
    evidence.see(1, 39, 22.0)
    assert evidence.likeliest.alone(1)[0] == 39
    assert evidence.likeliest.alone(1)[1] == pytest.approx(
        3 * 0.73 * 3 / 27**0.5 / LIKELIEST.alone
    )
    assert evidence.beside_scores(39) == pytest.approx(0.36 * 3 * 3 / 27**0.5 - 0.5)
    evidence.update({39: verified(224.0, 190.0), 104: verified(48.0, 27.0)}, 10)
    evidence.see(1, 39, 22.0)
    assert evidence.likeliest.alone(1)[1] == pytest.approx(
        (22 + 0.73 * 176 / 48**0.5) / LIKELIEST.alone
    )


def test_frames_on_one_way_add_up_by_the_root_of_their_number():
    frame = 10.0, 100.0, 64.0
    alone = driven((7, *frame)).likeliest.alone(0)[1]
    for count in range(2, LIKELIEST.frames + 3):
        way = driven(*((7 + number, *frame) for number in range(count)))
        summed = min(count, LIKELIEST.frames)
        assert way.likeliest.alone(count - 1) == (6 + count, pytest.approx(alone * summed**0.5))


def test_frames_elsewhere_do_not_add_up_and_do_not_take_away():
    frame = 10.0, 100.0, 64.0
    alone = driven((7, *frame)).likeliest.alone(0)[1]
    way = driven((90, *frame), (20, *frame), (7, *frame))
    assert way.likeliest.alone(2) == (7, pytest.approx(alone))


def test_a_way_may_be_half_as_fast_or_half_again_as_fast_as_the_maps():
    frame = 10.0, 100.0, 64.0
    alone = driven((7, *frame)).likeliest.alone(0)[1]
    for places in ((10, 10, 11), (10, 12, 13), (20, 21, 23)):
        way = driven(*((place, *frame) for place in places))
        assert way.likeliest.alone(2)[1] == pytest.approx(alone * 3**0.5)
    backwards = driven(*((place, *frame) for place in (14, 12, 10)))
    assert backwards.likeliest.alone(2)[1] == pytest.approx(alone)


@pytest.mark.parametrize(
    ('places', 'velocity'),
    [
        ((10, 16, 22, 28, 34), 6.0),
        ((10, 16, 22, 28), 6.0),
        ((10, 16, 22), None),  # any two lie on a line, and a third one may do so by chance
        ((10, 16, 90, 28, 34), 6.0),
        ((10, 16, 90, 70, 34), None),
        ((90, 10, 12, 14, 15, 18), 2.0),  # no place that is further back than five frames counts
        ((50, 44, 38, 32, 26), -6.0),
        ((10, 11, 12, 14, 15), None),  # about as fast as the map's drive
        ((10, 10, 11, 11, 12), None),  # slower: five frames cannot tell
        ((), None),
    ],
)
def test_four_of_five_places_on_a_line_tell_a_velocity(places, velocity):
    way = driven(*((place, 10.0, 100.0, 64.0) for place in places))
    assert way.likeliest.velocity == velocity


def test_only_the_newest_frame_says_where_one_is_now():
    evidence = driven((7, 30.0, 400.0, 36.0))
    assert evidence.likeliest.alone(1) is None


def test_strengths_are_averaged_over_the_newest_three_frames_of_a_way():
    frames = [(7 + number, 5.0, here, 30.0) for number, here in enumerate((10, 300, 60, 240))]
    evidence = driven(*frames)
    assert evidence.recent_strength(3, 10) == pytest.approx(200)
    assert evidence.recent_strength(3, 10 + FAR) == pytest.approx(30)


def test_a_place_next_to_one_that_was_verified_counts_as_verified():
    # The end of a sequence may lie two references from what was looked at.
    evidence = driven((7, 5.0, 90.0, 30.0))
    assert evidence.recent_strength(0, 9) == 90 and evidence.recent_strength(0, 10) is None
