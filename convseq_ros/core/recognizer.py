# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The pipeline: one object, one verb."""

from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

from convseq_ros.config import Config
from convseq_ros.core.acceptance import Acceptance
from convseq_ros.core.candidates import best_candidates
from convseq_ros.core.descriptor import describe, nothing_seen
from convseq_ros.core.matching import Matcher
from convseq_ros.core.matching.regional import similarity
from convseq_ros.core.reference_map import ReferenceMap
from convseq_ros.core.retrieval import Shortlist
from convseq_ros.core.sequence import choose_length, diagonal, Row, sequence_scores
from convseq_ros.core.slope import SlopeSearch
from convseq_ros.core.types import Candidate, Descriptor, Frame, Match, Reason, Status
import numpy as np
import numpy.typing as npt

_CLOCK_JUMP_NS = 1_000_000_000
_KEPT_REFERENCES = 2000


@dataclass(frozen=True, slots=True)
class _Seen:
    """A frame of the query buffer: what is compared of it, and its scores as far as known."""

    descriptor: Descriptor
    query: Any = None
    row: Row | None = None
    first_sight: Row | None = None


class PlaceRecognizer:
    """
    ConvSequential-SLAM, frame by frame.

    Parameters
    ----------
    reference_map : ReferenceMap
        The places to recognise; made with the same encoding.
    config : Config
        Its `sequence` and `acceptance` may be replaced between two frames.
    matcher : Matcher, optional
        What scores pairs, if not as `config.matching` says.

    Attributes
    ----------
    resets : int
        How often a backward jump of the clock emptied the query buffer.

    """

    def __init__(
        self,
        reference_map: ReferenceMap,
        config: Config = Config(),
        matcher: Matcher | None = None,
    ) -> None:
        chosen = config.matching
        self.reference_map = reference_map
        self.config = config
        self.resets = 0
        self._buffer: deque[_Seen] = deque()
        self._frames = 0
        self._kept = 0
        self._last_stamp_ns: int | None = None
        self._everywhere = np.arange(len(reference_map))
        self._acceptance = Acceptance(chosen.matching, config.acceptance.acceptance_rule)
        self._shortlist: Shortlist | None = None
        if chosen.search == 'shortlist' and len(reference_map):
            self._shortlist = Shortlist(
                reference_map, chosen.shortlist_length, config.acceptance.rival_distance
            )
        self._slopes: SlopeSearch | None = None
        if chosen.speed_search and chosen.matching == 'coherent':
            self._slopes = SlopeSearch()
        self._matcher = matcher or Matcher(
            reference_map,
            chosen.matching,
            config.encoding.saliency_threshold,
            _KEPT_REFERENCES if self._shortlist else None,
        )

    @property
    def row(self) -> Row | None:
        """Pair scores of the newest frame, (R,), NaN where there is none; None if unseen."""
        return self._buffer[-1].row if self._buffer else None

    def reset(self) -> None:
        """Forget the frames seen so far; counting goes on."""
        self._buffer.clear()
        self._acceptance.reset()
        self._last_stamp_ns = None
        if self._slopes:
            self._slopes.reset()

    def process(self, frame: Frame) -> Match:
        """
        Return what is known about the place that the newest frame shows.

        Parameters
        ----------
        frame : Frame
            Frames come in order of their stamps. One that is up to a second older than its
            predecessor is skipped; one that is older still is taken as a jump of the clock (a
            recording that starts again) and empties the query buffer.

        """
        if frame.gray is not None:
            return self.recognize(frame.stamp_ns, describe(frame.gray, self.config.encoding))
        match = self.recognize(frame.stamp_ns, nothing_seen(self.config.encoding))
        return replace(match, reason=Reason.UNREADABLE)

    def recognize(self, stamp_ns: int, descriptor: Descriptor) -> Match:
        """Do what `process` does, for a frame that is described already."""
        answer = partial(Match, self._frames, stamp_ns)
        skipped = partial(answer, Status.SKIPPED)
        self._frames += 1
        if not self._in_order(stamp_ns):
            return skipped(Reason.OUT_OF_ORDER)
        seen = self._look(descriptor)
        self._keep(seen)
        if seen.query is None:
            return skipped(Reason.UNINFORMATIVE)
        if not len(self.reference_map):
            return skipped(Reason.NO_MAP)

        pairs = 0 if self._shortlist else self._score([seen], self._everywhere)
        outward = list(reversed(self._buffer))
        length = choose_length(
            [one.descriptor for one in outward], similarity, self.config.sequence
        )
        judge = partial(self._acceptance.judge, self._kept, [one.row for one in outward])
        if length is None:
            reason, _ = judge((), self.config.acceptance)
            return skipped(reason, pairs_scored=pairs)

        window = outward[:length]
        first_sights = [one.first_sight if self._shortlist else one.row for one in window]
        slope = self._slopes.follow(first_sights) if self._slopes else 1.0
        ends = self._everywhere
        if self._shortlist:
            ends = self._shortlist.ends(first_sights, slope)
            pairs = self._score(outward[: max(length, self._acceptance.window)], ends, slope)
        scores = _only(ends, sequence_scores([one.row for one in window], slope=slope))
        candidates = best_candidates(scores, self.reference_map.places, self.config.acceptance)
        reason, confidence = judge(candidates, self.config.acceptance, slope)
        if not candidates:
            return skipped(Reason.MAP_TOO_SHORT, (), length, pairs)
        status = Status.ACCEPTED if reason is Reason.ACCEPTED else Status.REJECTED
        candidates = self._with_shift(candidates, seen)
        return answer(status, reason, candidates, length, pairs, confidence)

    def agreement(self, match: Match) -> npt.NDArray[np.float64]:
        """
        Return which regions moved together from the newest frame to its best candidate.

        Parameters
        ----------
        match : Match
            The answer to the newest frame.

        Returns
        -------
        ndarray of float64, shape (n, 4)
            As `PairScore.agree` says; none if the way of matching does not tell.

        """
        best = match.best
        if not best or not best.shift:
            return np.zeros((0, 4))
        return self._matcher.agreeing(self._buffer[-1].query, best.reference_index, best.shift)

    def _in_order(self, stamp_ns: int) -> bool:
        late_ns = 0 if self._last_stamp_ns is None else self._last_stamp_ns - stamp_ns
        if late_ns > _CLOCK_JUMP_NS:
            self.reset()
            self.resets += 1
        elif late_ns > 0:
            return False
        self._last_stamp_ns = stamp_ns
        return True

    def _look(self, descriptor: Descriptor) -> _Seen:
        query = self._matcher.see(descriptor) if descriptor.informative else None
        if query is None:
            return _Seen(descriptor)
        row = np.full(len(self.reference_map), np.nan, np.float32)
        first_sight = self._shortlist.row(descriptor) if self._shortlist else None
        return _Seen(descriptor, query, row, first_sight)

    def _keep(self, seen: _Seen) -> None:
        self._buffer.append(seen)
        self._kept += 1
        while len(self._buffer) > max(self.config.sequence.window, self._acceptance.window):
            self._buffer.popleft()

    def _score(
        self, window: Sequence[_Seen], ends: npt.NDArray[np.int64], slope: float = 1.0
    ) -> int:
        """Score the pairs on the diagonals that end at some references; return how many."""
        count = 0
        for step, one in zip(diagonal(len(window), slope), window, strict=True):
            if one.row is None:
                continue
            indices = ends[ends >= step] - step
            missing = indices[np.isnan(one.row[indices])]
            one.row[missing] = self._matcher.scores(one.query, missing)
            count += len(missing)
        return count

    def _with_shift(
        self, candidates: Sequence[Candidate], seen: _Seen
    ) -> tuple[Candidate, ...]:
        best = candidates[0]
        shift = self._matcher.shift(seen.query, best.reference_index)
        return replace(best, shift=shift), *candidates[1:]


def _only(
    ends: npt.NDArray[np.int64], scores: npt.NDArray[np.float64]
) -> npt.NDArray[np.float64]:
    """Return the scores at some references, -inf elsewhere."""
    listed = np.full(len(scores), -np.inf)
    listed[ends] = scores[ends]
    return listed
