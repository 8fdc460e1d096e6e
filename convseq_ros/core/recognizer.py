# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The pipeline: one object, one verb."""

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial

from convseq_ros.config import Config
from convseq_ros.core.decision.acceptance import Acceptance
from convseq_ros.core.decision.candidates import best_candidates
from convseq_ros.core.encoding.descriptor import describe, nothing_seen
from convseq_ros.core.keyframes import KeyframeSelector
from convseq_ros.core.map.growth import Growth
from convseq_ros.core.map.reference_map import ReferenceMap
from convseq_ros.core.matcher import Matcher
from convseq_ros.core.sequence.diagonals import choose_length, diagonal, Row
from convseq_ros.core.sequence.pace import Pace
from convseq_ros.core.sequence.query_buffer import QueryBuffer, Seen
from convseq_ros.core.sequence.shortlist import Shortlist
from convseq_ros.core.sequence.velocity import SlopeSearch
from convseq_ros.core.shift import measured
from convseq_ros.core.similarity.regional import similarity
from convseq_ros.core.standstill import Standstill
from convseq_ros.core.types import Candidate, Descriptor, Frame, Match, Pose, Reason, Status
import numpy as np
import numpy.typing as npt

_CLOCK_JUMP_NS = 1_000_000_000
_LONGEST_GAP = 5
_CLOSER_ENDS = 20
_KEPT_REFERENCES = 1000

Indices = npt.NDArray[np.int64]


