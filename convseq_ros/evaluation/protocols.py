# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Three ways to ask: closed, open set, online.

Closed: every query has an answer. Open: a part of the map is removed, so that for some queries
"not in the map" is right. Online: a drive against its own past.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

from convseq_ros.core.map.reference_map import ReferenceMap
from convseq_ros.core.types import Match
from convseq_ros.evaluation.drive import Drive
from convseq_ros.evaluation.geometry import Dots, NO_DOTS
from convseq_ros.evaluation.given_scores import match_given
from convseq_ros.evaluation.material import Material
from convseq_ros.evaluation.methods import Method
from convseq_ros.evaluation.pair_scores import PairScores
from convseq_ros.evaluation.peers import matches_of
from convseq_ros.evaluation.ranking import rank_references
from convseq_ros.evaluation.recognition import answer_again, past_only, recognize, with_known
from convseq_ros.evaluation.rerun import part_of
import numpy as np
import numpy.typing as npt

CLOSED, OPEN, ONLINE = 'closed', 'open', 'online'
Span = tuple[int, int]


@dataclass(frozen=True)
class Outcome:
    """
    What a method said, frame by frame; M is Q, or three times Q with half of the map removed.

    Parameters
    ----------
    protocol : str
        closed, open or online.
    matches : list of M Match
        Its answers; indices of references are those of the whole map.
    sequence_scores : ndarray of float64, shape (M, R)
        -inf where there is none.
    right, slip : ndarray of bool, shape (M, R)
        Which references are right, and which the right place but a little off.
    reach : ndarray of bool, shape (M,)
        Whether the whole sequence of a right answer lies in the map.
    halves : list of M str
        Which part of the map was kept; empty with the whole map.
    query : Drive
        The Q frames.
    pairs : PairScores
        Scores of single frames, and times.
    frame_ms : float or None
        Median time of a frame, where it was measured.
    durations_ms : list of M floats, or None
        The same of every frame.
    way_m : ndarray of float64, shape (Q,), or None
        How far along its way each frame was taken, if that is known.
    fields : sequence of M uint8 arrays (n, 4)
        The inliers of each best candidate, as `Dots`; empty where nothing was verified.

    """

    protocol: str
    matches: list[Match]
    sequence_scores: npt.NDArray[np.float64]
    right: npt.NDArray[np.bool_]
    slip: npt.NDArray[np.bool_]
    reach: npt.NDArray[np.bool_]
    halves: list[str]
    query: Drive
    pairs: PairScores
    frame_ms: float | None = None
    durations_ms: Sequence[float] | None = None
    way_m: npt.NDArray[np.float64] | None = None
    fields: Sequence[Dots] = ()


def closed(material: Material, method: Method, afresh: bool = True) -> Outcome:
    """
    Return the answers with the whole map.

    Unless `afresh`, the recogniser is fed with pair scores of an earlier pass, which gives the
    same answers sooner.
    """
    if method.kind.recognizer and afresh:
        return _afresh(CLOSED, material, method)
    _, reference = material.drives(method.config.encoding)
    pairs = method.rows(material)
    matches, scores, dots = _answers(material, method, pairs, (0, len(reference)))
    outcome = _whole_map(CLOSED, material, method, pairs, matches, scores, dots)
    if pairs.encode_ms is None or pairs.row_ms is None:
        return outcome
    return replace(outcome, frame_ms=pairs.encode_ms + pairs.row_ms)


def open_set(material: Material, method: Method, keep: float | None = None) -> Outcome:
    """
    Return the answers with the first, the last and the middle half of the map kept in turn.

    With `keep`, a share in (0, 1), the first so much of the map is kept instead. The recogniser's
    answers are those with that part; scores beside them are of the whole map.
    """
    pairs = method.rows(material)
    query, reference = material.drives(method.config.encoding)
    matches: list[Match] = []
    fields: list[Dots] = []
    scores, right, reach = [], [], []
    spans = kept_halves(len(reference))
    if keep is not None:
        spans = {'first': (0, round(keep * len(reference)))}
    for first, last in spans.values():
        found, score, dots = _answers(material, method, pairs, (first, last))
        matches += found
        fields += dots
        scores.append(score)
        kept = np.zeros_like(material.truth.right)
        kept[:, first:last] = material.truth.right[:, first:last]
        right.append(kept)
        reach.append(in_reach(kept[:, first:last], found, method.kind.forward))
    return Outcome(
        OPEN,
        matches,
        np.concatenate(scores),
        np.concatenate(right),
        np.concatenate([material.truth.slip] * len(spans)),
        np.concatenate(reach),
        [half for half in spans for _ in range(len(query))],
        query,
        pairs,
        way_m=material.way_m,
        fields=fields,
    )


