# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Publishes a recording or a folder of pictures to a live topic, with /clock."""

import argparse
from collections.abc import Iterator
import math
from pathlib import Path
import signal
import struct
import sys
import time

from convseq_ros.errors import ConvseqError, SourceError
from convseq_ros.node.conversions import image_message, stamp_from_ns
from convseq_ros.sources import open_source, Source
from convseq_ros.sources.raw_message import RawMessage
from convseq_ros.sources.recording import Recording
import rclpy
from rclpy.duration import Duration
from rclpy.node import Node
from rclpy.publisher import Publisher
from rclpy.qos import QoSProfile, ReliabilityPolicy
from rclpy.utilities import ok, remove_ros_args, try_shutdown
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import CompressedImage, Image
from std_msgs.msg import Header

_TICK_S = 0.01
# Fast DDS sends what is larger than this in fragments, acknowledged at once; what is smaller is
# acknowledged every 3 s only, and so needs the longer history instead of pauses.
_FRAGMENTED_BYTES = 65_000
_DEPTH_FRAGMENTED, _UNACKNOWLEDGED = 100, 50
_DEPTH_WHOLE = 1000
_ACKNOWLEDGE_S, _ACKNOWLEDGE_POLL_S = 10.0, 0.2
_COMPRESSED = '/compressed'


class Player(Node):
    """
    Plays a source once, or again and again.

    Parameters
    ----------
    source : Source
        What to play.
    options : Namespace
        As `parser` makes them.

    """

    def __init__(self, source: Source, options: argparse.Namespace) -> None:
        super().__init__('convseq_player')
        self._source = source
        self._options = options
        self._sent = 0
        compressed = getattr(source, 'type_name', '').endswith('CompressedImage')
        topic = self.resolve_topic_name(options.image_topic)
        if compressed and not topic.endswith(_COMPRESSED):
            topic += _COMPRESSED
        best_effort = options.best_effort
        reliability = ReliabilityPolicy.BEST_EFFORT if best_effort else ReliabilityPolicy.RELIABLE
        self._large = _first_size(source) > _FRAGMENTED_BYTES
        depth = _DEPTH_FRAGMENTED if self._large else _DEPTH_WHOLE
        self._images: Publisher = self.create_publisher(
            CompressedImage if compressed else Image,
            topic,
            QoSProfile(depth=depth, reliability=reliability),
        )
        self._clock_topic: Publisher = self.create_publisher(
            Clock, '/clock', QoSProfile(depth=1, reliability=ReliabilityPolicy.BEST_EFFORT)
        )

    def play(self) -> None:
        """
        Wait for a subscriber, then publish until the end and until all of it has arrived.

        Raises
        ------
        ConvseqError
            If nobody subscribes, the source is damaged or too short, or images did not arrive.

        """
        self._wait_for_subscriber()
        while self.context.ok():
            self._play_once()
            if not self._options.loop:
                break
        self._acknowledge()

    def _wait_for_subscriber(self) -> None:
        limit_s = self._options.wait_subscribers
        deadline_s = time.monotonic() + limit_s
        while limit_s and self.context.ok() and not self._images.get_subscription_count():
            if time.monotonic() > deadline_s:
                raise ConvseqError(
                    f'{self._images.topic_name}: nobody subscribes after {limit_s:g} s; '
                    'start vpr_node, or play to nobody with --wait-subscribers 0'
                )
            time.sleep(_TICK_S)

    def _play_once(self) -> None:
        timeline: Timeline | None = None
        for stamp_ns, message in _from(_messages(self._source), self._options.start):
            timeline = timeline or Timeline(stamp_ns, self._options.rate)
            while (left_s := self._tick(timeline, stamp_ns)) > 0:
                time.sleep(min(left_s, _TICK_S))
            if not self.context.ok():
                return
            self._images.publish(message)
            self._sent += 1
            if self._sent == 1:
                # A subscriber that we know need not know us yet: time begins when it has answered.
                self._acknowledge()
                timeline = Timeline(stamp_ns, self._options.rate)
            elif self._large and self._sent % _UNACKNOWLEDGED == 0:
                self._acknowledge()
            _progress(self._sent, len(self._source), self._options.loop)
        if timeline is None:
            raise SourceError(
                f'{self._source.name}: no images from --start {self._options.start:g} s on'
            )

    def _tick(self, timeline: 'Timeline', stamp_ns: int) -> float:
        """Publish the time and return how many seconds are left until a stamp."""
        if not self.context.ok():
            return 0.0
        now_ns = timeline.now_ns()
        self._clock_topic.publish(Clock(clock=stamp_from_ns(now_ns)))
        left_ns: float = (stamp_ns - now_ns) / self._options.rate
        return left_ns / 1e9

    def _acknowledge(self) -> None:
        """Wait until every subscriber has what was sent, so that none of it is pushed out."""
        deadline_s = time.monotonic() + _ACKNOWLEDGE_S
        poll = Duration(seconds=_ACKNOWLEDGE_POLL_S)
        while self.context.ok() and not self._images.wait_for_all_acked(poll):
            if time.monotonic() > deadline_s:
                raise ConvseqError(
                    f'{self._images.topic_name}: a subscriber does not acknowledge what was sent'
                )


