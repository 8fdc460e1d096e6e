# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The algorithm, frame by frame; Roman numerals are sections of the paper."""

from dataclasses import replace
from functools import partial

from convseq_ros.config import Config
from convseq_ros.core.decision.belief_decider import BeliefDecider
from convseq_ros.core.decision.decider import Answer, Decider, Query
from convseq_ros.core.decision.localizer import Localizer
from convseq_ros.core.decision.paper.decider import PaperDecider
from convseq_ros.core.decision.paper.pair_score import PaperMatcher
from convseq_ros.core.encoding.descriptor import blank_descriptor, describe
from convseq_ros.core.encoding.first_stage import Describe, FirstStage
from convseq_ros.core.gate.gate import FrameGate, Order, StampOrder
from convseq_ros.core.geometry.map_view import MapView, upright
from convseq_ros.core.map.online import FollowedMap, mapping_of, PreloadedMap
from convseq_ros.core.map.reference_map import ReferenceMap
from convseq_ros.core.pose.camera_check import CameraCheck
from convseq_ros.core.pose.estimate import places_near, with_pose
from convseq_ros.core.pose.relative_pose import RelativePoses, with_shift_and_yaw
from convseq_ros.core.retrieval.coarse_scores import AllPlaces, CoarseScores
from convseq_ros.core.sequence.query_buffer import QueryBuffer
from convseq_ros.core.similarity.matcher import make_matcher
from convseq_ros.core.similarity.scorer import Features, Scorer
from convseq_ros.core.types import (
    Anchor,
    Candidate,
    Descriptor,
    Doubles,
    Frame,
    Match,
    PoseEstimate,
    Reason,
    RECOGNISED,
    Row,
)
from convseq_ros.errors import ConfigError
import numpy as np


