# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The recogniser on the pair scores of any other method."""

from collections.abc import Sequence
from dataclasses import replace

from convseq_ros.config import Config
from convseq_ros.core.map.reference_map import ReferenceMap
from convseq_ros.core.matcher import Features, Matcher
from convseq_ros.core.recognizer import PlaceRecognizer
from convseq_ros.core.types import Candidates, Descriptor, Frame, Indices, Match
from convseq_ros.evaluation.drive import Drive
from convseq_ros.evaluation.rerun import part_of
import numpy as np
import numpy.typing as npt

Scores = npt.NDArray[np.float32]


class GivenScores(Matcher):
    """
    Stands in for a matcher where pair scores are known already.

    Parameters
    ----------
    rows : ndarray of float32, shape (Q, R)
        Pair scores; NaN where there is none. A row without any shows nothing.

    Attributes
    ----------
    frame : int
        The row of the frame that comes next; to be set before it does.

    """

    def __init__(self, rows: Scores) -> None:
        self.kernel, self.exact, self.frame = 'given', True, 0
        self._rows = rows

    def reset(self) -> None:
        """Forget nothing: rows are numbered."""

    def extract(self, _descriptor: Descriptor) -> Features | None:
        """Return the row of the frame."""
        row = self._rows[self.frame]
        return Features(row, row) if np.isfinite(row).any() else None

    def scores_of(self, asked: Sequence[tuple[Features, Indices]]) -> list[Scores]:
        """Return the given scores."""
        return [query.exact[indices] for query, indices in asked]

    def with_shift(self, _query: Features, candidates: Candidates) -> Candidates:
        """Return the candidates: no shift is given."""
        return candidates


def match_given(
    rows: Scores, drive: Drive, reference_map: ReferenceMap, config: Config, forward: bool = False
) -> list[Match]:
    """
    Return the recogniser's answers to a drive, given its pair scores.

    Parameters
    ----------
    rows : ndarray of float32, shape (Q, R)
        Pair scores, NaN where there is none.
    drive : Drive
        The query.
    reference_map : ReferenceMap
        The R references.
    config : Config
        Asks for exhaustive search and regional matching, which use pair scores as they are.
    forward : bool
        Whether the frames of a sequence lie after the anchor, as in the paper: then the drive is
        read from its end, in the map from its end.

    """
    if forward:
        back = match_given(
            rows[::-1, ::-1],
            drive.flipped,
            part_of(reference_map, len(reference_map) - 1, -1, -1),
            config,
        )
        return [
            _flipped(match, index, stamp_ns, reference_map)
            for index, (match, stamp_ns) in enumerate(
                zip(reversed(back), drive.stamps_ns, strict=True)
            )
        ]
    given = GivenScores(rows)
    recognizer = PlaceRecognizer(reference_map, config, given)
    matches = []
    for stamp_ns, readable, descriptor in zip(
        drive.stamps_ns, drive.readable, drive.descriptors, strict=True
    ):
        matches.append(recognizer.process(Frame(stamp_ns, None), descriptor if readable else None))
        given.frame += 1
    return matches


def _flipped(match: Match, index: int, stamp_ns: int, reference_map: ReferenceMap) -> Match:
    places = reference_map.places
    last = len(places) - 1
    candidates = tuple(
        replace(
            one,
            reference_index=last - one.reference_index,
            reference_stamp_ns=places[last - one.reference_index].stamp_ns,
        )
        for one in match.candidates
    )
    return replace(match, query_index=index, query_stamp_ns=stamp_ns, candidates=candidates)
