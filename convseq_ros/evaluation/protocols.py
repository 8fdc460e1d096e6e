# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
The three protocols: closed, open and online.

Closed: every query has an answer. Open: a part of the map is removed, so that for some queries
"not in the map" is right. Online: a drive is matched against its own past.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

from convseq_ros.core.types import Match
from convseq_ros.evaluation.drive import DescribedDrive
from convseq_ros.evaluation.given_scores import (
    PairScores,
    rank_references,
    recognize_given,
    SequenceScores,
)
from convseq_ros.evaluation.material import Material
from convseq_ros.evaluation.methods import Method
from convseq_ros.evaluation.peers import matches_of
from convseq_ros.evaluation.query_answers import (
    part_of,
    QueryAnswers,
    recognize,
    renumbered,
    Scores,
    Span,
)
from convseq_ros.evaluation.truth import is_past
import numpy as np
import numpy.typing as npt

CLOSED, OPEN, ONLINE = 'closed', 'open', 'online'
VERSION = 3  # of the figures' meaning; every change to it adds 1
Flags = npt.NDArray[np.bool_]


@dataclass(frozen=True)
class Outcome:
    """The answers of a method, frame by frame; M is Q, or 3 Q with halves of the map."""

    protocol: str
    matches: list[Match]  # M; references are numbered as in the full map
    sequence_scores: SequenceScores  # (M, R)
    right: Flags  # (M, R), the right references
    slip: Flags  # (M, R), references just outside the tolerance
    halves: list[str]  # M; name of the kept part of the map, empty for the full map
    query: DescribedDrive
    pairs: PairScores  # of single frames
    frame_ms: float | None  # median time of a frame, if measured
    durations_ms: Sequence[float]  # time of every frame with the full map, or empty


def run_protocol(
    material: Material, method: Method, protocol: str = CLOSED, keep: float | None = None
) -> Outcome:
    """
    Return the answers of a method under one of the three protocols.

    `open` keeps the first, the last and the middle half of the map in turn, or only the first
    share `keep`. The pair scores in the outcome are of the full map, from an exhaustive search.
    """
    query, reference = material.drives(method.config.encoding)
    spans: Mapping[str, Span] = {'': (0, len(reference))}
    if protocol == OPEN:
        spans = kept_halves(len(reference), keep)
    if method.kind.recognizer and protocol != OPEN:
        answered = recognize(material, method.config, after=method.kind.after)
        pairs = method.measured(material, answered)
        answers = [_ranked(material, method, answered, answered.rows, spans[''])]
    else:
        pairs = method.rows(material)
        rows = pairs.scores
        if protocol == ONLINE:
            past = is_past(len(rows), material.data_set.exclude_recent)
            rows = np.where(past, rows, np.nan).astype(rows.dtype)
        answers = [_of_part(material, method, pairs, rows, span) for span in spans.values()]
    rights = []
    for first, last in spans.values():
        kept = np.zeros_like(material.truth.right)
        kept[:, first:last] = material.truth.right[:, first:last]
        rights.append(kept)
    return Outcome(
        protocol,
        [match for answer in answers for match in answer.matches],
        np.concatenate([answer.rows for answer in answers]),
        np.concatenate(rights),
        np.concatenate([material.truth.slip] * len(spans)),
        [half for half in spans for _ in range(len(query))],
        query,
        pairs,
        _frame_ms(answers, pairs, protocol),
        answers[0].durations_ms if protocol != OPEN else [],
    )


def kept_halves(count: int, keep: float | None = None) -> Mapping[str, Span]:
    """Return the kept spans of the references; with `keep`, only the first share of them."""
    if keep is not None:
        return {'first': (0, round(keep * count))}
    half, quarter = count // 2, count // 4
    return {'first': (0, half), 'last': (count - half, count), 'middle': (quarter, quarter + half)}


def _ranked(
    material: Material, method: Method, answered: QueryAnswers, rows: Scores, span: Span
) -> QueryAnswers:
    """Return the recogniser's answers with sequence scores, -inf outside the span."""
    query, _ = material.drives(method.config.encoding)
    first, last = span
    lengths = [match.sequence_length for match in answered.matches]
    scores = np.full(rows.shape, -np.inf)
    scores[:, first:last] = rank_references(rows[:, first:last], query, lengths)
    return replace(answered, rows=scores)


def _of_part(
    material: Material, method: Method, pairs: PairScores, rows: Scores, span: Span
) -> QueryAnswers:
    if method.kind.recognizer:
        answered = recognize(material, method.config, span, method.kind.after)
        return _ranked(material, method, answered, rows, span)
    query, reference = material.drives(method.config.encoding)
    first, last = span
    part = part_of(reference.reference_map, first, last)
    kept, scores = rows[:, first:last], np.full(rows.shape, -np.inf)
    if pairs.detect is not None:
        answers = matches_of(pairs.detect(kept, first), query, part)
        lengths = [match.sequence_length for match in answers]
        scores[:, first:last] = rank_references(kept, query, lengths)
    else:
        arguments = query, part, method.config, pairs.scorer
        answers, scores[:, first:last] = recognize_given(kept, *arguments)
    matches = [renumbered(match, lambda best: best.reference_index + first) for match in answers]
    return QueryAnswers(matches, [], scores)


def _frame_ms(answers: Sequence[QueryAnswers], pairs: PairScores, protocol: str) -> float | None:
    durations = [duration_ms for answer in answers for duration_ms in answer.durations_ms]
    if not durations:
        if pairs.encode_ms is None or pairs.row_ms is None:
            return None
        return pairs.encode_ms + pairs.row_ms
    # With a part of the map removed, the durations do not include the encoding.
    return float(np.median(durations)) + (pairs.encode_ms or 0.0) * (protocol == OPEN)
