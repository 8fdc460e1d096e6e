# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The options of `convseq play`."""

import argparse
import math
from pathlib import Path

from convseq_ros.config.arguments import Parser
from convseq_ros.config.reading_config import add_reading
from convseq_ros.errors import one_line
from convseq_ros.sources.topics import CAMERA_TYPES, ODOMETRY_TYPES
from nav_msgs.msg import Odometry
from rclpy.exceptions import InvalidTopicNameException
from rclpy.expand_topic_name import expand_topic_name
from rclpy.validate_full_topic_name import validate_full_topic_name
from sensor_msgs.msg import CameraInfo

NAME = 'convseq_player'  # of the node
SIDES = {'odom': (Odometry, ODOMETRY_TYPES), 'camera_info': (CameraInfo, CAMERA_TYPES)}


def parser() -> argparse.ArgumentParser:
    """Return the parser of `convseq play`."""
    result = Parser(
        prog='convseq play',
        description='Publish the images of a recording on their topic, or pictures on /image, '
        'and /clock.',
    )
    result.add_argument('recording', type=Path, metavar='RECORDING')
    result.add_argument('--topic', default='', help='image topic of the recording, if several')
    # A table of options reads better in few lines.
    # fmt: off
    for name, (kind, _) in SIDES.items():
        result.add_argument(option(name), default='', metavar='TOPIC',
            help=f'also publish this {kind.__name__} topic of the recording')
    result.add_argument('--remap', action='append', type=_rule, default=[], metavar='FROM:=TO',
        help='publish a topic under another name; may be given more than once')
    result.add_argument('--rate', type=_positive, default=1.0, metavar='FACTOR',
        help='speed (default: 1)')
    result.add_argument('--start', type=_seconds, default=0.0, metavar='S',
        help='leave out the first S seconds')
    result.add_argument('--loop', action='store_true', help='start again at the end')
    result.add_argument('--best-effort', action='store_true', help='publish as many camera '
        'drivers do; images may be lost (default: reliable)')
    result.add_argument('--wait-subscribers', type=_seconds, default=10.0, metavar='S',
        help='wait up to S seconds for a subscriber; 0: do not wait (default: 10)')
    # fmt: on
    add_reading(result)
    return result


def option(name: str) -> str:
    """Return the option that names the topic of a kind."""
    return '--' + name.replace('_', '-')


def _rule(text: str) -> str:
    old, _, new = text.partition(':=')
    if not (old and new) or ' ' in text:
        raise argparse.ArgumentTypeError(f'{text!r} is not of the form FROM:=TO')
    try:
        validate_full_topic_name(expand_topic_name(new, NAME, '/'))
    except (InvalidTopicNameException, ValueError) as error:
        raise argparse.ArgumentTypeError(one_line(error)) from None
    return text


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
