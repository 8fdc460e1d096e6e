# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Sends a recorded drive to a live node, none of it lost: for `convseq demo`, and for tests."""

from collections.abc import Iterator, Mapping
import heapq
from pathlib import Path
import sys
import time

from convseq_ros.node.conversions import type_name
from convseq_ros.sources.storage import open_storage, Storage
from nav_msgs.msg import Odometry
import rclpy
from rclpy.duration import Duration
from rclpy.node import Node
from rclpy.publisher import Publisher
from sensor_msgs.msg import CameraInfo, Image

_KINDS = {type_name(kind): kind for kind in (Image, Odometry, CameraInfo)}
_DEPTH, _UNACKNOWLEDGED = 1000, 50  # messages of a topic
_PATIENCE_S, _POLL_S = 60.0, 0.02


def send(node: Node, recording: Path, rate: float, topics: Mapping[str, str]) -> None:
    """
    Publish topics of a recording at `rate` times its speed, and wait until all has arrived.

    `topics` maps their names to those to publish, that of the images last: who has discovered
    these knows the others. TimeoutError if nobody subscribes, or a subscriber does not hear all.
    """
    (storage, *_), _ = open_storage(recording)
    publishers: dict[str, Publisher] = {
        old: node.create_publisher(_KINDS[storage.topics[old].type_name], new, _DEPTH)
        for old, new in topics.items()
    }
    _wait_for_subscribers(publishers)
    drive = (_messages(storage, old) for old in topics)
    begun: tuple[int, int] | None = None  # recorded and sent: the first image
    for number, (time_ns, old, cdr) in enumerate(heapq.merge(*drive, key=lambda sent: sent[0])):
        if begun:
            due_ns = begun[1] + (time_ns - begun[0]) / rate
            time.sleep(max(0.0, due_ns - time.monotonic_ns()) / 1e9)
        publishers[old].publish(cdr)
        # A subscriber may not have discovered us yet: time starts when it has the first image.
        if not begun or number % _UNACKNOWLEDGED == 0:
            _acknowledge(publishers)
        if not begun and old == [*topics][-1]:
            begun = time_ns, time.monotonic_ns()
    _acknowledge(publishers)


def _messages(storage: Storage, topic: str) -> Iterator[tuple[int, str, bytes]]:
    for message in storage.messages(topic):
        yield message.log_time_ns, topic, message.cdr


def _acknowledge(publishers: Mapping[str, Publisher]) -> None:
    for topic, publisher in publishers.items():
        if not publisher.wait_for_all_acked(Duration(seconds=_PATIENCE_S)):
            raise TimeoutError(f'{topic}: a subscriber has not heard all')


def _wait_for_subscribers(publishers: Mapping[str, Publisher]) -> None:
    until_s = time.monotonic() + _PATIENCE_S
    for topic, publisher in publishers.items():
        while not publisher.get_subscription_count():
            if time.monotonic() > until_s:
                raise TimeoutError(f'{topic}: nobody subscribes')
            time.sleep(_POLL_S)


def main() -> None:
    """Run with arguments: recording, rate, and FROM:=TO for each topic, that of images last."""
    recording, rate, *renamed = sys.argv[1:]
    rclpy.init(args=[])
    topics = dict(word.split(':=') for word in renamed)
    send(Node('drive_sender'), Path(recording), float(rate), topics)
    rclpy.shutdown()


if __name__ == '__main__':
    main()
