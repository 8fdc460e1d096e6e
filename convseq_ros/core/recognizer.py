# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The algorithm, frame by frame; Roman numerals are sections of the paper."""

from dataclasses import replace
from functools import partial

from convseq_ros.config import Config
from convseq_ros.core.decision.belief_decider import BeliefDecider
from convseq_ros.core.decision.decider import Decider, Query
from convseq_ros.core.decision.localizer import Localizer
from convseq_ros.core.decision.paper.decider import PaperDecider
from convseq_ros.core.decision.paper.length import choose_length
from convseq_ros.core.decision.paper.query_buffer import QueryBuffer
from convseq_ros.core.encoding.descriptor import blank_descriptor, describe
from convseq_ros.core.encoding.first_stage import Describe, FirstStage
from convseq_ros.core.encoding.view import upright
from convseq_ros.core.gate.gate import FrameGate, Verdict
from convseq_ros.core.gate.stamp_order import Order, StampOrder
from convseq_ros.core.map.online import OnlineMap, PreloadedMap
from convseq_ros.core.map.reference_map import ReferenceMap
from convseq_ros.core.pose.estimate import with_shift_and_yaw
from convseq_ros.core.pose.relative_pose import RelativePoses
from convseq_ros.core.retrieval.coarse_scores import Coarse, CoarseScores
from convseq_ros.core.similarity.matcher import Features, make_matcher, Matcher
from convseq_ros.core.similarity.overlap import PaperSimilarity
from convseq_ros.core.types import Anchor, Descriptor, Frame, Match, Reason, Status


