# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What RViz and Foxglove draw of a map: its places, its newest drive, closures, the match."""

from collections import deque
from collections.abc import Iterable, Sequence
import colorsys
import math
import time

from convseq_ros.core.map.format import FORMAT_VERSION
from convseq_ros.core.map.place import Place
from convseq_ros.core.map.reference_map import ReferenceMap
from convseq_ros.core.types import Match, Pose, PoseEstimate
from convseq_ros.node.conversions import (
    match_header,
    path_message,
    point_message,
    pose_only_message,
    row_message,
    stamp_from_ns,
)
from convseq_ros.node.qos import advertise, LATCHED
from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import Vector3
from nav_msgs.msg import Path
from rclpy.node import Node
from std_msgs.msg import ColorRGBA, Header
from visualization_msgs.msg import Marker, MarkerArray

_PERIOD_S = 5.0
_MOST_CLOSURES = 500
_MOST_PLACES = 5000
_GROWN_BY = 10
_SMALLEST_M, _LARGEST_M = 0.05, 0.5
_GOLDEN_SHARE = (math.sqrt(5) - 1) / 2  # of a circle: new hues stay far from earlier ones

Position = tuple[float, float, float]


class MapTopics:
    """Publishes `~/map_info` and `~/reference_path` at once, and every 5 s while a map grows."""

    def __init__(self, node: Node) -> None:
        self._info = advertise(node, DiagnosticArray, '~/map_info', LATCHED)
        self._path = advertise(node, Path, '~/reference_path', LATCHED)
        self._published: ReferenceMap | None = None
        self._length = self._posed = 0
        self._published_s = 0.0
        self._has_path = False

    def follow(self, reference_map: ReferenceMap, frame_id: str) -> None:
        """Publish a changed map; the path only if it has poses, or if the last one had."""
        length, now_s = len(reference_map), time.monotonic()
        if reference_map is not self._published:
            self._published, self._length, self._posed = reference_map, 0, 0
        elif length == self._length or now_s - self._published_s < _PERIOD_S:
            return
        new = reference_map.places[self._length : length]
        self._posed += sum(place.pose is not None for place in new)
        self._length, self._published_s = length, now_s
        self._info.publish(map_info_message(reference_map, self._posed, frame_id))
        drive = _newest_drive(reference_map)
        poses = ((place.stamp_ns, place.pose) for place in drive if place.pose)
        message = path_message(poses, frame_id)
        if message.poses or self._has_path:
            self._path.publish(message)
        self._has_path = bool(message.poses)


def map_info_message(reference_map: ReferenceMap, posed: int, frame_id: str) -> DiagnosticArray:
    """Return a description of a map; `posed` is the number of its places with a pose."""
    places, sessions = reference_map.places, reference_map.sessions
    values: dict[str, object] = {
        'map_id': reference_map.map_id,
        'format': FORMAT_VERSION,
        'places': len(places),
        'with_pose': posed,
        'sessions': len(sessions),
        'session_ids': ' '.join(session.id for session in sessions),
        'first_stamp_ns': places[0].stamp_ns if places else None,
        'last_stamp_ns': places[-1].stamp_ns if places else None,
        **reference_map.keyframes.spacing,
    }
    stamp = stamp_from_ns(places[-1].stamp_ns if places else 0)
    text = f'{len(places)} places, {posed} with a pose'
    return row_message(Header(stamp=stamp, frame_id=frame_id), text, values)


def _newest_drive(reference_map: ReferenceMap) -> Sequence[Place]:
    """Return the places of the newest drive with a pose, thinned out to 5000."""
    end = len(reference_map)
    for start in reversed(reference_map.bounds.starts.tolist()):
        step = max(1, math.ceil((end - start) / _MOST_PLACES))
        drive = reference_map.places[start:end:step]
        if any(place.pose for place in drive):
            return drive
        end = start
    return ()


