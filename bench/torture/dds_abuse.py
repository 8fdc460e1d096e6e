# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Messages over DDS that no driver sends, at any rate."""

from array import array
from collections.abc import Iterator
from pathlib import Path
import random

from convseq_ros.sources.images import ENCODINGS
from nav_msgs.msg import Odometry
import numpy as np
from sensor_msgs.msg import CameraInfo

from bench.torture import corpus
from bench.torture.attack import Try
from bench.torture.robot import greet, image, Robot, robot, unaccounted

ABOUT = (
    'Images of 1 x 1 to 8,000 x 6,000 px, in every encoding and in none, of lying sizes, with '
    'stamps of any time, in bursts of up to 300; odometry and camera_info of NaN and infinity'
)
ORACLE = (
    'every image is answered, or counted as dropped or, when the next comes, lost; nothing fails; '
    'below 2 GB; a good image is answered after each burst'
)
COUNT, PORTION, SHORT, SEED = 2_000, 500, 0, 16
_SIDES = (1, 2, 3, 16, 47, 64, 240, 480, 1_080, 2_160, 6_000, 8_000)
_MOST_PIXELS = 48_000_000
_MOST_MB = 2_000
_NEXT_S, _PATIENCE_S = 10.0, 60.0  # until the next image is sent, and all
_FLOATS = (0.0, 1.0, -1.0, 1e308, float('inf'), float('-inf'), float('nan'))


def run(count: int, seed: int, folder: Path) -> Iterator[Try]:
    """Send bursts, each followed by one good image."""
    draw = random.Random(seed)
    if not count:
        return
    with robot(folder, mode='online', map_path=folder / 'map.db', diagnostics_period_s=0.2) as one:
        sides = (
            one.node.create_publisher(Odometry, '/odom', 10),
            one.node.create_publisher(CameraInfo, '/camera_info', 10),
        )
        greet(one)
        sent = tried = 0
        while tried < count:
            burst = draw.choice((1, 1, 1, 5, 30, 300))
            message = _image(draw)
            if len(message.data) > 1_000_000:
                burst = min(burst, 10)
            sides[0].publish(_odometry(draw))
            sides[1].publish(_camera_info(draw))
            for _ in range(burst):
                one.camera.publish(message)
            sent += burst + 1
            tried += burst
            one.camera.publish(image(corpus.gray(sent), draw.randrange(1, 2**31) * 10**9))
            if not one.wait_for(lambda sent=sent: unaccounted(one, sent) <= 0, _NEXT_S):
                one.camera.publish(image(corpus.gray(sent), draw.randrange(1, 2**31) * 10**9))
                sent += 1
            problem = _problem(one, sent)
            name = f'{tried}: {burst} of {message.height} x {message.width} {message.encoding!r}'
            for number in range(burst):
                yield Try(name, problem if number == burst - 1 else '')
            if one.process.poll() is not None:
                return
            if problem:
                sent -= unaccounted(one, sent)  # told once


def _problem(one: Robot, sent: int) -> str:
    if not one.wait_for(lambda: unaccounted(one, sent) <= 0, _PATIENCE_S):
        if one.process.poll() is not None:
            return f'the node ended with {one.process.returncode}'
        return f'{unaccounted(one, sent)} of {sent} images are unaccounted for: {one.told}'
    if one.count('failed'):
        return f'{one.count("failed")} frames failed'
    return f'took {one.most_mb():.0f} MB' if one.most_mb() > _MOST_MB else ''


def _image(draw: random.Random) -> object:
    height, width = draw.choice(_SIDES), draw.choice(_SIDES)
    if height * width > _MOST_PIXELS:
        height = 480
    encoding = draw.choice((*ENCODINGS, '', '32FC1', 'mono8 ', '\0', 'x' * 300))
    size = ENCODINGS[encoding].bytes_per_pixel if encoding in ENCODINGS else 1
    data = np.random.default_rng(draw.getrandbits(32)).integers(
        0, 256, (height, width * size), np.uint8
    )
    message = image(data, draw.choice((0, 1, -(2**31) * 10**9, 2**31 * 10**9 - 1, 10**18)))
    message.width, message.encoding = width, encoding
    lie = draw.choice(('none', 'none', 'none', 'height', 'width', 'step', 'data', 'nanosec'))
    if lie == 'data':
        message.data = array('B', draw.randbytes(draw.choice((0, 1, 1000))))
    elif lie == 'nanosec':
        message.header.stamp.nanosec = 2**32 - 1
    elif lie != 'none':
        setattr(message, lie, draw.choice((0, 1, 2**31 - 1, 2**32 - 1)))
    return message


def _odometry(draw: random.Random) -> Odometry:
    message = Odometry()
    message.header.stamp.sec = draw.choice((0, 1, -1, 2**31 - 1))
    message.pose.pose.position.x = draw.choice(_FLOATS)
    message.pose.pose.orientation.w = draw.choice(_FLOATS)
    return message


def _camera_info(draw: random.Random) -> CameraInfo:
    message = CameraInfo(height=draw.choice((0, 1, 480, 2**32 - 1)), width=draw.choice((0, 640)))
    message.k = [draw.choice(_FLOATS) for _ in range(9)]
    message.p = [draw.choice(_FLOATS) for _ in range(12)]
    message.binning_x = draw.choice((0, 1, 2**32 - 1))
    message.roi.width = message.roi.height = draw.choice((0, 1, 2**32 - 1))
    return message
