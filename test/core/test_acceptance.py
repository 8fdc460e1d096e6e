# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Candidates and the decision between them."""

from dataclasses import replace

from convseq_ros.config import (
    AcceptanceConfig,
    Config,
    EncodingConfig,
    EVERY_FRAME,
    MatchingConfig,
    SequenceConfig,
)
from convseq_ros.core.decision.acceptance import Acceptance
from convseq_ros.core.decision.candidates import best_candidates
from convseq_ros.core.decision.confidence import confidence, Judgement
from convseq_ros.core.decision.margin import decide_by_margin
from convseq_ros.core.decision.track_evidence import TRACK
from convseq_ros.core.encoding.descriptor import describe
from convseq_ros.core.encoding.regions import projected_regions
from convseq_ros.core.map.place import pack_cells, Place
from convseq_ros.core.map.reference_map import ReferenceMap
from convseq_ros.core.recognizer import PlaceRecognizer
from convseq_ros.core.sequence.diagonals import sequence_scores
from convseq_ros.core.sequence.length import choose_length
from convseq_ros.core.similarity.coherent import extract
from convseq_ros.core.similarity.kernels.numpy_coherent import coherent_score
from convseq_ros.core.similarity.paper_similarity import PaperSimilarity
from convseq_ros.core.types import Candidate, Frame, Reason, Status
import cv2
import numpy as np
import pytest

RULE = AcceptanceConfig(min_margin=0.01, rival_distance=2, num_candidates=3)
BY_TRACK = AcceptanceConfig(acceptance_rule='track')
SMALL = EncodingConfig(image_size_px=256)
PLACES = 60


def candidates(scores, config=RULE, **of):
    places = [Place(1000 + index) for index in range(len(scores))]
    return best_candidates(np.arange(len(scores)), np.array(scores, float), places, config, **of)


def test_candidates_come_best_first_without_neighbours():
    found = candidates([0.1, 0.8, 0.9, 0.85, 0.2, 0.3, 0.7])
    assert [each.reference_index for each in found] == [2, 6]
    assert found[0] == Candidate(2, 1002, 0.9)


def test_of_single_frames_the_middle_of_a_peak_is_told():
    # What lies above .7 of 1: .05, .2, .1, .25, .3 at places 1 to 5, whose middle is 3.7.
    scores = [0.2, 0.75, 0.9, 0.8, 0.95, 1.0, 0.2, 0.2, 0.2, 0.2, 0.9]
    assert [one.reference_index for one in candidates(scores)] == [5, 2, 10]
    found = candidates(scores, of_single=True)
    assert [one.reference_index for one in found] == [4, 2, 10]
    assert found[0] == Candidate(4, 1004, 0.95)
    assert candidates([0.0] * 5, of_single=True)[0].reference_index == 0


def test_no_more_candidates_than_asked_for():
    assert len(candidates(np.linspace(0, 1, 50))) == 3


def test_places_without_score_are_no_candidates():
    assert candidates([-np.inf] * 5) == ()
    assert len(candidates([-np.inf, -np.inf, 0.5])) == 1


@pytest.mark.parametrize(
    ('scores', 'reason'),
    [
        ([0.9, 0, 0, 0.88], Reason.ACCEPTED),
        ([0.9, 0, 0, 0.895], Reason.AMBIGUOUS),
        ([0.9, 0.899, 0.1, 0.2], Reason.ACCEPTED),
        ([0.9, 0.8, 0.1], Reason.TOO_FEW_RIVALS),
    ],
)
def test_the_margin_to_the_best_rival_decides(scores, reason):
    found = candidates(scores)
    assert decide_by_margin(found, RULE) is reason
    rows = [np.array(scores, np.float32)]
    assert judged(accepting('regional'), 0, rows, found, RULE) == Judgement(reason)


def accepting(matching, rule='auto'):
    """Return an acceptance for a way of matching."""
    settings = AcceptanceConfig(acceptance_rule=rule)
    return Acceptance(Config(matching=MatchingConfig(matching=matching), acceptance=settings))


