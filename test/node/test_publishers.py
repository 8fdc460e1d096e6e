# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What is published of one frame, without a node."""

from types import SimpleNamespace

from convseq_ros.config.node_config import NodeConfig
from convseq_ros.core.encoding.descriptor import describe
from convseq_ros.core.map.reference_map import ReferenceMap
from convseq_ros.core.recognizer import PlaceRecognizer
from convseq_ros.core.types import Candidate, Frame, Match, Pose, PoseEstimate, Reason
from convseq_ros.node.outputs.publishers import Answered, MatchPublishers
import numpy as np
from pictures import scene
import pytest

HERE = Pose((1.0, 2.0, 0.0), (0.0, 0.0, 0.0, 1.0))


@pytest.fixture
def publish():
    """Return a function that publishes an answer, and returns the messages by topic."""
    places, gray = ReferenceMap(), scene(1)
    places.add_frame(Frame(100, gray, pose=HERE), describe(gray, places.encoding), 128)
    recognizer = PlaceRecognizer(places)
    frame = Frame(2_000_000_000, gray)
    recognizer.process(frame)

    def run(reason, confidence, pose=None):
        messages = {}

        def create_publisher(_kind, topic, *_args, **_more):
            heard = messages.setdefault(topic, [])
            return SimpleNamespace(publish=heard.append, get_subscription_count=lambda: 1)

        candidates = (Candidate(0, 100, 0.75),)
        stamp_ns = frame.stamp_ns
        match = Match(7, stamp_ns, reason, candidates, 3, confidence=confidence, pose=pose)
        answered = Answered(frame, match, recognizer, 1, 0.0, 4.0, 12.5)
        node = SimpleNamespace(create_publisher=create_publisher)
        MatchPublishers(node, NodeConfig(), str).publish(answered)
        return places.sessions[0].id, messages

    return run


def test_confidence_and_latency_are_plain_numbers_for_each_frame(publish):
    for reason, confidence, expected in (
        (Reason.ACCEPTED, 0.97, 0.97), (Reason.WEAK, 0.25, 0.25), (Reason.WEAK, None, 0.0),
    ):  # fmt: skip
        _, messages = publish(reason, confidence)
        (told,), (latency,) = messages['~/confidence'], messages['~/latency_ms']
        assert told.data == pytest.approx(expected) and latency.data == 12.5
        assert [one.data for one in messages['~/match_score']] == [0.75]


def test_a_closure_is_published_as_odometry_if_and_only_if_the_frame_is_accepted(publish):
    session, messages = publish(Reason.ACCEPTED, 0.97)
    (closure,) = messages['~/closure_odometry']
    assert closure.header.stamp.sec == 2
    assert closure.header.frame_id == f'{session}/100'
    assert closure.child_frame_id == '/2000000000'
    _, messages = publish(Reason.AMBIGUOUS, 0.6)
    assert messages['~/closure_odometry'] == []


def test_the_pose_of_a_match_is_published_with_the_error_of_the_map(publish):
    ahead = Pose((5.0, 2.0, 0.0), HERE.orientation)
    _, messages = publish(Reason.ACCEPTED, 0.97, PoseEstimate(ahead, np.eye(6) * 0.01))
    (told,) = messages['~/pose']
    assert told.pose.pose.position.x == 5.0
    # 0.5 m of the map and 0.1 m; across, 0.1 rad of the map's heading are 0.4 m more.
    variances = np.array(told.pose.covariance).reshape(6, 6).diagonal()
    assert variances[:2] == pytest.approx([0.26, 0.42]) and variances[5] == pytest.approx(0.02)
    assert publish(Reason.ACCEPTED, 0.97)[1]['~/pose'] == []
