# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The pipeline: one object, one verb."""

from collections import deque
from functools import partial

from convseq_ros.config import Config
from convseq_ros.core.acceptance import decide
from convseq_ros.core.candidates import best_candidates
from convseq_ros.core.descriptor import describe, nothing_seen
from convseq_ros.core.matching.regional import RegionalMatcher, similarity
from convseq_ros.core.reference_map import ReferenceMap
from convseq_ros.core.sequence import choose_length, sequence_scores
from convseq_ros.core.types import Descriptor, Frame, Match, Reason, Status
import numpy as np
import numpy.typing as npt

Row = npt.NDArray[np.float32]
_CLOCK_JUMP_NS = 1_000_000_000


class PlaceRecognizer:
    """
    ConvSequential-SLAM, frame by frame.

    Parameters
    ----------
    reference_map : ReferenceMap
        The places to recognise; made with the same encoding.
    config : Config
        Its `sequence` and `acceptance` may be replaced between two frames.

    Attributes
    ----------
    resets : int
        How often a backward jump of the clock emptied the query buffer.
    row : ndarray of float32, shape (R,), or None
        Pair scores of the newest frame, to plot; None if it was not scored.

    """

    def __init__(self, reference_map: ReferenceMap, config: Config = Config()) -> None:
        self.reference_map = reference_map
        self.config = config
        self.resets = 0
        self.row: Row | None = None
        self._matcher = RegionalMatcher(reference_map)
        self._buffer: deque[tuple[Descriptor, Row | None]] = deque()
        self._frames = 0
        self._last_stamp_ns: int | None = None

    def reset(self) -> None:
        """Forget the frames seen so far; counting goes on."""
        self._buffer.clear()
        self._last_stamp_ns = None

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
        answer = partial(Match, self._frames, frame.stamp_ns)
        skipped = partial(answer, Status.SKIPPED)
        self._frames += 1
        self.row = None
        if not self._in_order(frame.stamp_ns):
            return skipped(Reason.OUT_OF_ORDER)
        if frame.gray is None:
            self._keep(nothing_seen(self.config.encoding), None)
            return skipped(Reason.UNREADABLE)

        descriptor = describe(frame.gray, self.config.encoding)
        if not descriptor.informative:
            self._keep(descriptor, None)
            return skipped(Reason.UNINFORMATIVE)
        if not len(self.reference_map):
            return skipped(Reason.NO_MAP)

        self.row = row = self._matcher.row(descriptor)
        self._keep(descriptor, row)
        length = choose_length(
            [kept for kept, _ in self._outward()], similarity, self.config.sequence
        )
        if length is None:
            return skipped(Reason.WARMING_UP, pairs_scored=len(row))

        rows = [kept_row for _, kept_row in self._outward()[:length]]
        scores = sequence_scores(rows, self._matcher.informative)
        candidates = best_candidates(scores, self.reference_map.places, self.config.acceptance)
        if not candidates:
            return skipped(Reason.MAP_TOO_SHORT, (), length, len(row))
        reason = decide(candidates, self.config.acceptance)
        status = Status.ACCEPTED if reason is Reason.ACCEPTED else Status.REJECTED
        return answer(status, reason, candidates, length, len(row))

    def _in_order(self, stamp_ns: int) -> bool:
        late_ns = 0 if self._last_stamp_ns is None else self._last_stamp_ns - stamp_ns
        if late_ns > _CLOCK_JUMP_NS:
            self.reset()
            self.resets += 1
        elif late_ns > 0:
            return False
        self._last_stamp_ns = stamp_ns
        return True

    def _outward(self) -> list[tuple[Descriptor, Row | None]]:
        return list(reversed(self._buffer))

    def _keep(self, descriptor: Descriptor, row: Row | None) -> None:
        self._buffer.append((descriptor, row))
        while len(self._buffer) > self.config.sequence.window:
            self._buffer.popleft()
