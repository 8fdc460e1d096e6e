# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The stamps of live images, and whether they tell when the images were taken."""

from collections import defaultdict, deque
from functools import partial

from convseq_ros.sources.raw_message import RawMessage
from convseq_ros.sources.stamps import FIRST, useless
from rclpy.node import Node


class Stamps:
    """Reads the stamps of each camera; `problem` is one line, empty while they are right."""

    def __init__(self, node: Node) -> None:
        self._clock, self._logger = node.get_clock(), node.get_logger()
        self._newest = defaultdict[str, deque[tuple[int, int]]](partial(deque, maxlen=FIRST))
        self._problems = dict[str, str]()

    @property
    def problem(self) -> str:
        return next(filter(None, self._problems.copy().values()), '')

    def of(self, message: RawMessage, arrival_ns: int, topic: str) -> int:
        """Return when an image was taken, nanoseconds: its stamp, or now if it has none."""
        if not (stamp_ns := message.header_stamp_ns):
            self._logger.warning(
                f'{topic}: images have no stamp, so the time of arrival is taken; mend the driver',
                once=True,
            )
            return int(self._clock.now().nanoseconds)
        newest = self._newest[topic]
        newest.append((stamp_ns, arrival_ns))
        found = useless(*zip(*newest, strict=True)) if len(newest) == FIRST else ''
        if found:
            line = (
                f'{topic}: {FIRST} images in a row have {found}; poses by odometry and ages of '
                'places are wrong: have the driver stamp each image when it is taken'
            )
            if topic not in self._problems:
                self._logger.warning(line)
            self._problems[topic] = line
        elif topic in self._problems:
            self._problems[topic] = ''
        return stamp_ns
