# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""All that is said of a frame, and of the map, each in one message that anybody can read."""

from collections.abc import Mapping

from convseq_ros.core.map.format import FORMAT_VERSION
from convseq_ros.core.map.reference_map import ReferenceMap
from convseq_ros.core.types import Match
from convseq_ros.node.conversions import match_header, stamp_from_ns
from convseq_ros.node.map_news import MapNews
from convseq_ros.node.qos import LATCHED
from convseq_ros.results import row
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from rclpy.node import Node
from std_msgs.msg import Header


def answer_message(
    match: Match,
    duration_ms: float,
    reference_map: ReferenceMap,
    frame_id: str,
    model_ms: float = 0.0,
) -> DiagnosticArray:
    """
    Return the row of the result table, as names and values, with the ids of map and session.

    `reference_map` is that of the candidates, `frame_id` the frame of its poses. If it has a
    `descriptor_model`, that took `model_ms` of the time.
    """
    values = {**row(match, duration_ms), 'map_id': reference_map.map_id}
    if reference_map.encoding.descriptor_model:
        values['model_ms'] = round(model_ms, 3)
    best = match.best
    if best:
        values['session_id'] = reference_map.sessions[best.session].id
    return _message(match_header(match, frame_id), match.reason.value, values)


class MapInfo:
    """Tells on `~/map_info` which map is in use, also whoever comes late; again while it grows."""

    def __init__(self, node: Node) -> None:
        self._publisher = node.create_publisher(DiagnosticArray, '~/map_info', LATCHED)
        self._news = MapNews()
        self._counted, self._posed = 0, 0

    def follow(self, reference_map: ReferenceMap, frame_id: str) -> None:
        """Tell, if there is news, and at most every 5 s of the same map."""
        if reference_map is not self._news.told:
            self._counted = self._posed = 0
        if not self._news.update(reference_map):
            return
        new = reference_map.places[self._counted : len(reference_map)]
        self._counted += len(new)
        self._posed += sum(place.pose is not None for place in new)
        self._publisher.publish(map_info_message(reference_map, self._posed, frame_id))


def map_info_message(reference_map: ReferenceMap, posed: int, frame_id: str) -> DiagnosticArray:
    """Return what a map is, of whose places so many have a pose."""
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
    return _message(Header(stamp=stamp, frame_id=frame_id), text, values)


def _message(header: Header, text: str, values: Mapping[str, object]) -> DiagnosticArray:
    pairs = [
        KeyValue(key=name, value='' if value is None else str(value))
        for name, value in values.items()
    ]
    status = DiagnosticStatus(
        level=DiagnosticStatus.OK, name='convseq_ros', message=text, values=pairs
    )
    return DiagnosticArray(header=header, status=[status])