def judged(acceptance, frame, rows, found, config):
    acceptance.update(frame, rows, np.arange(len(rows[0])), 10)
    return acceptance.judge(found, config)


@pytest.mark.parametrize(
    ('matching', 'rule', 'by_track'),
    [
        ('coherent', 'auto', True),
        ('regional', 'auto', False),
        ('coherent', 'margin', False),
        ('regional', 'track', True),
    ],
)
def test_the_rule_follows_the_matching_unless_it_is_chosen(matching, rule, by_track):
    assert (accepting(matching, rule).window > 1) is by_track


def drawn_scores(frames, seed=0, contrast=0.3, places=PLACES):
    """Return pair scores like coherent ones; frame t shows reference t + 5."""
    scores = np.random.default_rng(seed).uniform(0.08, 0.2, (frames, places)).astype(np.float32)
    for frame in range(frames):
        scores[frame, frame + 5] += contrast
    return scores


def verdicts(scores, config=BY_TRACK, acceptance=None, said=None):
    """Judge a drive whose best candidate is the true one, or the reference that is `said`."""
    acceptance = acceptance or accepting('coherent')
    found = []
    for frame in range(len(scores)):
        rows = [scores[frame - back] for back in range(min(frame + 1, 12))]
        best = Candidate(frame + 5 if said is None else said, 0, 0.3)
        found.append(judged(acceptance, frame, rows, (best,), config))
    return found


def test_a_true_track_is_accepted_once_it_stands_out_long_enough():
    found = verdicts(drawn_scores(30))
    assert {one.reason for one in found[: TRACK.window - 1]} == {Reason.WEAK}
    assert {one.reason for one in found[TRACK.window - 1 :]} == {Reason.ACCEPTED}
    assert [one.confidence for one in found[: TRACK.window - 1]] == [None] * (TRACK.window - 1)
    assert all(one.confidence > 0.7 for one in found[TRACK.window - 1 :])


def test_a_candidate_off_the_track_is_inconsistent_and_unlikely():
    found = verdicts(drawn_scores(30), said=50)
    assert {one.reason for one in found[10:]} == {Reason.INCONSISTENT}
    assert all(one.confidence < 0.05 for one in found[10:])


def test_a_candidate_next_to_the_track_is_on_it():
    found = verdicts(drawn_scores(25), said=25)
    assert [one.reason is Reason.ACCEPTED for one in found[17:24]] == [
        False,
        True,
        True,
        True,
        True,
        True,
        False,
    ]


def test_more_evidence_may_be_asked_for():
    strict = replace(BY_TRACK, min_evidence=1000.0)
    assert {one.reason for one in verdicts(drawn_scores(30), strict)[9:]} == {Reason.WEAK}


def test_a_frame_that_stands_out_less_than_other_places_scatter_is_ambiguous():
    scores = drawn_scores(30, contrast=0.0)
    acceptance = accepting('coherent')
    reasons = set()
    for frame in range(30):
        rows = [scores[frame - back] for back in range(min(frame + 1, 12))]
        ahead = sequence_scores(rows[:10])
        best = Candidate(int(ahead.argmax()), 0, 0.2)
        reasons.add(judged(acceptance, frame, rows, (best,), BY_TRACK).reason)
    assert Reason.AMBIGUOUS in reasons and Reason.ACCEPTED not in reasons


def test_a_map_too_small_to_compare_in_says_so():
    found = verdicts(drawn_scores(10, places=15))
    assert {one.reason for one in found[3:]} == {Reason.TOO_FEW_RIVALS}


def test_frames_before_the_sequence_is_long_enough_count_as_evidence():
    scores = drawn_scores(15)
    acceptance = accepting('coherent')
    for frame in range(14):
        rows = [scores[frame - back] for back in range(frame + 1)]
        acceptance.update(frame, rows, np.arange(PLACES), 10)
    rows = [scores[14 - back] for back in range(15)]
    best = Candidate(19, 0, 0.3)
    assert judged(acceptance, 14, rows, (best,), BY_TRACK).reason is Reason.ACCEPTED


