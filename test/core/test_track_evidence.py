# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Evidence that the last frames together give for a place."""

from convseq_ros.core.decision.track_evidence import MEMORY, TrackEvidence, WINDOW
from hypothesis import given, strategies
import numpy as np
import pytest

PLACES = 60
FLOOR = 0.001


def drawn_scores(frames=40, places=PLACES, start=8, contrast=0.3, seed=0, slope=1.0):
    """Return pair scores like coherent ones, with a true diagonal from reference `start`."""
    scores = np.random.default_rng(seed).uniform(0.08, 0.2, (frames, places)).astype(np.float32)
    for frame in range(frames):
        place = round(start + slope * frame)
        if 0 <= place < places:
            scores[frame, place] += contrast
    return scores


def newest_first(scores, frame, memory=25):
    return [scores[frame - back] for back in range(min(frame + 1, memory))]


def follow(evidence, frame, rows, slope=1.0, ends=None):
    return evidence.follow(
        frame,
        rows,
        np.arange(PLACES if rows[0] is None else len(rows[0])) if ends is None else ends,
        slope,
    )


def run(scores, evidence=None, slope=1.0):
    """Return the last sight of a drive, and what was said of each frame's best reference."""
    evidence = evidence or TrackEvidence()
    said = []
    for frame in range(len(scores)):
        sight = follow(evidence, frame, newest_first(scores, frame), slope)
        said.append(evidence.evidence(frame, sight.reference, slope) if sight else None)
    return evidence, sight, said


def slowly(scores):
    """Return the last evidence, worked out loop by loop as the documentation says."""
    frames, places = scores.shape
    sights, variances, learnt, start = [], [], scores.copy(), None
    for frame in range(frames):
        past = learnt[:frame]
        overall = np.nanmean(past) if np.isfinite(past).any() else 0.0
        usual = [
            (np.nansum(past[:, place]) + 5 * overall) / (np.isfinite(past[:, place]).sum() + 5)
            for place in range(places)
        ]
        window = min(frame + 1, 8)
        height = {}
        for place in range(places):
            met = []
            for back in range(window):
                row = scores[frame - back] - usual
                if place >= back and np.isfinite(row[place - back]):
                    met.append(row[place - back] - np.nanmean(row[: places - back]))
            if 2 * len(met) >= window:
                height[place] = sum(met) / 8
        best = max((one for one in height if np.isfinite(scores[frame, one])), key=height.get)
        far = [value for place, value in height.items() if abs(place - best) > 10]
        off_peak = [value for place, value in height.items() if abs(place - best) > 5]
        if len(far) >= 8 and window == 8:
            variances.append(np.var(far))
        variance = (sum(variances) + 2 * 0.006**2) / (len(variances) + 2)
        scatter = np.sqrt(variance) + FLOOR
        chance = 6 * scatter / np.sqrt(len(far)) if variances else 0.0
        inside = best < places - 2 and len(far) >= 8
        start = frame if start is None and len(far) >= 8 else start
        margin = max(0.0, height[best] - max(off_peak) - chance) if inside else 0.0
        sights.append((frame, best, margin))
        lately = [abs((best - frame) - (place - then)) <= 2 for then, place, _ in sights[-8:]]
        if sum(lately) >= 4:
            learnt[frame, max(0, best - 10) : best + 11] = np.nan
    frame, best, _ = sights[-1]
    on_track = [
        margin for then, place, margin in sights[-30:] if abs((best - frame) - (place - then)) <= 2
    ]
    along = sum(on_track) / (min(frames - start, 30) * scatter)
    now = scores[-1] - usual
    others = [now[place] for place in range(places) if abs(place - best) > 10]
    near = np.nanmax(now[max(0, best - 2) : best + 3])
    return min(along, (near - np.nanmean(others)) / (np.nanstd(others) + FLOOR))


@pytest.mark.parametrize('known', [1.0, 0.6])
@pytest.mark.parametrize('contrast', [0.05, 0.3])
def test_it_is_what_loops_over_all_frames_and_places_give(known, contrast):
    scores = drawn_scores(frames=32, contrast=contrast)
    missing = np.random.default_rng(5).random(scores.shape) > known
    missing[:, 0] = False
    scores[missing] = np.nan
    assert run(scores)[-1][-1] == pytest.approx(slowly(scores), rel=1e-5)


def test_one_frame_by_hand():
    row = np.full(40, 0.1, np.float32)
    row[20], row[22], row[30] = 0.5, 0.4, 0.2
    evidence = TrackEvidence()
    sight = follow(evidence, 7, [row])
    assert (sight.frame, sight.reference, sight.rivals) == (7, 20, 19)
    assert sight.margin == pytest.approx((0.5 - 0.2) / WINDOW)
    assert evidence.scatter is None and evidence.evidence(7, 20) is None


def test_it_grows_along_the_track_and_falls_when_the_track_is_left():
    scores = drawn_scores(frames=30, start=10)
    scores[20:] = drawn_scores(frames=10, contrast=0.0, seed=3)
    said = run(scores)[-1]
    assert said[WINDOW - 2] is None and said[WINDOW - 1] > 2
    assert min(said[WINDOW:20]) > 4
    assert said[-1] < 0.3 * said[19]


