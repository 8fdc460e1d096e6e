# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Evidence that the last frames together give for a place."""

from convseq_ros.core.decision.track_evidence import TRACK, TrackEvidence
from hypothesis import given, strategies
import numpy as np
import pytest

PLACES = 60


def drawn_scores(frames=40, places=PLACES, start=8, contrast=0.3, seed=0, velocity=1.0):
    """Return pair scores like coherent ones, with a true diagonal from reference `start`."""
    scores = np.random.default_rng(seed).uniform(0.08, 0.2, (frames, places)).astype(np.float32)
    for frame in range(frames):
        place = round(start + velocity * frame)
        if 0 <= place < places:
            scores[frame, place] += contrast
    return scores


def newest_first(scores, frame, memory=25):
    return [scores[frame - back] for back in range(min(frame + 1, memory))]


def update(evidence, frame, rows, velocity=1.0, ends=None):
    return evidence.update(
        frame,
        rows,
        np.arange(PLACES if rows[0] is None else len(rows[0])) if ends is None else ends,
        10,
        velocity,
    )


def run(scores, evidence=None, velocity=1.0):
    """Return the last frame's evidence, and what was said of each frame's best reference."""
    evidence = evidence or TrackEvidence()
    said = []
    for frame in range(len(scores)):
        newest = update(evidence, frame, newest_first(scores, frame), velocity)
        said.append(evidence.evidence(frame, newest.reference, velocity) if newest else None)
    return evidence, newest, said


def test_one_frame_by_hand():
    row = np.full(40, 0.1, np.float32)
    row[20], row[25], row[26] = 0.5, 0.4, 0.2
    evidence = TrackEvidence()
    newest = update(evidence, 7, [row])
    assert (newest.frame, newest.reference, newest.rivals) == (7, 20, 19)
    assert newest.margin == pytest.approx((0.5 - 0.2) / TRACK.window)
    assert evidence.scatter is None and evidence.evidence(7, 20) is None


@pytest.mark.parametrize(('places', 'enough'), [(18, False), (19, True)])
def test_it_takes_eight_rivals_farther_than_ten_references(places, enough):
    row = np.full(places, 0.1, np.float32)
    row[0] = 0.5
    said = update(TrackEvidence(), 0, [row])
    assert said.enough_rivals is enough and (said.margin > 0) is enough


# References of which those beyond 10 from 27 are 20, and 10 of them score 0.11, 10 score 0.09.
ENDS, PEAK = np.arange(7, 48), 27
SCATTER = np.sqrt((0.01**2 + 2 * 0.006**2) / 3) + 0.001
CHANCE = 6 * SCATTER / np.sqrt(20)


def diagonals(peaks):
    """Return rows, newest first, in which diagonals score 0.11 and 0.09 and one as is said."""
    along = np.where(ENDS % 2, 0.09, 0.11)
    rows = [np.full(ENDS[-1] + 1, np.nan) for _ in peaks]
    for back, (row, peak) in enumerate(zip(rows, peaks, strict=True)):
        row[ENDS - back] = np.where(ENDS == PEAK, peak, along)
    return rows


def test_the_first_window_by_hand():
    evidence = TrackEvidence()
    said = update(evidence, 7, diagonals([0.9] * 8), ends=ENDS)
    assert (said.reference, said.rivals) == (PEAK, 20)
    assert evidence.scatter == pytest.approx(SCATTER)
    assert said.margin == pytest.approx(0.9 - 0.11 - CHANCE)
    # Over 20 frames at least, and 30 at most; at another velocity, a third less.
    in_scatters = said.margin / SCATTER
    assert evidence.evidence(7, PEAK) == pytest.approx(in_scatters / 20)
    assert evidence.evidence(7, PEAK + 2) == pytest.approx(in_scatters / 20)
    assert evidence.evidence(7, PEAK, 1.25) == pytest.approx(in_scatters / 20 / 1.5)
    assert evidence.evidence(7, PEAK + 3) == 0
    for later, frames in ((24, 25), (40, 30)):
        assert evidence.evidence(7 + later, PEAK + later) == pytest.approx(in_scatters / frames)


def test_a_newest_frame_that_hardly_shows_the_place_bounds_the_evidence():
    evidence = TrackEvidence()
    update(evidence, 7, diagonals([0.13] + [0.9] * 7), ends=ENDS)
    assert evidence.evidence(7, PEAK) == pytest.approx((0.13 - 0.1) / (0.01 + 0.001))


