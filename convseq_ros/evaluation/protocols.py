# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Three ways to ask: closed, open set, online.

Closed: every query has an answer. Open: half of the map is removed, so that for some queries "not
in the map" is right. Online: a drive against its own past.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

from convseq_ros.core.types import Match
from convseq_ros.evaluation.drive import Drive
from convseq_ros.evaluation.material import Material
from convseq_ros.evaluation.methods import Method, PairScores
from convseq_ros.evaluation.recognition import answer_again, past_only, recognize
from convseq_ros.evaluation.sequence_matching import (
    choose_lengths,
    decide_frames,
    score_sequences,
)
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
    query, reference = material.drives(method.config.encoding)
    truth = material.truth
    if method.kind.recognizer and afresh:
        found = recognize(material, method.config)
        lengths = [match.sequence_length for match in found.matches]
        scores = score_sequences(found.rows, query, lengths)
        row_ms = max(0.0, float(np.median(found.durations_ms)) - query.encode_ms)
        pairs = PairScores(found.rows, query.encode_ms, row_ms)
        return Outcome(
            CLOSED, found.matches, scores, truth.right, truth.slip, [''] * len(query), query,
            pairs, float(np.median(found.durations_ms)), found.durations_ms,
        )  # fmt: skip
    pairs = method.rows(material)
    matches, scores = _answers(material, method, pairs, (0, len(reference)))
    times = (pairs.encode_ms, pairs.row_ms)
    frame_ms = None if None in times else sum(time for time in times if time is not None)
    return Outcome(
        CLOSED, matches, scores, truth.right, truth.slip, [''] * len(query), query, pairs,
        frame_ms,
    )  # fmt: skip


def open_set(material: Material, method: Method) -> Outcome:
    """Return the answers with the first, the last and the middle half of the map kept in turn."""
    pairs = method.rows(material)
    query, reference = material.drives(method.config.encoding)
    matches: list[Match] = []
    scores, right = [], []
    spans = kept_halves(len(reference))
    for first, last in spans.values():
        found, score = _answers(material, method, pairs, (first, last))
        matches += found
        scores.append(score)
        kept = np.zeros_like(material.truth.right)
        kept[:, first:last] = material.truth.right[:, first:last]
        right.append(kept)
    return Outcome(
        OPEN, matches, np.concatenate(scores), np.concatenate(right),
        np.concatenate([material.truth.slip] * len(spans)),
        [half for half in spans for _ in range(len(query))], query, pairs,
    )  # fmt: skip


def online(material: Material, method: Method) -> Outcome:
    """Return the answers of a drive to itself: each frame may match what is past for long."""
    query, _ = material.drives(method.config.encoding)
    past = max(1, material.data_set.exclude_recent)
    known = method.rows(material)
    pairs = replace(known, scores=past_only(known.scores, past))
    matches, scores = _answers(material, method, pairs, (0, len(query)), past)
    return Outcome(
        ONLINE, matches, scores, material.truth.right, material.truth.slip, [''] * len(query),
        query, known,
    )  # fmt: skip


def kept_halves(count: int) -> Mapping[str, Span]:
    """Return the half-open spans of the references that are kept."""
    half, quarter = count // 2, count // 4
    return {'first': (0, half), 'last': (count - half, count), 'middle': (quarter, quarter + half)}


def _lengths(material: Material, method: Method) -> list[int]:
    query, _ = material.drives(method.config.encoding)
    return choose_lengths(query, method.config.sequence, method.kind.direction, material.cache)


def _answers(
    material: Material, method: Method, pairs: PairScores, span: Span, past: int = 0
) -> tuple[list[Match], npt.NDArray[np.float64]]:
    query, reference = material.drives(method.config.encoding)
    first, last = span
    kept = slice(first, last)
    again = None
    if method.kind.recognizer:
        again = answer_again(material, method.config, *span, past)
    lengths = (
        _lengths(material, method)
        if again is None
        else [match.sequence_length for match in again]
    )
    found = score_sequences(
        pairs.scores[:, kept], query, lengths, method.kind.direction, pairs.scorer
    )
    places = reference.reference_map.places[kept]
    matches = again or decide_frames(found, query, places, lengths, method.config)
    scores = np.full(pairs.scores.shape, -np.inf)
    scores[:, kept] = found
    return [_moved(match, first) for match in matches], scores


def _moved(match: Match, offset: int) -> Match:
    candidates = tuple(
        replace(one, reference_index=one.reference_index + offset) for one in match.candidates
    )
    return replace(match, candidates=candidates)