def online(material: Material, method: Method) -> Outcome:
    """Return the answers of a drive to itself: each frame may match what is past for long."""
    if method.kind.recognizer:
        return _afresh(ONLINE, material, method)
    query, _ = material.drives(method.config.encoding)
    pairs = method.rows(material)
    past = max(1, material.data_set.exclude_recent)
    known = replace(pairs, scores=past_only(pairs.scores, past))
    matches, scores, dots = _answers(material, method, known, (0, len(query)))
    return _whole_map(ONLINE, material, method, pairs, matches, scores, dots)


def kept_halves(count: int) -> Mapping[str, Span]:
    """Return the half-open spans of the references that are kept."""
    half, quarter = count // 2, count // 4
    return {'first': (0, half), 'last': (count - half, count), 'middle': (quarter, quarter + half)}


def in_reach(
    right: npt.NDArray[np.bool_], matches: Sequence[Match], forward: bool = False
) -> npt.NDArray[np.bool_]:
    """
    Return which queries have a right reference whose whole sequence lies in the map.

    Parameters
    ----------
    right : ndarray of bool, shape (Q, R)
        Which references of the map are right.
    matches : sequence of Q Match
        Their k; 0 is never in reach.
    forward : bool
        Whether the k frames lie after the query, not before it.

    """
    lengths = np.array([match.sequence_length for match in matches])[:, None]
    index = np.arange(right.shape[1])
    inside = index <= index.size - lengths if forward else index >= lengths - 1
    return np.asarray((right & inside & (lengths > 0)).any(axis=1))


def _afresh(protocol: str, material: Material, method: Method) -> Outcome:
    """Return what the recogniser says, frame by frame."""
    query, _ = material.drives(method.config.encoding)
    found = recognize(material, method.config)
    lengths = [match.sequence_length for match in found.matches]
    scores = rank_references(found.rows, query, lengths, partial_windows=_leaves_the_map(method))
    frame_ms = float(np.median(found.durations_ms))
    pairs = PairScores(found.rows, query.encode_ms, max(0.0, frame_ms - query.encode_ms))
    said = found.matches, scores, found.fields
    outcome = _whole_map(protocol, material, method, pairs, *said)
    return replace(outcome, frame_ms=frame_ms, durations_ms=found.durations_ms)


def _whole_map(
    protocol: str,
    material: Material,
    method: Method,
    pairs: PairScores,
    matches: list[Match],
    scores: npt.NDArray[np.float64],
    fields: Sequence[Dots],
) -> Outcome:
    query, _ = material.drives(method.config.encoding)
    truth = material.truth
    reach = in_reach(truth.right, matches, method.kind.forward)
    halves = [''] * len(query)
    found = protocol, matches, scores, truth.right, truth.slip, reach, halves, query, pairs
    return Outcome(*found, way_m=material.way_m, fields=fields)


def _answers(
    material: Material, method: Method, pairs: PairScores, span: Span
) -> tuple[list[Match], npt.NDArray[np.float64], list[Dots]]:
    query, reference = material.drives(method.config.encoding)
    first, last = span
    kept, forward = pairs.scores[:, first:last], method.kind.forward
    if method.kind.recognizer:
        matches, dots = answer_again(material, method.config, first, last)
    else:
        part = part_of(reference.reference_map, first, last)
        matches = _given(kept, query, part, method, pairs, first)
        dots = [NO_DOTS] * len(matches)
    lengths = [match.sequence_length for match in matches]
    found = rank_references(kept, query, lengths, forward, pairs.scorer, _leaves_the_map(method))
    scores = np.full(pairs.scores.shape, -np.inf)
    scores[:, first:last] = found
    return [_moved(match, first) for match in matches], scores, dots


def _given(
    rows: npt.NDArray[np.float32],
    query: Drive,
    part: ReferenceMap,
    method: Method,
    pairs: PairScores,
    first: int,
) -> list[Match]:
    """Return the answers by given pair scores, or by the method's own decision or sequences."""
    if pairs.detect is not None:
        return matches_of(pairs.detect(rows, first), query, part)
    config, forward = method.config, method.kind.forward
    if pairs.scorer is None:
        return match_given(rows, query, part, config, forward)
    length = config.sequence.fixed_length
    lengths = [length * (index >= length - 1) for index in range(len(query))]
    own = rank_references(rows, query, lengths, forward, pairs.scorer)
    single = with_known(config, {'fixed_length': 1})
    scores = np.where(np.isfinite(own), own, np.nan).astype(np.float32)
    return [
        replace(match, sequence_length=length if match.candidates else 0)
        for match in match_given(scores, query, part, single, forward)
    ]


def _leaves_the_map(method: Method) -> bool:
    return method.kind.recognizer and method.config.believes


def _moved(match: Match, offset: int) -> Match:
    candidates = tuple(
        replace(one, reference_index=one.reference_index + offset) for one in match.candidates
    )
    return replace(match, candidates=candidates)