class MatchMarkers:
    """
    Publishes `~/markers`, and builds them only while somebody subscribes.

    Closures are drawn as LIO-SAM draws them: namespaces loop_nodes and loop_edges. An edge needs
    the pose of the query in the map; without it only the reference is drawn.
    """

    def __init__(self, node: Node) -> None:
        self._publisher = advertise(node, MarkerArray, '~/markers')
        self._closures: deque[tuple[Position | None, Position]] = deque(maxlen=_MOST_CLOSURES)
        self._map: ReferenceMap | None = None
        self._drawn_places = self._watchers = 0

    def publish(
        self,
        match: Match,
        reference_map: ReferenceMap,
        estimate: PoseEstimate | None,
        query: Pose | None,
        frame_id: str,
    ) -> None:
        """Draw what changed; `query` is the camera's pose in the map by odometry, if known."""
        is_another = reference_map is not self._map
        if is_another:
            self._closures.clear()
            self._map = reference_map
        if estimate:
            self._closures.append((query.position if query else None, estimate.pose.position))
        watchers = self._publisher.get_subscription_count()
        is_new, self._watchers = is_another or watchers > self._watchers, watchers
        if not watchers:
            return
        header = match_header(match, frame_id)
        markers = [_match_marker(header, estimate)]
        if estimate or is_new:
            markers += closure_markers(header, self._closures)
        if is_new or len(reference_map) >= self._drawn_places + _GROWN_BY:
            markers.append(places_marker(header, reference_map.places))
            self._drawn_places = len(reference_map)
        self._publisher.publish(MarkerArray(markers=markers))


def closure_markers(
    header: Header, closures: Iterable[tuple[Position | None, Position]]
) -> list[Marker]:
    """Return spheres where closures are, and lines from queries to their references."""
    nodes = _marker(header, 'loop_nodes', Marker.SPHERE_LIST, (0.3, 0.3, 0.3), (0.0, 0.8, 1.0))
    edges = _marker(header, 'loop_edges', Marker.LINE_LIST, (0.1, 0.0, 0.0), (0.9, 0.9, 0.0))
    for query, reference in closures:
        ends = [point_message(position) for position in (query, reference) if position]
        nodes.points.extend(ends)
        edges.points.extend(ends if query else ())
    # RViz warns about lists without points; DELETE also removes those drawn before.
    for marker in (nodes, edges):
        if not marker.points:
            marker.action = Marker.DELETE
    return [nodes, edges]


def places_marker(header: Header, places: Sequence[Place]) -> Marker:
    """Return a dot for every place with a pose, thinned out to 5000, coloured by session."""
    step = max(1, math.ceil(len(places) / _MOST_PLACES))
    drawn = [place for place in places[::step] if place.pose]
    positions = [place.pose.position for place in drawn if place.pose]
    steps_m = sorted(map(math.dist, positions, positions[1:]))
    size = steps_m[len(steps_m) // 2] / 3 if steps_m else 0.0
    size = min(max(size, _SMALLEST_M), _LARGEST_M)
    marker = _marker(header, 'places', Marker.POINTS, (size, size, 0.0), (0.6, 0.6, 0.6))
    marker.points = [point_message(position) for position in positions]
    colours = {session: _colour(session) for session in {place.session for place in drawn}}
    marker.colors = [colours[place.session] for place in drawn] if len(colours) > 1 else []
    if not positions:
        marker.action = Marker.DELETE
    return marker


def _colour(session: int) -> ColorRGBA:
    """Return the colour of a session: grey, then hues a golden angle apart."""
    hue, strength = session * _GOLDEN_SHARE % 1.0, 0.6 if session else 0.0
    red, green, blue = colorsys.hsv_to_rgb(hue, strength, 0.9 if session else 0.6)
    return ColorRGBA(r=red, g=green, b=blue, a=1.0)


def _match_marker(header: Header, estimate: PoseEstimate | None) -> Marker:
    """Return an arrow where the match is, or its removal."""
    marker = _marker(header, 'match', Marker.ARROW, (1.5, 0.3, 0.3), (0.3, 0.9, 0.3))
    if estimate is None:
        marker.action = Marker.DELETE
    else:
        marker.pose = pose_only_message(estimate.pose)
    return marker


def _marker(
    header: Header, namespace: str, kind: int, scale: Position, colour: Position
) -> Marker:
    x, y, z = scale
    red, green, blue = colour
    marker = Marker(header=header, ns=namespace, type=kind, action=Marker.ADD)
    marker.pose.orientation.w = 1.0
    marker.scale = Vector3(x=x, y=y, z=z)
    marker.color = ColorRGBA(r=red, g=green, b=blue, a=1.0)
    return marker