def test_pairs_that_were_not_scored_count_as_average_by_hand():
    evidence = TrackEvidence()
    said = update(evidence, 7, diagonals([0.9] * 5 + [np.nan] * 3), ends=ENDS)
    # Means of a row with the peak among its 41 pairs, and without it.
    means = (4.0 + 0.9) / 41, 4.0 / 40
    peak = 5 * (0.9 - means[0]) / 8
    rival = (5 * (0.11 - means[0]) + 3 * (0.11 - means[1])) / 8
    assert said.reference == PEAK and said.margin == pytest.approx(peak - rival - CHANCE)
    mostly_unknown = diagonals([0.9] * 3 + [np.nan] * 5)
    assert update(TrackEvidence(), 7, mostly_unknown, ends=ENDS).reference != PEAK


def test_what_a_reference_usually_scores_is_taken_off_by_hand():
    first, second = np.full((2, PLACES), 0.1)
    first[50] = second[50] = 0.7
    second[21] = 0.65
    evidence = TrackEvidence()
    assert update(evidence, 0, [first]).reference == 50
    said = update(evidence, 1, [second, first])
    # After one frame, a sixth of the 0.6 by which reference 50 stands out is usual there.
    assert said.reference == 21
    assert said.margin == pytest.approx((0.55 - 0.6 * 5 / 6) / TRACK.window)


def test_where_the_drive_is_scores_do_not_count_as_usual():
    rows, evidence = np.random.default_rng(0).uniform(0.08, 0.2, (30, PLACES)), TrackEvidence()
    rows[:, 20] += 0.3
    margins = [
        update(evidence, frame, newest_first(rows, frame), 0.0).margin for frame in range(30)
    ]
    assert margins[-1] > 0.8 * margins[TRACK.window]


def test_it_grows_along_the_track_and_falls_when_the_track_is_left():
    scores = drawn_scores(frames=30, start=10)
    scores[20:] = drawn_scores(frames=10, contrast=0.0, seed=3)
    said = run(scores)[-1]
    assert said[TRACK.window - 2] is None and said[TRACK.window - 1] > 2
    assert min(said[TRACK.window : 20]) > 4
    assert said[-1] < 0.3 * said[19]


def test_a_road_that_forks_is_left_at_once():
    scores = drawn_scores(frames=30)
    scores[20:] = drawn_scores(frames=10, contrast=0.0, seed=3)
    evidence = TrackEvidence()
    said = []
    for frame in range(30):
        newest = update(evidence, frame, newest_first(scores, frame))
        said.append(evidence.evidence(frame, 8 + frame))
        assert newest.reference == 8 + frame or frame > 22
    assert min(said[12:20]) > 4
    assert max(said[20:]) < 2 and sum(value >= 1.6 for value in said[20:]) <= 1


def test_places_that_were_never_there_give_little():
    for seed in range(5):
        said = run(drawn_scores(frames=60, contrast=0.0, seed=seed))[-1]
        assert max(value for value in said if value is not None) < 0.5


def test_a_peak_at_the_border_of_the_map_is_none():
    scores = drawn_scores(frames=30, start=PLACES - 25)
    evidence = TrackEvidence()
    found = [update(evidence, one, newest_first(scores, one)) for one in range(25)]
    assert [newest.reference for newest in found[-3:]] == [PLACES - 3, PLACES - 2, PLACES - 1]
    assert found[-3].margin > 0 and found[-2].margin == found[-1].margin == 0


def test_a_drive_that_left_the_map_does_not_creep_towards_its_end():
    scores = drawn_scores(frames=45, start=PLACES - 36)
    for frame in range(36, 45):
        scores[frame, PLACES - 1] += 0.3
    evidence = TrackEvidence()
    for frame in range(45):
        update(evidence, frame, newest_first(scores, frame), 0.67)
    assert evidence.evidence(44, PLACES - 1, 0.67) == 0
    assert evidence.evidence(44, PLACES - 3, 0.67) > 0


def test_too_few_rivals_are_no_rivals():
    scores = drawn_scores(frames=20, places=15, start=0)
    evidence = TrackEvidence()
    found = [update(evidence, one, newest_first(scores, one)) for one in range(12)]
    assert not any(newest.enough_rivals for newest in found[4:])
    assert all(newest.margin == 0 for newest in found[4:])


def test_what_it_says_of_a_frame_does_not_depend_on_later_ones():
    scores = drawn_scores(frames=40)
    assert run(scores[:25])[-1] == run(scores)[-1][:25]