class Timeline:
    """
    The time of the recording while it is played.

    Parameters
    ----------
    begin_ns : int
        Its time now, nanoseconds.
    rate : float
        Seconds of the recording in a second.

    """

    def __init__(self, begin_ns: int, rate: float) -> None:
        self._begin_ns = begin_ns
        self._rate = rate
        self._started_ns = time.monotonic_ns()

    def now_ns(self) -> int:
        """Return the time of the recording."""
        return self._begin_ns + round((time.monotonic_ns() - self._started_ns) * self._rate)


def _messages(source: Source) -> Iterator[tuple[int, bytes | Image]]:
    """Yield stamps and messages; a stamp of zero, which ROS takes for none, is filled in."""
    if isinstance(source, Recording):
        for message in source.messages():
            yield message.stamp_ns, _stamped(message)
        return
    for frame in source:
        if frame.gray is not None:
            stamp = stamp_from_ns(frame.stamp_ns)
            yield frame.stamp_ns, image_message(frame.gray, Header(stamp=stamp))


def _first_size(source: Source) -> int:
    """Return the bytes of the first image, which tell how large the others are; 0 for none."""
    for _, message in _messages(source):
        return len(message) if isinstance(message, bytes) else len(message.data)
    return 0


def _stamped(message: RawMessage) -> bytes:
    if message.header_stamp_ns:
        return message.cdr
    cdr = bytearray(message.cdr)
    stamp = stamp_from_ns(message.stamp_ns)
    struct.pack_into('<iI' if cdr[1] & 1 else '>iI', cdr, 4, stamp.sec, stamp.nanosec)
    return bytes(cdr)


def _from(
    messages: Iterator[tuple[int, bytes | Image]], start_s: float
) -> Iterator[tuple[int, bytes | Image]]:
    """Leave out what lies less than some seconds after the first stamp."""
    begin_ns: int | None = None
    for stamp_ns, message in messages:
        if begin_ns is None:
            begin_ns = stamp_ns + round(start_s * 1e9)
        if stamp_ns >= begin_ns:
            yield stamp_ns, message


def _progress(sent: int, total: int, loop: bool) -> None:
    if sys.stderr.isatty():
        print(f'\r{sent}{"" if loop else f" / {total}"} images', end='', file=sys.stderr)


def parser() -> argparse.ArgumentParser:
    """Return the command line's parser."""
    result = argparse.ArgumentParser(
        prog='convseq play',
        description='Publish the images of a recording, or of a folder of pictures, and /clock.',
    )
    result.add_argument('recording', type=Path, metavar='RECORDING')
    result.add_argument('--topic', default='', help='image topic of the recording, if several')
    result.add_argument(
        '--image-topic', default='/image', metavar='NAME',
        help='topic to publish on; compressed images go to NAME/compressed (default: /image)',
    )
    result.add_argument(
        '--rate', type=_positive, default=1.0, metavar='FACTOR', help='speed (default: 1)'
    )
    result.add_argument(
        '--start', type=_seconds, default=0.0, metavar='S', help='leave out the first S seconds'
    )
    result.add_argument('--loop', action='store_true', help='start again at the end')
    result.add_argument(
        '--best-effort', action='store_true',
        help='publish as many camera drivers do; images may be lost (default: reliable)',
    )
    result.add_argument(
        '--wait-subscribers', type=_seconds, default=10.0, metavar='S',
        help='wait up to S seconds for a subscriber; 0: do not wait (default: 10)',
    )
    return result


def _seconds(text: str) -> float:
    value = float(text)
    if not 0.0 <= value < math.inf:
        raise argparse.ArgumentTypeError(f'{text} is not a number of seconds from 0 on')
    return value


def _positive(text: str) -> float:
    value = float(text)
    if not 0.0 < value < math.inf:
        raise argparse.ArgumentTypeError(f'{text} is not a number above 0')
    return value


def main(args: list[str] | None = None) -> int:
    """Play until the end, or until SIGINT or SIGTERM; return the exit code."""
    argv = sys.argv if args is None else ['convseq play', *args]
    options = parser().parse_args(remove_ros_args(argv)[1:])
    # As in vpr_node: rclpy's own handler stops the playing, nothing is raised in between.
    signal.signal(signal.SIGINT, lambda *_: None)
    try:
        source = open_source(options.recording, options.topic)
        rclpy.init(args=argv)
        player = Player(source, options)
        player.play()
    except (ConvseqError, OSError) as error:
        print(f'convseq play: {error}', file=sys.stderr)
        return 1
    except RuntimeError:
        # Publishing fails while a signal shuts ROS down.
        if ok():
            raise
    finally:
        try_shutdown()
    for warning in source.warnings:
        print(f'convseq play: {warning}', file=sys.stderr)
    return 0


if __name__ == '__main__':
    sys.exit(main())