class PlaceRecognizer:
    """
    ConvSequential-SLAM, frame by frame.

    Parameters
    ----------
    reference_map : ReferenceMap
        The places to recognise; made with the same encoding. In online mode it grows.
    config : Config
        Its `sequence` and `acceptance` may be replaced between two frames.

    Attributes
    ----------
    resets : int
        How often a backward jump of the clock emptied the query buffer.

    """

    def __init__(self, reference_map: ReferenceMap, config: Config = Config()) -> None:
        chosen = config.matching
        own_way = chosen.matching == 'coherent'
        self.reference_map = reference_map
        self.config = config
        self.resets = 0
        self._frames = 0
        self._last_stamp_ns: int | None = None
        self._answer: Match | None = None
        self._is_news = False
        self._nothing = nothing_seen(config.encoding)
        self._standstill = Standstill(config.motion, own_way)
        self._acceptance = Acceptance(chosen.matching, config.acceptance.acceptance_rule)
        self.keyframes = KeyframeSelector(reference_map.keyframes, config.encoding, chosen.kernel)
        self._pace = Pace() if own_way and chosen.speed_search else None
        self._slopes = SlopeSearch() if own_way and chosen.speed_search else None
        self._growth: Growth | None = None
        if config.online.mode == 'online':
            self._growth = Growth(reference_map, config)
        self._shortlist: Shortlist | None = None
        if chosen.search == 'shortlist':
            self._shortlist = Shortlist(
                reference_map, chosen.shortlist_length, config.acceptance.rival_distance
            )
        self.matcher = Matcher(
            reference_map,
            chosen,
            config.encoding.saliency_threshold,
            _KEPT_REFERENCES if self._shortlist else None,
        )
        self._buffer = QueryBuffer(self.matcher, partial=own_way)

    @property
    def row(self) -> Row | None:
        """Pair scores of the newest frame, (R,), NaN where there is none; None if unseen."""
        return self._buffer.newest.row if self._buffer else None

    @property
    def session_start(self) -> int:
        """The first reference that this recogniser added, or would add."""
        return self._growth.session_start if self._growth else len(self.reference_map)

    def reset(self) -> None:
        """Forget the frames seen so far; counting goes on, and so does the map."""
        self._buffer.clear()
        self._last_stamp_ns = self._answer = None
        stages = self.keyframes, self._standstill, self._acceptance, self._pace, self._slopes
        for stage in stages:
            if stage:
                stage.reset()

    def process(self, frame: Frame) -> Match:
        """
        Return what is known about the place that the newest frame shows.

        Parameters
        ----------
        frame : Frame
            Frames come in order of their stamps. One that is up to a second older than its
            predecessor is skipped; one that is older still is taken as a jump of the clock (a
            recording that starts again), empties the query buffer and starts another session.

        Notes
        -----
        With the following departures from the paper, the last three with coherent matching only:
        (1) in online mode the frame is added to the map afterwards; (2) if the map's places are
        keyframes, frames in between are told the same again; (3) a robot that stands still is,
        too; (4) frames that a steady stream lacks, by its stamps, hold their places in the
        sequence; (5) a drive at another speed than the map's is followed.

        """
        if frame.gray is None:
            match = self.recognize(frame.stamp_ns, self._nothing, frame.pose)
            return replace(match, reason=Reason.UNREADABLE)
        descriptor = self._nothing
        if self.keyframes.is_due(frame.stamp_ns, frame.pose):
            descriptor = describe(frame.gray, self.config.encoding)
        match = self.recognize(frame.stamp_ns, descriptor, frame.pose)
        if self._growth and self._is_news:
            self._growth.add(frame, descriptor)
        return measured(match, frame, descriptor)

    def recognize(self, stamp_ns: int, descriptor: Descriptor, pose: Pose | None = None) -> Match:
        """Do what `process` does, but for the map, for a frame that is described already."""
        answer = partial(Match, self._frames, stamp_ns)
        self._frames += 1
        self._is_news = False
        if not self._in_order(stamp_ns):
            return answer(Status.SKIPPED, Reason.OUT_OF_ORDER)
        if self._pace:
            self._pace.missing(stamp_ns)
        if not self.keyframes.is_due(stamp_ns, pose):
            return self._the_same(answer, Reason.BETWEEN_KEYFRAMES)
        if self._standstill.holds(descriptor, pose):
            self._missing()
            return self._the_same(answer, Reason.STATIONARY)
        if not self.keyframes.wants(stamp_ns, descriptor, pose):
            if not descriptor.informative:
                return answer(Status.SKIPPED, Reason.UNINFORMATIVE)
            return self._the_same(answer, Reason.BETWEEN_KEYFRAMES)
        self._is_news = True
        self._hold_places(self._missing())
        usable = len(self.reference_map)
        if self._growth:
            usable = self._growth.usable(stamp_ns, pose)
        self._answer = self._recognize(answer, stamp_ns, descriptor, usable)
        return self._answer

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
            As `Look.agree` says; none if the way of matching does not tell.

        """
        best = match.best
        if not best or not best.shift:
            return np.zeros((0, 4))
        return self.matcher.agreeing(self._buffer.newest.query, best.reference_index, best.shift)

    def _recognize(
        self, answer: Callable[..., Match], stamp_ns: int, descriptor: Descriptor, usable: int
    ) -> Match:
        skipped = partial(answer, Status.SKIPPED)
        seen = self._look(descriptor, usable)
        self._keep(seen)
        if seen.query is None:
            return skipped(Reason.UNINFORMATIVE)
        if not usable:
            return skipped(Reason.RECENT if self._growth else Reason.NO_MAP)

        ends = np.arange(usable)
        if not self._shortlist:
            self._buffer.score(1, ends)
        outward = self._buffer.outward
        length = choose_length(
            [one.descriptor for one in outward], similarity, self.config.sequence
        )
        slope = 1.0
        if length is not None:
            slope = self._slope(outward[:length])
        if self._shortlist:
            ends = self._likely(outward[: length or 0], slope)
            window = max(length or 0, self._acceptance.window)
            self._buffer.score_promising(window, ends, slope)
        frame, pairs = self._buffer.frame, self._buffer.pairs_scored
        self._acceptance.follow(frame, [one.row for one in outward], ends, slope)
        if length is None:
            return skipped(Reason.WARMING_UP, pairs_scored=pairs)

        scores = self._buffer.sequence_scores(length, ends, slope)
        if self._shortlist:
            self._shortlist.prove(ends, scores)
        settings = self.config.acceptance
        candidates = best_candidates(ends, scores, self.reference_map.places, settings)
        if not candidates:
            short = usable <= diagonal(length, slope)[-1]
            return skipped(Reason.MAP_TOO_SHORT if short else Reason.WARMING_UP, (), length, pairs)
        reason, sure = self._acceptance.judge(frame, stamp_ns, candidates, settings, slope)
        status = Status.ACCEPTED if reason is Reason.ACCEPTED else Status.REJECTED
        candidates = self._with_shift(candidates, seen)
        return answer(status, reason, candidates, length, pairs, sure)

    def _slope(self, window: Sequence[Seen]) -> float:
        if self._slopes is None:
            return 1.0
        if self._shortlist is None:
            return self._slopes.follow([one.row for one in window])

        def closer(slope: float) -> npt.NDArray[np.float64]:
            ends = self._likely(window, slope, _CLOSER_ENDS)
            self._buffer.score(len(window), ends, slope)
            return self._buffer.rough_scores(len(window), ends, slope)

        return self._slopes.follow([one.first_sight for one in window], closer)

    def _likely(self, window: Sequence[Seen], slope: float, length: int = 0) -> Indices:
        """Return the ends of the likeliest diagonals at first sight."""
        if not self._shortlist or not window:
            return np.zeros(0, np.int64)
        return self._shortlist.ends([one.first_sight for one in window], slope, length)

    def _the_same(self, answer: Callable[..., Match], reason: Reason) -> Match:
        """Answer once more as for the last frame that was news; this is none, so no match."""
        last = self._answer
        if last is None or not last.candidates:
            return answer(Status.SKIPPED, reason)
        return answer(
            Status.REJECTED,
            reason,
            last.candidates,
            last.sequence_length,
            confidence=last.confidence,
        )

    def _in_order(self, stamp_ns: int) -> bool:
        late_ns = 0 if self._last_stamp_ns is None else self._last_stamp_ns - stamp_ns
        if late_ns > _CLOCK_JUMP_NS:
            self.reset()
            self.resets += 1
            if self._growth:
                self._growth.reset()
        elif late_ns > 0:
            return False
        self._last_stamp_ns = stamp_ns
        return True

    def _missing(self) -> int:
        return self._pace.missing_keyframes() if self._pace else 0

    def _hold_places(self, missing: int) -> None:
        """Let frames that never came keep the diagonals straight; begin anew after a long gap."""
        if missing > _LONGEST_GAP:
            self._buffer.clear(missing)
            return
        for _ in range(missing):
            self._keep(Seen(self._nothing))

    def _look(self, descriptor: Descriptor, usable: int) -> Seen:
        query = self.matcher.see(descriptor) if descriptor.informative else None
        if query is None:
            return Seen(descriptor)
        row = np.full(usable, np.nan, np.float32)
        first_sight = self._shortlist.row(descriptor, usable) if self._shortlist else None
        return Seen(descriptor, query, row, first_sight)

    def _keep(self, seen: Seen) -> None:
        most = max(self.config.sequence.window, self._acceptance.window)
        self._buffer.append(seen, most)

    def _with_shift(self, candidates: Sequence[Candidate], seen: Seen) -> tuple[Candidate, ...]:
        best = candidates[0]
        shift = self.matcher.shift(seen.query, best.reference_index)
        return replace(best, shift=shift), *candidates[1:]