@given(offset=strategies.floats(-0.05, 0.3))
def test_what_every_reference_gains_counts_for_nothing(offset):
    scores = drawn_scores(frames=15).astype(np.float64)
    lifted = scores.copy()
    lifted[12] += offset
    assert run(lifted)[-1][12] == pytest.approx(run(scores)[-1][12])


@given(scale=strategies.floats(0.5, 2.0))
def test_scores_of_another_scale_give_the_same_but_for_the_smallest_scatter(scale):
    scores = drawn_scores(frames=30, contrast=0.1).astype(np.float64)
    one, newest, said = run(scores)
    other, scaled_last, scaled = run(scale * scores)
    assert scaled_last.margin == pytest.approx(scale * newest.margin, rel=0.1)
    assert 0 < (other.scatter - one.scatter) * (scale - 1) or scale == 1
    assert scaled[-1] == pytest.approx(said[-1], rel=0.35)


def test_a_place_that_always_scores_high_is_not_preferred():
    scores = drawn_scores(frames=40, contrast=0.1)
    scores[:, 50] += 0.3
    _, newest, said = run(scores)
    assert newest.reference == 8 + 39 and said[-1] > 1


def test_frames_that_are_passed_over_keep_their_place_on_the_track():
    scores = drawn_scores(frames=30)
    evidence = TrackEvidence()
    for frame in range(30):
        rows = [
            None if frame - back in (12, 13, 20) else row
            for back, row in enumerate(newest_first(scores, frame))
        ]
        if rows[0] is not None:
            newest = update(evidence, frame, rows)
            assert frame < TRACK.window or newest.reference == 8 + frame
    whole = run(scores)[-1][-1]
    assert 0.7 * whole < evidence.evidence(29, 8 + 29) < whole


def test_frames_are_forgotten_in_time():
    scores = drawn_scores(frames=20)
    evidence, _, said = run(scores)
    assert evidence.evidence(19, 27) == said[-1]
    nothing = np.full(PLACES, np.nan, np.float32)
    assert update(evidence, 19 + TRACK.memory, [nothing] * TRACK.window) is None
    assert evidence.evidence(19 + TRACK.memory, 27) == 0


def test_a_drive_at_another_velocity_is_followed_along_its_diagonal():
    scores = drawn_scores(frames=25, places=90, start=10, velocity=2.0)
    assert run(scores, velocity=2.0)[-1][-1] > 3
    assert run(scores)[-1][-1] < 2


def test_a_drive_backwards_is_followed_along_its_diagonal():
    scores = drawn_scores(frames=25, places=90, start=80, velocity=-2.0)
    assert run(scores, velocity=-2.0)[-1][-1] > 3
    assert run(scores)[-1][-1] < 2


def test_a_map_that_grows_is_compared_as_far_as_it_goes():
    scores = drawn_scores(frames=40, start=-20)
    evidence = TrackEvidence()
    for frame in range(20, 40):
        rows = [scores[frame - back][: frame - back + 10] for back in range(frame - 19)]
        newest = update(evidence, frame, rows[: TRACK.window])
    assert newest.reference == 19 and evidence.evidence(39, 19) > 1


def test_an_uninformative_frame_says_nothing():
    with pytest.raises(ValueError, match='informative'):
        update(TrackEvidence(), 0, [None])


def listed(scores, frame, known, length=20):
    """Fill in the scores of the likeliest diagonals, as a shortlist would; return their ends."""
    means = [
        np.mean([scores[frame - back, place - back] for back in range(min(place, frame, 9) + 1)])
        for place in range(scores.shape[1])
    ]
    noise = np.random.default_rng(frame).normal(0, 0.01, len(means))
    ends = np.sort(np.argsort(means + noise)[-length:])
    for place in ends:
        for back in range(min(place, frame, 9) + 1):
            known[frame - back, place - back] = scores[frame - back, place - back]
    return ends


@pytest.mark.parametrize('contrast', [0.0, 0.2, 0.3])
def test_a_shortlist_gives_the_decisions_of_whole_rows(contrast):
    agreed = compared = 0
    for seed in range(4):
        scores = drawn_scores(frames=40, contrast=contrast, seed=seed)
        *_, whole = run(scores)
        known = np.full_like(scores, np.nan)
        evidence = TrackEvidence()
        for frame in range(40):
            listed(scores, frame, known)
            newest = update(evidence, frame, newest_first(known, frame))
            if whole[frame] is not None and frame > 15:
                short = evidence.evidence(frame, newest.reference)
                compared += 1
                agreed += (short >= 1) == (whole[frame] >= 1)
    assert compared == 96 and agreed > 0.95 * compared
