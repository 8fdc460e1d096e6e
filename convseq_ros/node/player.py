# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Publishes a recording or a folder of pictures on live topics, with /clock."""

import argparse
from collections import Counter
from collections.abc import Sequence
import sys
import time

from convseq_ros.node.process import check_logs, end_on_signal, hand_over, run_node

if __name__ == '__main__':
    # Before NumPy, OpenCV and rclpy are imported, which takes a second.
    run_node('convseq_ros.node.player')

from convseq_ros.config.reading_config import chosen_reading
from convseq_ros.errors import ConvseqError, one_line
from convseq_ros.node.conversions import stamp_from_ns
from convseq_ros.node.cues import Cue, cues_of, IMAGE, images_of
from convseq_ros.node.player_options import NAME, option, parser, SIDES
from convseq_ros.sources import open_source, Source
from convseq_ros.sources.recording import TopicMessages
import rclpy
from rclpy.duration import Duration
from rclpy.expand_topic_name import expand_topic_name
from rclpy.node import Node
from rclpy.publisher import Publisher
from rclpy.qos import QoSProfile, ReliabilityPolicy
from rclpy.signals import SignalHandlerOptions
from rclpy.utilities import ok, try_shutdown
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import CompressedImage, Image

_CLOCK = '/clock'
_TICK_S = 0.01
# Fast DDS sends larger messages in fragments, which are acknowledged at once. Smaller messages are
# acknowledged every 3 s only, so they need a longer history instead of pauses.
_FRAGMENTED_BYTES = 65_000
_DEPTH_FRAGMENTED, _UNACKNOWLEDGED = 100, 50
_DEPTH_WHOLE = 1000
_ACKNOWLEDGE_S, _ACKNOWLEDGE_POLL_S = 10.0, 0.2
_SIDES_WAIT_S, _SIDES_ACKNOWLEDGE_S = 2.0, 4.0