def test_after_a_reset_evidence_is_gathered_anew():
    scores = drawn_scores(20)
    acceptance = accepting('coherent')
    first = verdicts(scores, acceptance=acceptance)
    acceptance.reset()
    assert verdicts(scores, acceptance=acceptance) == first


def test_confidence_rises_with_evidence_and_is_a_probability():
    for share in (0.0, 0.5, 1.0):
        said = [confidence(one, share) for one in (-0.5, 0.0, 0.1, 0.5, 1.0, 2.0, 5.0, 1000.0)]
        assert said == sorted(said) and 0 <= said[0] and said[-1] <= 1
    assert confidence(0.0, 0.1) < 0.05 and 0.6 < confidence(1.5, 0.1) < 0.7
    # What is dark says little, but the same again and again.
    assert confidence(0.1, 0.2) < 0.1 and confidence(0.1, 0.9) > 0.85
    # Where one side of a street repeats, the other side tells.
    assert confidence(4.0, 0.8) > 0.99 and confidence(4.0, 0.8, balance=0.35) < 0.6


def image(place, seed=0):
    rng = np.random.default_rng(place)
    coarse = cv2.resize(rng.random((20, 20)).astype(np.float32), (160, 120))
    return ((coarse + np.random.default_rng([place, seed]).random((120, 160)) / 2) * 150).astype(
        np.uint8
    )


@pytest.fixture(scope='module')
def reference_map():
    made = ReferenceMap(SMALL, keyframes=EVERY_FRAME)
    for place in range(PLACES):
        made.add(Place(place), pack_cells(describe(image(place), SMALL).cells))
    return made


@pytest.fixture(params=['exhaustive', 'shortlist'])
def coherent(request):
    return Config(
        encoding=SMALL,
        matching=MatchingConfig(matching='coherent', search=request.param),
        sequence=SequenceConfig(fixed_length=4),
    )


def drive(recognizer, places, start=0):
    return [
        recognizer.process(Frame(start + index, None if place is None else image(place, seed=1)))
        for index, place in enumerate(places)
    ]


def test_a_known_stretch_is_accepted_and_an_unknown_one_is_not(reference_map, coherent):
    recognizer = PlaceRecognizer(reference_map, coherent)
    matches = drive(recognizer, [*range(1000, 1015), *range(15, 40), *range(2000, 2020)])
    for match in matches[21:40]:
        assert match.accepted.reference_index == match.query_index
        assert match.confidence > 0.7
    assert not any(match.accepted for match in matches[:15])
    assert sum(match.accepted is not None for match in matches[40:]) <= 2
    decided = {match.reason for match in matches[12:15] + matches[50:] if not match.accepted}
    assert decided <= {Reason.AMBIGUOUS, Reason.WEAK, Reason.INCONSISTENT, Reason.TOO_FEW_RIVALS}


def test_unreadable_frames_do_not_break_a_track(reference_map, coherent):
    places = list(range(10, 40))
    places[18] = places[19] = None
    matches = drive(PlaceRecognizer(reference_map, coherent), places)
    assert [match.status for match in matches[18:20]] == [Status.SKIPPED] * 2
    for match in matches[22:]:
        assert match.accepted.reference_index == 10 + match.query_index


def test_a_recogniser_that_starts_anew_forgets_the_track(reference_map, coherent):
    by_track = replace(coherent, acceptance=replace(coherent.acceptance, verification=False))
    recognizer = PlaceRecognizer(reference_map, by_track)
    first = drive(recognizer, range(10, 30))
    recognizer.reset()
    again = drive(recognizer, range(10, 30), start=100)
    early = slice(TRACK.window - 1)
    assert [match.reason for match in again][early] == [match.reason for match in first][early]
    assert not any(match.accepted for match in again[early]) and again[-1].accepted


