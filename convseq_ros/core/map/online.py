# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Online mapping: the map grows while the robot drives."""

from array import array
from bisect import bisect_left

from convseq_ros.config import Config
from convseq_ros.core.encoding.first_stage import vector_of
from convseq_ros.core.encoding.glance import distance, GLANCE, Glance
from convseq_ros.core.graph.links import Links
from convseq_ros.core.graph.trail import Keyframe
from convseq_ros.core.map.pruning import Pruning, STRETCH
from convseq_ros.core.map.reference_map import ReferenceMap
from convseq_ros.core.types import Anchor, constants, Descriptor, Frame, Match, Reason, RECOGNISED


def recognised_place(match: Match | None) -> int | None:
    """Return the place that a match recognises; None if it recognises none."""
    if match is None or match.reason not in RECOGNISED or match.best is None:
        return None
    return match.best.reference_index


def link(links: Links, place: int, match: Match | None) -> None:
    """Link a place to the one that its match recognises, or mark it as looked up."""
    other = recognised_place(match)
    if match and match.best and other is not None:
        links.add(place, other, match.confidence, match.best.inliers, match.relative_pose)
    elif match:
        links.add_first(place)


@constants
class RECENT:
    """Which places of the running drive are too recent to be matched."""

    # Scenes that the drive must be past a place, so laps of 5 s and of 5 h are the same. Drives
    # that never return have no match with 20; 40 is no safer.
    keyframes: int = 20
    # After which a drive does not go on, here and in a pose graph; a restart takes some seconds.
    paused_ns: int = 30_000_000_000


class Scenes:
    """Counts scenes over a drive; noise alone makes keyframes of one scene, but no scenes."""

    def __init__(self) -> None:
        self.passed = 0
        self._last: Glance | None = None  # of the last scene

    def count(self, edges: Glance | None) -> None:
        """Take in a keyframe; it is a new scene if its glance is far from that of the last one."""
        if edges is None or self._last is None or distance(edges, self._last) > GLANCE.moved:
            self.passed, self._last = self.passed + 1, edges


class PreloadedMap:
    """A map that does not grow: all of its places may be matched."""

    nothing_usable = Reason.NO_MAP  # the reason of a frame while no place may be matched
    is_recognising = True  # whether frames are matched with its places at all, or only added

    def __init__(self, reference_map: ReferenceMap) -> None:
        self._map = reference_map
        self.reset()

    def reset(self) -> None:
        """Begin a new session, at the end of the map."""
        # First place of this session, and of this drive, which may have begun in the one before.
        self.session_start = self.drive_start = len(self._map)

    @property
    def usable(self) -> int:
        """How many places, from the first, may be matched."""
        return len(self._map)

    def follow(self, edges: Glance | None, stamp_ns: int) -> None:
        """Take in the glance of the next keyframe, if it has one."""

    def add(self, frame: Frame, descriptor: Descriptor, _match: Match | None = None) -> None:
        """Add nothing."""

    def freeze(self) -> None:
        """Add nothing from now on."""