def test_a_road_that_forks_is_left_at_once():
    scores = drawn_scores(frames=30)
    scores[20:] = drawn_scores(frames=10, contrast=0.0, seed=3)
    evidence = TrackEvidence()
    said = []
    for frame in range(30):
        sight = follow(evidence, frame, newest_first(scores, frame))
        said.append(evidence.evidence(frame, 8 + frame))
        assert sight.reference == 8 + frame or frame > 22
    assert min(said[12:20]) > 4
    assert max(said[20:]) < 2 and sum(value >= 1.6 for value in said[20:]) <= 1


def test_places_that_were_never_there_give_little():
    for seed in range(5):
        said = run(drawn_scores(frames=60, contrast=0.0, seed=seed))[-1]
        assert max(value for value in said if value is not None) < 0.5


def test_a_peak_at_the_rim_of_the_map_is_none():
    scores = drawn_scores(frames=30, start=PLACES - 25)
    evidence = TrackEvidence()
    sights = [follow(evidence, one, newest_first(scores, one)) for one in range(25)]
    assert [sight.reference for sight in sights[-3:]] == [PLACES - 3, PLACES - 2, PLACES - 1]
    assert sights[-3].margin > 0 and sights[-2].margin == sights[-1].margin == 0


def test_a_drive_that_left_the_map_does_not_creep_towards_its_end():
    scores = drawn_scores(frames=45, start=PLACES - 36)
    for frame in range(36, 45):
        scores[frame, PLACES - 1] += 0.3
    evidence = TrackEvidence()
    for frame in range(45):
        follow(evidence, frame, newest_first(scores, frame), 0.67)
    assert evidence.evidence(44, PLACES - 1, 0.67) == 0
    assert evidence.evidence(44, PLACES - 3, 0.67) > 0


def test_too_few_rivals_are_no_rivals():
    scores = drawn_scores(frames=20, places=15, start=0)
    evidence = TrackEvidence()
    sights = [follow(evidence, one, newest_first(scores, one)) for one in range(12)]
    assert not any(sight.enough_rivals for sight in sights[4:])
    assert all(sight.margin == 0 for sight in sights[4:])


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
    one, sight, said = run(scores)
    other, scaled_sight, scaled = run(scale * scores)
    assert scaled_sight.margin == pytest.approx(scale * sight.margin, rel=0.1)
    assert 0 < (other.scatter - one.scatter) * (scale - 1) or scale == 1
    assert scaled[-1] == pytest.approx(said[-1], rel=0.35)


def test_a_place_that_always_scores_high_is_not_preferred():
    scores = drawn_scores(frames=40, contrast=0.1)
    scores[:, 50] += 0.3
    _, sight, said = run(scores)
    assert sight.reference == 8 + 39 and said[-1] > 1


def test_frames_that_are_passed_over_keep_their_place_on_the_track():
    scores = drawn_scores(frames=30)
    evidence = TrackEvidence()
    for frame in range(30):
        rows = [
            None if frame - back in (12, 13, 20) else row
            for back, row in enumerate(newest_first(scores, frame))
        ]
        if rows[0] is not None:
            sight = follow(evidence, frame, rows)
            assert frame < WINDOW or sight.reference == 8 + frame
    whole = run(scores)[-1][-1]
    assert 0.7 * whole < evidence.evidence(29, 8 + 29) < whole


def test_frames_are_forgotten_in_time():
    scores = drawn_scores(frames=20)
    evidence, _, said = run(scores)
    assert evidence.evidence(19, 27) == said[-1]
    nothing = np.full(PLACES, np.nan, np.float32)
    assert follow(evidence, 19 + MEMORY, [nothing] * WINDOW) is None
    assert evidence.evidence(19 + MEMORY, 27) == 0


def test_a_drive_at_another_speed_is_followed_along_its_slope():
    scores = drawn_scores(frames=25, places=90, start=10, slope=2.0)
    assert run(scores, slope=2.0)[-1][-1] > 3
    assert run(scores)[-1][-1] < 2


def test_a_map_that_grows_is_compared_as_far_as_it_goes():
    scores = drawn_scores(frames=40, start=-20)
    evidence = TrackEvidence()
    for frame in range(20, 40):
        rows = [scores[frame - back][: frame - back + 10] for back in range(frame - 19)]
        sight = follow(evidence, frame, rows[:WINDOW])
    assert sight.reference == 19 and evidence.evidence(39, 19) > 1


def test_an_uninformative_frame_says_nothing():
    with pytest.raises(ValueError, match='informative'):
        follow(TrackEvidence(), 0, [None])


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
            sight = follow(evidence, frame, newest_first(known, frame))
            if whole[frame] is not None and frame > 15:
                short = evidence.evidence(frame, sight.reference)
                compared += 1
                agreed += (short >= 1) == (whole[frame] >= 1)
    assert compared == 96 and agreed > 0.95 * compared