def accepted_of(scores, lengths, truth):
    """Return how many matches are accepted right, wrong, and could be, of a drive's scores."""
    acceptance = accepting('coherent')
    right = wrong = answerable = 0
    for frame, length in enumerate(lengths):
        row = scores[frame]
        if not np.isfinite(row).any():
            continue
        rows = [
            each if np.isfinite(each).any() else None
            for each in (scores[frame - back][: len(row)] for back in range(min(frame, 24) + 1))
        ]
        ends = np.arange(len(row))
        acceptance.update(frame, rows, ends, 10)
        if not length:
            continue
        places = [Place(index) for index in range(len(row))]
        scores_of_ends = sequence_scores(rows[:length], partial=True)
        found = best_candidates(ends, scores_of_ends, places, BY_TRACK)
        answerable += any(length - 1 <= place < len(row) for place in truth[frame])
        if found and acceptance.judge(found, BY_TRACK).reason is Reason.ACCEPTED:
            near = min(
                (abs(found[0].reference_index - place) for place in truth[frame]), default=99
            )
            right += near <= 2
            wrong += near > 5
    return right, wrong, answerable


def test_half_of_the_corridor_is_told_from_the_other_half(shared_data):
    scores = np.load(shared_data / 'coherent' / 'corridor_scores.npy', allow_pickle=False)
    lengths = [0] * 9 + [10] * 102
    total = np.zeros(3)
    for first in (0, 28, 56):
        truth = [[frame - first] for frame in range(111)]
        total += accepted_of(scores[:, first : first + 55], lengths, truth)
    right, wrong, answerable = total
    assert wrong == 0 and right > 0.6 * answerable


def test_revisits_of_a_loop_are_accepted_online(shared_data):
    folder = shared_data / 'rtabmap84'
    grays = (cv2.imread(str(folder / f'{number}.jpg')) for number in range(1, 85))
    drive = [describe(cv2.cvtColor(gray, cv2.COLOR_BGR2GRAY)) for gray in grays]
    queries = [extract(one, 4.0) if one.informative else None for one in drive]
    regions = [projected_regions(one.cells) if one.cells.any() else None for one in drive]
    scores = [
        np.array(
            [
                coherent_score(query, regions[past])[0]
                if query and regions[past] is not None
                else np.nan
                for past in range(max(0, now - 20))
            ],
            np.float32,
        )
        for now, query in enumerate(queries)
    ]
    similarity = PaperSimilarity()
    lengths = [
        choose_length(drive[now::-1][:25], similarity, SequenceConfig()) if query else None
        for now, query in enumerate(queries)
    ]
    truth = [[] for _ in drive]
    for line in (folder / 'loops_gt.csv').read_text().splitlines()[1:]:
        now, past, _ = map(int, line.split(','))
        truth[now - 1].append(past - 1)
    right, wrong, _ = accepted_of(scores, lengths, truth)
    assert wrong == 0 and right >= 35


@pytest.mark.parametrize('search', ['shortlist', 'exhaustive'])
def test_rivals_lie_as_far_apart_as_is_asked_from_the_next_frame_on(image, search):
    """A value set before the first frame is that of a start; candidates obey at once."""
    made = ReferenceMap(SMALL, keyframes=EVERY_FRAME)
    for place in range(PLACES):
        made.add(Place(place), pack_cells(describe(image(place), SMALL).cells))
    config = Config(
        encoding=SMALL,
        matching=MatchingConfig(search=search, shortlist_length=12),
        sequence=SequenceConfig(fixed_length=4),
    )
    far = replace(config, acceptance=AcceptanceConfig(rival_distance=25))
    started, changed, near = (PlaceRecognizer(made, one) for one in (far, config, config))
    changed.config = far
    frames = [Frame(index * 10**8, image(index + 10, 1)) for index in range(30)]
    said = [[one.process(frame) for frame in frames] for one in (started, changed, near)]
    assert said[0] == said[1]
    assert [one.confidence for one in said[0]] != [one.confidence for one in said[2]]
    changed.config = config
    candidates = changed.process(Frame(30 * 10**8, image(40, 1))).candidates
    places = sorted(one.reference_index for one in candidates)
    assert len(places) > 1 and min(np.diff(places)) > 10
