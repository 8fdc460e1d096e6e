# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The algorithm: frames in, matches out. Sections are those of the paper."""

from collections import deque
from collections.abc import Sequence
from dataclasses import replace
from functools import partial

from convseq_ros.config import Config
from convseq_ros.core.decision.belief_decider import BeliefDecider
from convseq_ros.core.decision.decider import Decider, Query
from convseq_ros.core.decision.localizer import Localizer
from convseq_ros.core.decision.paper_decider import PaperDecider
from convseq_ros.core.encoding.descriptor import blank_descriptor, describe
from convseq_ros.core.encoding.first_stage import Describe, FirstStage
from convseq_ros.core.encoding.view import upright
from convseq_ros.core.frame_gate import FrameGate, Order, StampOrder, Verdict
from convseq_ros.core.map.online import OnlineMap, PreloadedMap
from convseq_ros.core.map.reference_map import ReferenceMap
from convseq_ros.core.matcher import Features, make_matcher, Matcher
from convseq_ros.core.pose.estimate import measured
from convseq_ros.core.pose.relative_pose import RelativePoses
from convseq_ros.core.sequence.coarse_scores import Coarse, CoarseScores
from convseq_ros.core.sequence.query_buffer import choose_length, QueryBuffer
from convseq_ros.core.similarity.overlap import PaperSimilarity
from convseq_ros.core.types import Anchor, Descriptor, Frame, Match, Reason, Status