class Player(Node):
    """Plays a source once or in a loop; `options` are those of `parser`."""

    def __init__(self, source: Source, options: argparse.Namespace) -> None:
        super().__init__(NAME)
        self._source, self._options, self._sent = source, options, 0
        # Stamp of the first image of this round, and when it was sent (monotonic).
        self._begun: tuple[int, int] | None = None
        compressed = getattr(source, 'type_name', '').endswith('CompressedImage')
        best_effort = options.best_effort
        reliability = ReliabilityPolicy.BEST_EFFORT if best_effort else ReliabilityPolicy.RELIABLE
        reading = chosen_reading(options)
        self._beside = {
            name: TopicMessages(options.recording, side, types, option(name), reading)
            for name, (_, types) in SIDES.items()
            if (side := getattr(options, name))
        }
        beside = [messages.chosen.name for messages in self._beside.values()]
        self._refuse_same_names([source.topic or IMAGE, *beside, _CLOCK])
        first = next((cue.message for cue in images_of(source)), b'')
        size = len(first if isinstance(first, bytes) else first.data)
        self._large = size > _FRAGMENTED_BYTES
        depth = _DEPTH_FRAGMENTED if self._large else _DEPTH_WHOLE
        # Images last: a node that discovers them has discovered the others.
        self._sides: dict[str, Publisher] = {
            name: self.create_publisher(SIDES[name][0], messages.chosen.name, _DEPTH_WHOLE)
            for name, messages in self._beside.items()
        }
        self._images: Publisher = self.create_publisher(
            CompressedImage if compressed else Image,
            source.topic or IMAGE,
            QoSProfile(depth=depth, reliability=reliability),
        )
        self._clock_topic: Publisher = self.create_publisher(
            Clock, _CLOCK, QoSProfile(depth=1, reliability=ReliabilityPolicy.BEST_EFFORT)
        )

    def _refuse_same_names(self, published: Sequence[str]) -> None:
        """Raise a ConvseqError if two topics get one name; warn of a --remap that names none."""
        names = [self.resolve_topic_name(topic) for topic in published]
        for name, count in Counter(names).items():
            if count > 1:
                raise ConvseqError(f'{name}: two topics get this name; --remap one to another')
        for rule in self._options.remap:
            old = rule.partition(':=')[0]
            if not old.startswith('__') and expand_topic_name(old, NAME, '/') not in published:
                topics = ', '.join(published)
                print(
                    f'convseq play: --remap {rule}: no topic is {old}; those played are {topics}',
                    file=sys.stderr,
                )

    def play(self) -> None:
        """Publish everything and wait until it has arrived; ConvseqError if that fails."""
        self._wait_for_subscriber()
        while self.context.ok():
            self._play_once()
            if not self._options.loop:
                break
        self._acknowledge()
        self._acknowledge_sides()

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
        # A subscriber of images may not want the other topics: wait only briefly for those.
        deadline_s = time.monotonic() + min(limit_s, _SIDES_WAIT_S)
        for side in self._sides.values():
            while not side.get_subscription_count() and time.monotonic() < deadline_s:
                time.sleep(_TICK_S)

    def _play_once(self) -> None:
        self._begun, before = None, self._sent
        for cue in cues_of(self._source, self._options.start, self._beside):
            is_first = cue.kind == IMAGE and self._sent == before
            if is_first and before:
                self._begun = cue.stamp_ns, time.monotonic_ns()
            elif is_first:
                # A message lost at the start delays all that follow, for up to 3 s.
                self._acknowledge_sides()
                self._publish_time(cue.stamp_ns)
            self._wait_until(cue.stamp_ns)
            if not self.context.ok():
                return
            self._send(cue)
            if is_first and not before:
                # The subscriber may not have discovered us yet: time starts when it acknowledges.
                self._acknowledge()
                self._begun = cue.stamp_ns, time.monotonic_ns()
            _progress(self._sent, len(self._source), self._options.loop)

    def _send(self, cue: Cue) -> None:
        if cue.kind != IMAGE:
            self._sides[cue.kind].publish(cue.message)
            return
        self._images.publish(cue.message)
        self._sent += 1
        if self._large and self._sent % _UNACKNOWLEDGED == 0:
            self._acknowledge()

    def _wait_until(self, stamp_ns: int) -> None:
        """Publish the time, once it runs, until it reaches a stamp."""
        rate = self._options.rate
        while self._begun and self.context.ok():
            first_ns, begun_ns = self._begun
            now_ns = first_ns + round((time.monotonic_ns() - begun_ns) * rate)
            self._publish_time(now_ns)
            left_s = (stamp_ns - now_ns) / rate / 1e9
            if left_s <= 0:
                return
            time.sleep(min(left_s, _TICK_S))

    def _publish_time(self, now_ns: int) -> None:
        self._clock_topic.publish(Clock(clock=stamp_from_ns(now_ns)))

    def _acknowledge(self) -> None:
        """Wait until every subscriber has all messages, so that none is lost from the history."""
        deadline_s = time.monotonic() + _ACKNOWLEDGE_S
        poll = Duration(seconds=_ACKNOWLEDGE_POLL_S)
        while self.context.ok() and not self._images.wait_for_all_acked(poll):
            if time.monotonic() > deadline_s:
                raise ConvseqError(
                    f'{self._images.topic_name}: a subscriber has not heard all; is it running?'
                )

    def _acknowledge_sides(self) -> None:
        """Wait briefly until the subscribers of the other topics have all messages."""
        for side in self._sides.values():
            if self.context.ok():
                side.wait_for_all_acked(Duration(seconds=_SIDES_ACKNOWLEDGE_S))


def _progress(sent: int, total: int, loop: bool) -> None:
    if sys.stderr.isatty():
        print(f'\r{sent}{"" if loop else f" / {total}"} images', end='', file=sys.stderr)


def main(args: list[str] | None = None) -> int:
    """Play until the end, or until SIGINT or SIGTERM; return the exit code."""
    words = sys.argv[1:] if args is None else args
    end = words.index('--ros-args') if '--ros-args' in words else len(words)
    options = parser().parse_args(words[:end])
    rules = [word for rule in options.remap for word in ('-r', rule)]
    end_on_signal(0)
    try:
        source = open_source(options.recording, options.topic, chosen_reading(options))
        check_logs()
        try:
            ros_arguments = ['--ros-args', *rules, *words[end + 1 :]]
            rclpy.init(args=ros_arguments, signal_handler_options=SignalHandlerOptions.NO)
        except RuntimeError as error:
            raise ConvseqError(f'--remap or --ros-args: {one_line(error)}') from None
        hand_over(try_shutdown)
        Player(source, options).play()
    except (ConvseqError, OSError) as error:
        print(f'convseq play: {error}', file=sys.stderr)
        return 1
    except Exception:
        # Publishing fails while a signal shuts ROS down.
        if ok():
            raise
    finally:
        try_shutdown()
    for warning in source.warnings:
        print(f'convseq play: {warning}', file=sys.stderr)
    return 0
