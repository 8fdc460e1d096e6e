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
        The places to recognise, made with the same encoding. In online mode it grows.
    config : Config
        Its `sequence` and `acceptance` may be replaced between two frames.
    matcher, coarse : Matcher, Coarse, optional
        The sources of pair scores and coarse scores; by default those of `config.matching`.
    describe : Describe, optional
        The map's descriptor model, from an image to a vector; without it, the built-in one.

    Raises
    ------
    ConfigError
        If `describe` is not the map's model, or the map has no cells and `matching` needs them.

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
        # The queries' threshold decides which regions count, not that of the map.
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
        parts = reference_map, coarse, config
        self.decider: Decider = BeliefDecider(*parts) if config.believes else PaperDecider(*parts)
        self._poses = RelativePoses(reference_map, self.matcher, config.reading)
        self._accepted_ns: int | None = None  # stamp of the newest accepted match
        self.order, self._frames, self._blank = StampOrder(), 0, blank_descriptor(self._encoding)
        self.localizer = Localizer(reference_map)
        self.only_maps = False  # whether places are only added, and none is recognised
        self._last: Match | None = None  # the answer to the newest keyframe
        self._expected: deque[tuple[int, Verdict]] = deque()  # stamps and verdicts of next frames

    def process(self, frame: Frame, descriptor: Descriptor | None = None) -> Match:
        """
        Return the match of the next frame: which place of the map it shows, if any.

        Frames come in order. A frame that is up to a second late is skipped. If it is later, the
        clock jumped back: the buffer is emptied, and a session begins. A `descriptor` is used
        instead of the image if it is given.

        Departures from the paper: (1) in online mode the frame is then added to the map; (2)
        between keyframes and (3) at standstill, the last answer is repeated; (4) dropped frames
        leave empty slots in the sequence.
        """
        match = self._answer(upright(frame, self._encoding, self.config.robot), descriptor)
        return self.localizer.update(match, self.mapping.session_start, self.config)

    def expect(self, frames: Sequence[Frame]) -> None:
        """
        Describe the frames that `process` gets next as one batch, if there is a model.

        The matches of `process` do not change. Nothing is done if a stamp is earlier than the one
        before it. ModelError as of `process`, which then calls the model again.
        """
        if self._expected or not self.order.are_next([frame.stamp_ns for frame in frames]):
            return
        frames = [upright(frame, self._encoding, self.config.robot) for frame in frames]
        gated = [(frame, self._verdict(frame)) for frame in frames]
        self._expected.extend((frame.stamp_ns, verdict) for frame, verdict in gated)
        keyframes = [(frame, verdict.descriptor) for frame, verdict in gated if not verdict.reason]
        new = iter(self.first_stage.add_all(keyframes))
        self._expected = deque(
            (frame.stamp_ns, verdict if verdict.reason else replace(verdict, descriptor=next(new)))
            for frame, verdict in gated
        )

    def _verdict(self, frame: Frame, descriptor: Descriptor | None = None) -> Verdict:
        while self._expected:
            stamp_ns, verdict = self._expected.popleft()
            if stamp_ns == frame.stamp_ns:
                return verdict

        def encode() -> Descriptor:  # III-B, III-C: entropy, histograms of gradients in cells
            if descriptor is None and frame.gray is not None:
                return describe(frame.gray, self._encoding)
            return descriptor or self._blank

        return self.gate.check(frame.stamp_ns, frame.pose, encode, frame.gray)

    def _answer(self, frame: Frame, descriptor: Descriptor | None) -> Match:
        answer, self._frames = partial(Match, self._frames, frame.stamp_ns), self._frames + 1
        self.model_ms = 0.0
        if (order := self.order.check(frame.stamp_ns)) is Order.LATE:
            return answer(Status.SKIPPED, Reason.OUT_OF_ORDER)
        if order is Order.JUMPED_BACK:
            self.reset()
            self.mapping.reset()
            self.order.check(frame.stamp_ns)
            self.resets += 1
        verdict = self._verdict(frame, descriptor)
        if verdict.reason:
            match = self._repeat(answer, verdict.reason)
        else:
            described = self.first_stage.add(frame, verdict.descriptor)
            self.model_ms = self.first_stage.duration_ms
            if self.only_maps:
                self.mapping.add(frame, described)
                return answer(Status.SKIPPED, self.mapping.nothing_usable)
            verdict = replace(verdict, descriptor=described)
            match = self._last = self._recognize(answer, frame, verdict)
            self.mapping.add(frame, verdict.descriptor, match)
        if frame.gray is None and descriptor is None:
            return answer(Status.SKIPPED, Reason.UNREADABLE)
        return measured(match, frame, self.reference_map)

    def _recognize(self, answer: partial[Match], frame: Frame, verdict: Verdict) -> Match:
        config, buffer = self.config, self.buffer
        # III-A: the newest frame joins the rolling buffer; dropped frames leave empty slots.
        most = max(2, config.sequence.window)
        buffer.hold_places(verdict.missing, self._blank, most)
        usable = self.mapping.usable(frame.stamp_ns, frame.pose)
        buffer.append(verdict.descriptor, usable, most)
        if (features := buffer.newest.features) is None or not usable:
            reason = self.mapping.nothing_usable if features else Reason.UNINFORMATIVE
            return answer(Status.SKIPPED, reason)
        # III-E, III-F: information gain and entropy choose the length k.
        length = choose_length(buffer.descriptors, self._similarity, config.sequence)
        # III-D, III-G, or the belief: which places are likely, and is the best one a match?
        start = self.mapping.session_start
        query = Query(frame, buffer, usable, start, config, length, verdict.missing)
        result, pairs = self.decider.decide(query), buffer.pairs_scored
        if not result.candidates:
            return answer(Status.SKIPPED, result.reason, (), result.length, pairs)
        fields = result.candidates, result.length, pairs, result.confidence
        match = answer(Status.REJECTED, result.reason, *fields, implausible_m=result.implausible_m)
        # Not in the paper: the relative pose, and a minimum time between matches.
        return self._complete(match, frame, features)

    def _complete(self, match: Match, frame: Frame, features: Features) -> Match:
        """Add shift, status and relative pose to a match; `closure_interval_s` limits the rate."""
        best, *others = match.candidates
        best = replace(best, shift=self.matcher.shift(features, best.reference_index))
        match = replace(match, candidates=(best, *others))
        if match.reason is not Reason.ACCEPTED:
            return match
        interval_ns = round(self.config.acceptance.closure_interval_s * 1e9)
        if self._accepted_ns is not None and frame.stamp_ns - self._accepted_ns < interval_ns:
            return replace(match, reason=Reason.COOL_DOWN)
        self._accepted_ns = frame.stamp_ns
        pose, stored = self._poses.measure(features, frame, best), self.reference_map
        place = stored.places[stored.links.anchor(best.reference_index)]
        anchor = Anchor(stored.sessions[place.session].id, place.stamp_ns)
        return replace(match, status=Status.ACCEPTED, relative_pose=pose, anchor=anchor)

    def _repeat(self, answer: partial[Match], reason: Reason) -> Match:
        """Return the last keyframe's answer again, not accepted: this frame is not a keyframe."""
        last = self._last
        if reason is Reason.UNINFORMATIVE or last is None or not last.candidates:
            return answer(Status.SKIPPED, reason)
        repeated = last.candidates, last.sequence_length, 0, last.confidence
        return answer(Status.REJECTED, reason, *repeated)

    def reset(self) -> None:
        """Forget the frames so far; the frame count and the map are kept."""
        self._last = self._accepted_ns = None
        self._expected.clear()
        stages = self.order, self.gate, self.matcher, self.buffer, self.decider, self.localizer
        for stage in stages:
            stage.reset()