class PlaceRecognizer:
    """
    ConvSequential-SLAM, frame by frame.

    Parameters
    ----------
    reference_map : ReferenceMap
        The places to recognise; made with the same encoding. In online mode it grows.
    config : Config
        Its `sequence` and `acceptance` may be replaced between two frames.
    matcher, coarse : Matcher, Coarse, optional
        What scores pairs, and knows coarse scores, if not by `config.matching`.
    describe : Describe, optional
        What makes the vectors of the map, if not what is built in: from an image to a vector.

    Raises
    ------
    ConfigError
        If `describe` is not what made the map, or it has no cells and `matching` needs them.

    """

    def __init__(
        self,
        reference_map: ReferenceMap,
        config: Config = Config(),
        matcher: Matcher | None = None,
        coarse: Coarse | None = None,
        describe: Describe | None = None,
    ) -> None:
        self.reference_map, self.config, self.resets = reference_map, config, 0
        # Which regions count is a matter of the queries.
        threshold = config.encoding.saliency_threshold
        self._encoding = replace(reference_map.encoding, saliency_threshold=threshold)
        numbers = reference_map.global_descriptors.shape[1]
        self.first_stage = FirstStage(describe, reference_map.encoding, numbers)
        self.model_ms = 0.0  # of the newest frame
        self._similarity = PaperSimilarity(config.matching.kernel)
        self.gate = FrameGate(config, reference_map.keyframes, self._similarity)
        grows = config.online.grows
        self.mapping = OnlineMap(reference_map, config) if grows else PreloadedMap(reference_map)
        self.matcher = matcher or make_matcher(reference_map, config)
        self.buffer = QueryBuffer(self.matcher, reference_map.bounds)
        if config.matching.search == 'exhaustive':
            coarse = Coarse()
        coarse = coarse or CoarseScores(reference_map, config.matching.both_directions)
        made = reference_map, coarse, config
        self.decider: Decider = BeliefDecider(*made) if config.believes else PaperDecider(*made)
        self._poses = RelativePoses(reference_map, self.matcher, config.reading)
        self._accepted_ns: int | None = None  # when the newest match was
        self.order, self._frames, self._blank = StampOrder(), 0, blank_descriptor(self._encoding)
        self.localizer = Localizer(reference_map)
        self.only_maps = False  # whether places are added, and none is recognised
        self._last: Match | None = None
        self._expected: deque[tuple[int, Verdict]] = deque()  # by stamp, of frames that come next

    def process(self, frame: Frame, descriptor: Descriptor | None = None) -> Match:
        """
        Return what is known about the place that the newest frame shows.

        Frames come in order. One whose stamp is up to a second late is skipped; one later still
        means that the clock jumped back: the buffer is emptied, a session begins. A `descriptor`
        says what the frame shows, if it is described already.

        Departures from the paper: (1) in online mode the frame is added to the map afterwards; (2)
        frames between keyframes are told the same again, (3) as is a robot that stands still; (4)
        dropped frames hold their places.
        """
        match = self._answer(upright(frame, self._encoding, self.config.robot), descriptor)
        return self.localizer.update(match, self.mapping.session_start, self.config)

    def expect(self, frames: Sequence[Frame]) -> None:
        """
        Take in all frames that `process` gets next, so that a model describes them in one batch.

        Answers are those of frames one by one. Nothing is done if a stamp is earlier than the one
        before it. ModelError as of `process`, which then asks the model again.
        """
        if self._expected or not self.order.are_next([frame.stamp_ns for frame in frames]):
            return
        frames = [upright(frame, self._encoding, self.config.robot) for frame in frames]
        seen = [(frame, self._gated(frame)) for frame in frames]
        self._expected.extend((frame.stamp_ns, verdict) for frame, verdict in seen)
        passed = [(frame, verdict.descriptor) for frame, verdict in seen if not verdict.reason]
        described = iter(self.first_stage.add_all(passed))
        self._expected = deque(
            (frame.stamp_ns, one if one.reason else replace(one, descriptor=next(described)))
            for frame, one in seen
        )

    def _gated(self, frame: Frame, descriptor: Descriptor | None = None) -> Verdict:
        while self._expected:
            stamp_ns, verdict = self._expected.popleft()
            if stamp_ns == frame.stamp_ns:
                return verdict

        def encode() -> Descriptor:  # III-B, III-C: entropy, histograms of gradients in cells
            if descriptor is None and frame.gray is not None:
                return describe(frame.gray, self._encoding)
            return descriptor or self._blank

        return self.gate.update(frame.stamp_ns, frame.pose, encode, frame.gray)

    def _answer(self, frame: Frame, descriptor: Descriptor | None) -> Match:
        answer, self._frames = partial(Match, self._frames, frame.stamp_ns), self._frames + 1
        self.model_ms = 0.0
        if (order := self.order.update(frame.stamp_ns)) is Order.LATE:
            return answer(Status.SKIPPED, Reason.OUT_OF_ORDER)
        if order is Order.JUMPED_BACK:
            self.reset()
            self.mapping.reset()
            self.order.update(frame.stamp_ns)
            self.resets += 1
        verdict = self._gated(frame, descriptor)
        if verdict.reason:
            match = self._again(answer, verdict.reason)
        else:
            shown = self.first_stage.add(frame, verdict.descriptor)
            self.model_ms = self.first_stage.duration_ms
            if self.only_maps:
                self.mapping.add(frame, shown)
                return answer(Status.SKIPPED, self.mapping.nothing_usable)
            verdict = replace(verdict, descriptor=shown)
            match = self._last = self._recognize(answer, frame, verdict)
            self.mapping.add(frame, verdict.descriptor, match)
        if frame.gray is None and descriptor is None:
            return answer(Status.SKIPPED, Reason.UNREADABLE)
        return measured(match, frame, self.reference_map)

    def _recognize(self, answer: partial[Match], frame: Frame, verdict: Verdict) -> Match:
        config, buffer = self.config, self.buffer
        # III-A: the newest frame joins the rolling buffer; dropped ones hold their places.
        most = max(2, config.sequence.window)
        buffer.hold_places(verdict.missing, self._blank, most)
        usable = self.mapping.update(frame.stamp_ns, frame.pose)
        buffer.append(verdict.descriptor, usable, most)
        if (features := buffer.newest.features) is None or not usable:
            why = self.mapping.nothing_usable if features else Reason.UNINFORMATIVE
            return answer(Status.SKIPPED, why)
        # III-E, III-F: information gain and entropy choose the length k.
        length = choose_length(buffer.descriptors, self._similarity, config.sequence)
        # III-D, III-G, or the belief: which places are likely, and is the best one a match?
        own = self.mapping.session_start
        asked = Query(frame, buffer, usable, own, config, length, verdict.missing)
        said, pairs = self.decider.decide(asked), buffer.pairs_scored
        if not said.candidates:
            return answer(Status.SKIPPED, said.reason, (), said.length, pairs)
        found = said.candidates, said.length, pairs, said.confidence
        match = answer(Status.REJECTED, said.reason, *found, implausible_m=said.implausible_m)
        # Ours: where was the robot against the place? Matches are kept apart in time.
        return self._complete(match, frame, features)

    def _complete(self, match: Match, frame: Frame, features: Features) -> Match:
        """Return an answer complete; no match follows another sooner than `closure_interval_s`."""
        best, *others = match.candidates
        best = replace(best, shift=self.matcher.shift(features, best.reference_index))
        match = replace(match, candidates=(best, *others))
        if match.reason is not Reason.ACCEPTED:
            return match
        interval_ns = round(self.config.acceptance.closure_interval_s * 1e9)
        if self._accepted_ns is not None and frame.stamp_ns - self._accepted_ns < interval_ns:
            return replace(match, reason=Reason.COOL_DOWN)
        self._accepted_ns = frame.stamp_ns
        pose, known = self._poses.measure(features, frame, best), self.reference_map
        place = known.places[known.links.anchor(best.reference_index)]
        anchor = Anchor(known.sessions[place.session].id, place.stamp_ns)
        return replace(match, status=Status.ACCEPTED, relative_pose=pose, anchor=anchor)

    def _again(self, answer: partial[Match], reason: Reason) -> Match:
        """Answer once more as for the last keyframe; this is none, so no match."""
        last = self._last
        if reason is Reason.UNINFORMATIVE or last is None or not last.candidates:
            return answer(Status.SKIPPED, reason)
        known = last.sequence_length, 0, last.confidence
        return answer(Status.REJECTED, reason, last.candidates, *known)

    def reset(self) -> None:
        """Forget the frames so far; counting goes on, and so does the map."""
        self._last = self._accepted_ns = None
        self._expected.clear()
        stages = self.order, self.gate, self.matcher, self.buffer, self.decider, self.localizer
        for stage in stages:
            stage.reset()