class OnlineMap(PreloadedMap):
    """
    A map that grows by the frames of this session; recent places may not be matched.

    Without `is_recognising` no place may be: nothing is recognised, so that maps are built sooner.
    """

    nothing_usable = Reason.RECENT

    def __init__(
        self,
        reference_map: ReferenceMap,
        config: Config,
        name: str = '',
        frame: str = '',
        is_recognising: bool = True,
    ) -> None:
        self.is_recognising = is_recognising
        self._name, self._frame = name, frame or None  # name of the session, frame of its poses
        self._pruning = Pruning(reference_map, config.online.max_looks)
        keyframes = config.keyframes
        self._kept = keyframes.thumbnail_width_px, keyframes.keep_images_px, keyframes.keypoints
        self._is_frozen = False
        super().__init__(reference_map)
        self.begin(len(reference_map))

    def begin(self, start: int) -> None:
        """Begin a session by the index of its first place; all places before may be matched."""
        self.reset()
        self.session_start = self.drive_start = self._usable = self._first = start
        # Scenes so far, and at each place from the first of this drive on.
        self._scenes, self._passed_at = Scenes(), array('q')

    def reset(self) -> None:
        """Begin a new session; places of the last one stay recent, as the robot goes on."""
        super().reset()
        self._has_session = False
        self._skipping = 0  # number of frames that are still to be left out

    @property
    def usable(self) -> int:
        """How many places, from the first, are old enough to be matched."""
        return self._usable

    def follow(self, edges: Glance | None, stamp_ns: int) -> None:
        if not self._scenes.passed:
            self._go_on(stamp_ns)
        self._scenes.count(edges)
        oldest = self._scenes.passed - RECENT.keyframes
        self._usable = self._first + bisect_left(self._passed_at, oldest)

    def _go_on(self, stamp_ns: int) -> None:
        """Go on with the drive of a session that ended a moment ago, as before a restart."""
        start = self.session_start
        if not start:
            return
        if not 0 <= stamp_ns - self._map.places[start - 1].stamp_ns <= RECENT.paused_ns:
            return
        self._first = self._map.bounds.around(start - 1, RECENT.keyframes - 1).start
        self._passed_at = array('q', range(self._first - start + 1, 1))  # each place as a scene
        self.drive_start = self._map.bounds.span(start - 1)[0]

    def add(self, frame: Frame, descriptor: Descriptor, _match: Match | None = None) -> None:
        """
        Add a readable frame to the map, and link it to the place that its match recognises.

        If the place has `max_looks` stretches and the frame is similar to one of them, no frame is
        added for a stretch while places are recognised. Surplus ones go when the map is closed.
        """
        if self._is_frozen or frame.gray is None:
            return
        is_skipped = self._skips(recognised_place(_match), descriptor)
        is_odometry = frame.pose is not None and frame.pose.variances is not None
        if not self._has_session and (is_odometry or not is_skipped):
            self._map.begin_session(frame.stamp_ns, frame.camera, self._name, self._frame)
            self._has_session = True
        if is_odometry:
            self._map.trail.add(self._keyframe(frame, _match))
        if is_skipped:
            return
        self._map.add_frame(frame, descriptor, *self._kept)
        self._passed_at.append(self._scenes.passed)
        link(self._map.links, len(self._map) - 1, _match)

    def _keyframe(self, frame: Frame, match: Match | None) -> Keyframe:
        """Return a frame with odometry, and the closure that is told of it, if any."""
        assert frame.pose
        sessions, accepted, other = self._map.sessions, match and match.accepted, None
        if accepted:
            other = Anchor(sessions[accepted.session].id, accepted.reference_stamp_ns)
        relative = match.relative_pose if match else None
        return Keyframe(sessions[-1].id, frame.stamp_ns, frame.pose, other, relative)

    def freeze(self) -> None:
        self._is_frozen = True

    def _skips(self, place: int | None, descriptor: Descriptor) -> bool:
        self._skipping -= 1
        if place is None:
            self._skipping = 0
        elif self._skipping <= 0 and not (
            (len(self._map) - self.session_start) % STRETCH.keyframes
        ):
            vector = vector_of(descriptor)
            self._skipping = 0 if self._pruning.has_room(place, vector) else STRETCH.keyframes
        return self._skipping > 0


class FollowedMap(PreloadedMap):
    """A map that grows by the frames of another camera of the same robot, the leader."""

    def __init__(self, reference_map: ReferenceMap, leader: PreloadedMap) -> None:
        self._leader, self.nothing_usable = leader, leader.nothing_usable
        super().__init__(reference_map)

    def reset(self) -> None:
        self.session_start = self._leader.session_start
        self.drive_start = self._leader.drive_start

    @property
    def usable(self) -> int:
        """How many places the leader may match."""
        return self._leader.usable

    def follow(self, _edges: Glance | None, _stamp_ns: int) -> None:
        """Follow the leader's session; it counts the scenes itself."""
        self.reset()


def mapping_of(reference_map: ReferenceMap, config: Config) -> PreloadedMap:
    """Return how a map is used in the mode of a configuration."""
    grows = config.online.grows
    return OnlineMap(reference_map, config) if grows else PreloadedMap(reference_map)