class PlaceRecognizer:
    """
    Recognises places, frame by frame: ConvSequential-SLAM.

    Parameters
    ----------
    reference_map : ReferenceMap
        The places to recognise; it decides how frames are encoded. In online mode it grows.
    config : Config
        Its `sequence`, `acceptance` and `robot` may be replaced between two frames.
    matcher, coarse : Matcher, Coarse, optional
        They compute pair scores and coarse scores; by default as `config.matching` selects.
    describe : Describe, optional
        The descriptor model of the map, from an image to a vector; none for the built-in one.

    Raises
    ------
    ConfigError
        If `describe` is not the map's model, or `matching` needs cells and the map has none.

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
        # Only a query's regions are selected by saliency, so this threshold is not the map's.
        threshold = config.encoding.saliency_threshold
        self._encoding = replace(reference_map.encoding, saliency_threshold=threshold)
        length = reference_map.global_descriptors.shape[1]
        self.first_stage = FirstStage(describe, reference_map.encoding, length)
        self.model_ms = 0.0  # how long the descriptor model took for the newest frame
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
        self.order, self._count, self._blank = StampOrder(), 0, blank_descriptor(self._encoding)
        self.localizer = Localizer(reference_map)
        self.only_maps = False  # whether frames are added to the map without being recognised
        self._last: Match | None = None  # the answer to the newest keyframe

    def process(self, frame: Frame, descriptor: Descriptor | None = None) -> Match:
        """
        Return the places that the next frame may show, and whether the best one is a match.

        Frames come in order. A frame up to a second late is skipped. A later one means that the
        clock jumped back: the buffer is emptied and a new session begins. `descriptor` is that of
        the frame, if it is already computed.

        Departures from the paper: (1) in online mode the frame is then added to the map; between
        keyframes (2) and while the robot stands still (3) the last answer is repeated; (4) a
        dropped frame leaves an empty slot in the sequence.
        """
        match = self._match(upright(frame, self._encoding, self.config.robot), descriptor)
        return self.localizer.update(match, self.mapping.session_start, self.config)

    def _verdict(self, frame: Frame, descriptor: Descriptor | None) -> Verdict:
        """Return whether a frame is a keyframe, with its descriptor."""

        def encode() -> Descriptor:  # III-B, III-C: entropy, and histograms of gradients
            if descriptor is None and frame.gray is not None:
                return describe(frame.gray, self._encoding)
            return descriptor or self._blank

        return self.gate.check(frame.stamp_ns, frame.pose, encode, frame.gray)

    def _match(self, frame: Frame, descriptor: Descriptor | None) -> Match:
        new_match, self._count = partial(Match, self._count, frame.stamp_ns), self._count + 1
        self.model_ms = 0.0
        if (order := self.order.check(frame.stamp_ns)) is Order.LATE:
            return new_match(Status.SKIPPED, Reason.OUT_OF_ORDER)
        if order is Order.JUMPED_BACK:
            self.reset()
            self.mapping.reset()
            self.order.check(frame.stamp_ns)
            self.resets += 1
        verdict = self._verdict(frame, descriptor)
        self.mapping.follow(verdict.passed)
        if verdict.reason:  # not a keyframe
            match = self._repeated(new_match, verdict.reason)
        else:
            verdict = replace(verdict, descriptor=self.first_stage.add(frame, verdict.descriptor))
            self.model_ms = self.first_stage.duration_ms
            if self.only_maps:
                self.mapping.add(frame, verdict.descriptor)
                return new_match(Status.SKIPPED, self.mapping.nothing_usable)
            match = self._last = self._recognize(new_match, frame, verdict)
            self.mapping.add(frame, verdict.descriptor, match)
        if frame.gray is None and descriptor is None:
            return new_match(Status.SKIPPED, Reason.UNREADABLE)
        return with_shift_and_yaw(match, frame, self.reference_map)

    def _recognize(self, new_match: partial[Match], frame: Frame, verdict: Verdict) -> Match:
        config, buffer = self.config, self.buffer
        # III-A: the newest frame joins the rolling buffer; a dropped frame leaves an empty slot.
        capacity = max(2, config.sequence.window)
        buffer.add_empty(verdict.missing, self._blank, capacity)
        usable = self.mapping.usable  # places [0, usable) may match
        buffer.append(verdict.descriptor, usable, capacity)
        if (features := buffer.newest.features) is None or not usable:
            reason = self.mapping.nothing_usable if features else Reason.UNINFORMATIVE
            return new_match(Status.SKIPPED, reason)
        # III-E, III-F: information gain and entropy choose k, the number of frames to match.
        length = choose_length(buffer.descriptors, self._similarity, config.sequence)
        # III-D, III-G, or the Bayes filter: score the likely places; is the best one a match?
        start = self.mapping.session_start
        query = Query(frame, buffer, usable, start, config, length, verdict.missing)
        decided, pairs = self.decider.decide(query), buffer.pairs_scored
        reason, denied_m = decided.reason, decided.implausible_m
        if not decided.candidates:
            return new_match(Status.SKIPPED, reason, (), decided.length, pairs)
        scored = decided.candidates, decided.length, pairs, decided.confidence
        match = new_match(Status.REJECTED, reason, *scored, implausible_m=denied_m)
        return self._complete(match, frame, features)

    def _complete(self, match: Match, frame: Frame, features: Features) -> Match:
        """Accept a match, unless it follows the last one too soon; measure its pose (ours)."""
        best, *others = match.candidates
        best = replace(best, shift=self.matcher.shift(features, best.reference_index))
        match = replace(match, candidates=(best, *others))
        if match.reason is not Reason.ACCEPTED:
            return match
        interval_ns = round(self.config.acceptance.closure_interval_s * 1e9)
        if self._accepted_ns is not None and frame.stamp_ns - self._accepted_ns < interval_ns:
            return replace(match, reason=Reason.COOL_DOWN)
        self._accepted_ns = frame.stamp_ns
        pose, places = self._poses.measure(features, frame, best), self.reference_map.places
        place = places[self.reference_map.links.anchor(best.reference_index)]
        anchor = Anchor(self.reference_map.sessions[place.session].id, place.stamp_ns)
        return replace(match, status=Status.ACCEPTED, relative_pose=pose, anchor=anchor)

    def _repeated(self, new_match: partial[Match], reason: Reason) -> Match:
        """Return the last keyframe's answer, not as a match: this frame is not a keyframe."""
        last = self._last
        if reason is Reason.UNINFORMATIVE or last is None or not last.candidates:
            return new_match(Status.SKIPPED, reason)
        repeated = last.candidates, last.sequence_length, 0, last.confidence
        return new_match(Status.REJECTED, reason, *repeated)

    def reset(self) -> None:
        """Forget the frames so far; the map stays, and frames are counted on."""
        self._last = self._accepted_ns = None
        stages = self.order, self.gate, self.matcher, self.buffer, self.decider, self.localizer
        for stage in stages:
            stage.reset()