class PlaceRecognizer:
    """
    Recognises places, frame by frame: ConvSequential-SLAM.

    One thread uses it at a time; several recognisers may share a map that does not grow. Another
    process opens the map itself.

    Parameters
    ----------
    reference_map : ReferenceMap
        The places to recognise; it decides how frames are encoded. In online mode it grows.
    config : Config
        `configure` may replace its `sequence`, `acceptance`, `motion` and `robot`.
    matcher : Scorer, optional
        It computes pair scores; by default as `config.matching` selects.
    describe : Describe, optional
        The descriptor model of the map, from an image to a vector; none for the built-in one.
    mapping : PreloadedMap, optional
        Which places may be matched, if any, and how the map grows; by default as `config.online`
        selects.
    leader : PlaceRecognizer, optional
        That of the robot's first camera, which alone adds places; its matches are shared.
    order : StampOrder, optional
        What becomes of frames that come late; by default they are skipped.

    Raises
    ------
    ConfigError
        If `reference_map` is no map, or `describe` is not its model.

    """

    def __init__(
        self,
        reference_map: ReferenceMap,
        config: Config = Config(),
        matcher: Scorer | None = None,
        describe: Describe | None = None,
        *,
        mapping: PreloadedMap | None = None,
        leader: 'PlaceRecognizer | None' = None,
        order: StampOrder | None = None,
    ) -> None:
        if not isinstance(reference_map, ReferenceMap):
            raise ConfigError(f'expected a map, got {reference_map!r:.80}; open_map opens a file')
        self.reference_map, self.config, self.resets = reference_map, config, 0
        # Only a query's regions are selected by saliency, so this threshold is not the map's.
        threshold = config.encoding.saliency_threshold
        self._encoding = replace(reference_map.encoding, saliency_threshold=threshold)
        length = reference_map.global_descriptors.shape[1]
        self.first_stage = FirstStage(describe, reference_map.encoding, length)
        self.model_ms = 0.0  # how long the descriptor model took for the newest frame
        self.gate = FrameGate(config, reference_map.keyframes)
        followed = leader and FollowedMap(reference_map, leader.mapping)
        self.mapping: PreloadedMap = mapping or followed or mapping_of(reference_map, config)
        self.matcher = matcher or _made_matcher(reference_map, config)
        self._buffer = QueryBuffer(self.matcher, reference_map.bounds)
        coarse = AllPlaces()
        if config.matching.search != 'exhaustive':
            coarse = CoarseScores(reference_map, config.matching.both_directions)
        self.decider: Decider = (
            BeliefDecider(reference_map, self.matcher, coarse, config)
            if config.believes
            else PaperDecider(reference_map, coarse, config)
        )
        if leader:
            self.decider.use_matches_of(leader.decider)
        self.camera_check = CameraCheck(reference_map)
        self.view = MapView(reference_map, self._encoding, config.online.grows)
        self._poses = RelativePoses(reference_map, self.matcher, config.reading)
        self._accepted_ns: int | None = None  # stamp of the newest accepted match
        self._order = order or StampOrder()
        self._count, self._blank = -1, blank_descriptor(self._encoding)
        self.localizer = Localizer(reference_map)
        self._last: Match | None = None  # the answer to the newest keyframe

    def process(self, frame: Frame, descriptor: Descriptor | None = None) -> Match:
        """
        Return the places that the next frame may show, and whether the best one is a match.

        Frames come in order. A frame up to a second late is skipped. A later one means that the
        clock jumped back: the buffer is emptied and a new session begins. `descriptor` is that of
        the frame, if it is already computed. ConfigError for anything but a `Frame`.

        Departures from the paper: (1) in online mode the frame is then added to the map; between
        keyframes (2) and while the robot stands still (3) the last answer is repeated; (4) a
        dropped frame leaves an empty slot in the sequence.
        """
        if not isinstance(frame, Frame):
            raise ConfigError(f'expected a Frame, got {type(frame).__name__}')
        self._count += 1
        is_mounted = bool(frame.camera and frame.camera.mount)
        frame = upright(frame, self._encoding, self.config.robot)
        self.camera_check.see(frame.camera, is_mounted)
        if descriptor is None:
            frame = self.view.brought(frame)
        match = self._match(frame, descriptor)
        return self.localizer.update(match, self.mapping.session_start)

    def _match(self, frame: Frame, descriptor: Descriptor | None) -> Match:
        """Return the answer to an upright frame, without the localisation."""
        self.model_ms = 0.0
        # 1. Frames that are late or unreadable go no further.
        if self._is_late(frame.stamp_ns):
            return self._as_match(frame, Answer(Reason.OUT_OF_ORDER))
        self.decider.follow(frame, self.config)
        if frame.gray is None and descriptor is None:
            self._leave_slot(frame)
            return self._as_match(frame, Answer(Reason.UNREADABLE))
        # 2. III-B, III-C: entropy, and histograms of gradients, if the frame may be a keyframe.
        encode = partial(self._described, frame, descriptor)
        verdict = self.gate.check(frame.stamp_ns, frame.pose, encode, frame.gray)
        if verdict.reason:
            repeated = self._as_match(frame, self._repeated(verdict.reason))
            return with_shift_and_yaw(repeated, frame, self.reference_map)
        self.mapping.follow(verdict.edges, frame.stamp_ns)
        # 3. A descriptor model describes the keyframe as well (ours).
        descriptor = self.first_stage.add(frame, verdict.descriptor)
        self.model_ms = self.first_stage.duration_ms
        if not self.mapping.is_recognising:
            self.mapping.add(frame, descriptor)
            return self._as_match(frame, Answer(self.mapping.nothing_usable))
        # 4. III-A: it joins the rolling buffer; dropped ones leave empty slots.
        usable = self.mapping.usable  # places [0, usable) may match
        self._buffer.add_empty(verdict.missing, self._blank, self.config.sequence.window)
        self._buffer.append(descriptor, usable, self.config.sequence.window)
        # 5. III-D to III-G, or the Bayes filter: is the best of the likely places a match?
        answer = self._decide(frame, usable, verdict.missing)
        # 6. An accepted match gets its pose relative to the place (ours).
        match = self._last = self._measured(frame, answer)
        # 7. The map grows (ours); then the camera has its pose in it.
        self.mapping.add(frame, descriptor, match)
        match = with_shift_and_yaw(match, frame, self.reference_map)
        return with_pose(match, self._buffer.newest.row, self.reference_map.places)

    def _decide(self, frame: Frame, usable: int, missing: int) -> Answer:
        """Return the answer to the newest keyframe; matches are apart in time."""
        features = self._buffer.newest.features
        if features is None:
            return Answer(Reason.UNINFORMATIVE)
        if not usable:
            return Answer(self.mapping.nothing_usable)
        start = self.mapping.session_start
        drive = self.mapping.drive_start
        asked = frame, features, self._buffer, usable, start, self.config, missing, drive
        query = Query(*asked, self.view.barred)
        answer = self.decider.decide(query)
        if answer.reason is not Reason.ACCEPTED:
            return answer
        interval_ns = round(self.config.acceptance.closure_interval_s * 1e9)
        if self._accepted_ns is not None and frame.stamp_ns - self._accepted_ns < interval_ns:
            return replace(answer, reason=Reason.COOL_DOWN)
        self._accepted_ns = frame.stamp_ns
        return answer

    def _measured(self, frame: Frame, answer: Answer) -> Match:
        """Return an answer as a match, with its best place's shift; if recognised, its pose."""
        match = self._as_match(frame, answer)
        features = self._buffer.newest.features
        if features is None or not match.candidates:
            return match
        best, *others = match.candidates
        best = replace(best, shift=self.matcher.shift(features, best.reference_index))
        match = replace(match, candidates=(best, *others))
        if match.reason not in RECOGNISED:
            return match
        match = replace(match, relative_pose=self._poses.measure(features, frame, best))
        if match.accepted is None:
            return match
        place = self.reference_map.places[self.reference_map.links.anchor(best.reference_index)]
        anchor = Anchor(self.reference_map.sessions[place.session].id, place.stamp_ns)
        shared = self.matcher.overlap(features, best.reference_index)
        return replace(match, anchor=anchor, overlap=shared)

    def _repeated(self, reason: Reason) -> Answer:
        """Return the last keyframe's answer, not as a match: this frame is not a keyframe."""
        last = self._last
        if reason is Reason.UNINFORMATIVE or last is None or not last.candidates:
            return Answer(reason)
        return Answer(reason, last.candidates, last.sequence_length, last.confidence)

    def _as_match(self, frame: Frame, answer: Answer) -> Match:
        """Return an answer to the newest frame as a match."""
        return Match(
            self._count,
            frame.stamp_ns,
            answer.reason,
            answer.candidates,
            answer.length,
            answer.pairs_scored,
            answer.confidence if answer.candidates else None,
            implausible_m=answer.implausible_m,
        )

    @property
    def pair_scores(self) -> Row | None:
        """Pair scores of the newest keyframe, (R,), NaN where not scored; None if it has none."""
        return self._buffer.newest.row if len(self._buffer) else None

    @property
    def features(self) -> Features | None:
        """Features of the newest keyframe for the matcher; None if it is uninformative."""
        return self._buffer.newest.features if len(self._buffer) else None

    def displacements(self, candidate: Candidate | None) -> Doubles:
        """Return the displacement field (n, 5) of the newest frame and a candidate."""
        features = self.features
        if features is None or candidate is None or candidate.shift is None:
            return np.zeros((0, 5))
        return self.matcher.field(features, candidate.reference_index, candidate.shift)

    def _is_late(self, stamp_ns: int) -> bool:
        """Return whether a frame comes late; begin anew if the clock jumped back."""
        order = self._order.check(stamp_ns)
        if order is Order.JUMPED_BACK:
            self.reset()
            self.mapping.reset()
            self._order.check(stamp_ns)
            self.resets += 1
        return order is Order.LATE

    def _described(self, frame: Frame, descriptor: Descriptor | None) -> Descriptor:
        """Return the descriptor of a readable frame."""
        if descriptor is None:
            assert frame.gray is not None
            encoding = self.view.encoding
            descriptor = describe(frame.gray, encoding) if encoding else self._blank
        return descriptor

    def _leave_slot(self, frame: Frame) -> None:
        """Leave an empty slot in the sequence for an unreadable frame, if it is a keyframe."""
        missing = self.gate.check_unreadable(frame.stamp_ns, frame.pose)
        if missing is not None:
            self._last = None
            for empty in (missing, 1):
                self._buffer.add_empty(empty, self._blank, self.config.sequence.window)

    def configure(self, config: Config) -> None:
        """Use other settings from now on; those of the map stay."""
        self.config = config
        self.gate.configure(config)

    def expect(self, estimate: PoseEstimate) -> int:
        """
        Begin anew, look first at places near a pose of the base, and return how many they are.

        With none, nothing changes. Half of the belief is at them, seen from above, by the
        covariance and the distance between places; the other half is anywhere. By the paper's
        method, which has no belief, it is `reset`.
        """
        places, weights = places_near(self.reference_map, estimate, self.mapping.usable)
        if len(places):
            self.reset()
            self.decider.expect(places, weights, self.mapping.drive_start)
        return len(places)

    def reset(self) -> None:
        """Forget the frames so far; the map stays, and frames are counted on."""
        self._last = self._accepted_ns = None
        stages = self._order, self.gate, self.matcher, self._buffer, self.decider, self.localizer
        for stage in stages:
            stage.reset()


def _made_matcher(reference_map: ReferenceMap, config: Config) -> Scorer:
    if config.matching.matching == 'regional':
        return PaperMatcher(reference_map)
    return make_matcher(reference_map, config)
