# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Three ways to ask: closed, open set, online.

Closed: every query has an answer. Open: half of the map is removed, so that for some queries "not
in the map" is right. Online: a drive against its own past.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

from convseq_ros.core.sequence.diagonals import BACKWARD
from convseq_ros.core.types import Match
from convseq_ros.evaluation.drive import Drive
from convseq_ros.evaluation.material import Material
from convseq_ros.evaluation.methods import Method, PairScores
from convseq_ros.evaluation.recognition import answer_again, past_only, recognize
from convseq_ros.evaluation.sequence_matching import choose_lengths, decide_frames, score_sequences
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
        Which half of the map was kept; empty with the whole map.
    query : Drive
        The Q frames.
    pairs : PairScores
        Scores of single frames, and times.
    frame_ms : float or None
        Median time of a frame, where it was measured.
    durations_ms : list of M floats, or None
        The same of every frame.

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
    matches, scores = _answers(material, method, pairs, (0, len(reference)))
    outcome = _whole_map(CLOSED, material, method, pairs, matches, scores)
    if pairs.encode_ms is None or pairs.row_ms is None:
        return outcome
    return replace(outcome, frame_ms=pairs.encode_ms + pairs.row_ms)


def open_set(material: Material, method: Method) -> Outcome:
    """
    Return the answers with the first, the last and the middle half of the map kept in turn.

    The recogniser's answers are those with that half; scores beside them are of the whole map.
    """
    pairs = method.rows(material)
    query, reference = material.drives(method.config.encoding)
    matches: list[Match] = []
    scores, right, reach = [], [], []
    spans = kept_halves(len(reference))
    for first, last in spans.values():
        found, score = _answers(material, method, pairs, (first, last))
        matches += found
        scores.append(score)
        kept = np.zeros_like(material.truth.right)
        kept[:, first:last] = material.truth.right[:, first:last]
        right.append(kept)
        reach.append(in_reach(kept[:, first:last], found, method.kind.direction))
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
    )


def online(material: Material, method: Method) -> Outcome:
    """Return the answers of a drive to itself: each frame may match what is past for long."""
    if method.kind.recognizer:
        return _afresh(ONLINE, material, method)
    query, _ = material.drives(method.config.encoding)
    pairs = method.rows(material)
    past = max(1, material.data_set.exclude_recent)
    known = replace(pairs, scores=past_only(pairs.scores, past))
    matches, scores = _answers(material, method, known, (0, len(query)))
    return _whole_map(ONLINE, material, method, pairs, matches, scores)


def kept_halves(count: int) -> Mapping[str, Span]:
    """Return the half-open spans of the references that are kept."""
    half, quarter = count // 2, count // 4
    return {'first': (0, half), 'last': (count - half, count), 'middle': (quarter, quarter + half)}


def _lengths(material: Material, method: Method) -> list[int]:
    query, _ = material.drives(method.config.encoding)
    return choose_lengths(query, method.config.sequence, method.kind.direction, material.cache)


def in_reach(
    right: npt.NDArray[np.bool_], matches: Sequence[Match], direction: int = BACKWARD
) -> npt.NDArray[np.bool_]:
    """
    Return which queries have a right reference whose whole sequence lies in the map.

    Parameters
    ----------
    right : ndarray of bool, shape (Q, R)
        Which references of the map are right.
    matches : sequence of Q Match
        Their k; 0 is never in reach.
    direction : BACKWARD or FORWARD
        Whether the k frames lie before or after the query.

    """
    lengths = np.array([match.sequence_length for match in matches])[:, None]
    index = np.arange(right.shape[1])
    inside = index >= lengths - 1 if direction == BACKWARD else index <= index.size - lengths
    return np.asarray((right & inside & (lengths > 0)).any(axis=1))


def _afresh(protocol: str, material: Material, method: Method) -> Outcome:
    """Return what the recogniser says, frame by frame."""
    query, _ = material.drives(method.config.encoding)
    found = recognize(material, method.config)
    lengths = [match.sequence_length for match in found.matches]
    scores = score_sequences(found.rows, query, lengths, partial_windows=_leaves_the_map(method))
    frame_ms = float(np.median(found.durations_ms))
    pairs = PairScores(found.rows, query.encode_ms, max(0.0, frame_ms - query.encode_ms))
    outcome = _whole_map(protocol, material, method, pairs, found.matches, scores)
    return replace(outcome, frame_ms=frame_ms, durations_ms=found.durations_ms)


def _whole_map(
    protocol: str,
    material: Material,
    method: Method,
    pairs: PairScores,
    matches: list[Match],
    scores: npt.NDArray[np.float64],
) -> Outcome:
    query, _ = material.drives(method.config.encoding)
    truth = material.truth
    reach = in_reach(truth.right, matches, method.kind.direction)
    return Outcome(
        protocol, matches, scores, truth.right, truth.slip, reach, [''] * len(query), query, pairs
    )


def _answers(
    material: Material, method: Method, pairs: PairScores, span: Span
) -> tuple[list[Match], npt.NDArray[np.float64]]:
    query, reference = material.drives(method.config.encoding)
    first, last = span
    kept = slice(first, last)
    again = None
    if method.kind.recognizer:
        again = answer_again(material, method.config, *span)
    lengths = (
        _lengths(material, method) if again is None else [match.sequence_length for match in again]
    )
    found = score_sequences(
        pairs.scores[:, kept],
        query,
        lengths,
        method.kind.direction,
        pairs.scorer,
        _leaves_the_map(method),
    )
    places = reference.reference_map.places[kept]
    matches = again or decide_frames(found, query, places, lengths, method.config)
    scores = np.full(pairs.scores.shape, -np.inf)
    scores[:, kept] = found
    return [_moved(match, first) for match in matches], scores


def _leaves_the_map(method: Method) -> bool:
    return method.kind.recognizer and method.config.matching.matching == 'coherent'


def _moved(match: Match, offset: int) -> Match:
    candidates = tuple(
        replace(one, reference_index=one.reference_index + offset) for one in match.candidates
    )
    return replace(match, candidates=candidates)
