# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Abnormal messages over DDS, images of large cameras, and stamps that jump."""

from array import array
from collections.abc import Iterator
from pathlib import Path
import random

from convseq_ros.sources.images import ENCODINGS
from nav_msgs.msg import Odometry
import numpy as np
from sensor_msgs.msg import CameraInfo, Image

from bench.torture import corpus
from bench.torture.attack import Try
from bench.torture.robot import greet, image, Robot, robot, unaccounted

ABOUT = (
    'Images of 1 x 1 to 8,000 x 6,000 px, in every encoding and in none, of lying sizes, in '
    'bursts of up to 300; 30 images at once of cameras up to 7,680 x 4,320 px; stamps that jump '
    'by up to the whole range of ROS; odometry and camera_info of NaN and infinity'
)
ORACLE = (
    'every image is answered, or counted as dropped or, when the next comes, lost; nothing fails; '
    'below 2 GB; a good image is answered after each burst; 10 s after a burst of large images '
    'the node holds at most 256 MB and one image more than before'
)
COUNT, PORTION, SHORT, SEED = 2_000, 500, 0, 16
_SIDES = (1, 2, 3, 16, 47, 64, 240, 480, 1_080, 2_160, 6_000, 8_000)
_CAMERAS = ((480, 640), (1_080, 1_920), (2_160, 3_840), (4_320, 7_680))
_BURST, _SHARE_OF_CAMERAS = 30, 0.05
_MOST_PIXELS = 48_000_000
_MOST_MB, _MOST_LEFT_MB = 2_000, 256 + 100
_NEXT_S, _PATIENCE_S, _LEFT_S = 10.0, 120.0, 10.0  # until the next image, all answers, the end
_FLOATS = (0.0, 1.0, -1.0, 1e308, float('inf'), float('-inf'), float('nan'))
_FIRST_NS, _LAST_NS = -(2**31) * 10**9, 2**31 * 10**9 - 1
_JUMPS_NS = (10**8, 10**8, 10**8, 0, 1, -1, -(10**9) - 1, 10**9, 10**12, -(10**12), 10**18)


def run(count: int, seed: int, folder: Path) -> Iterator[Try]:
    """Send bursts, each followed by a valid image."""
    draw = random.Random(seed)
    with robot(folder, mode='online', map_path=folder / 'map.db', diagnostics_period_s=0.2) as one:
        odometry = one.node.create_publisher(Odometry, '/odom', 10)
        camera_info = one.node.create_publisher(CameraInfo, '/camera_info', 10)
        greet(one)
        sent, tried, stamp_ns, before_mb = 0, 0, 10**18, one.resident_mb()
        while tried < count:
            is_camera = draw.random() < _SHARE_OF_CAMERAS
            message, burst = _camera_image(draw) if is_camera else _odd_image(draw)
            odometry.publish(_odometry(draw))
            camera_info.publish(_camera_info(draw))
            for _ in range(burst):
                one.camera.publish(message)
            sent, tried = sent + burst, tried + burst
            for patience_s in (_NEXT_S, _PATIENCE_S):  # losses are detected with the next image
                stamp_ns = _jump(stamp_ns, draw)
                one.camera.publish(image(corpus.gray(tried % 50), stamp_ns))
                sent += 1
                if one.wait_for(lambda sent=sent: unaccounted(one, sent) <= 0, patience_s):
                    break
            problem = _problem(one, sent)
            if is_camera and not problem:
                one.spin(_LEFT_S)
                left_mb = one.resident_mb() - before_mb
                problem = f'{left_mb:.0f} MB are left' if left_mb > _MOST_LEFT_MB else ''
            name = f'{tried}: {burst} of {message.height} x {message.width} {message.encoding!r}'
            yield from (Try(name) for _ in range(burst - 1))
            yield Try(name, problem)
            if one.process.poll() is not None:
                return
            sent -= unaccounted(one, sent)  # report a problem only once


def _problem(one: Robot, sent: int) -> str:
    if one.process.poll() is not None:
        return f'the node ended with {one.process.returncode}'
    if unaccounted(one, sent) > 0:
        return f'{unaccounted(one, sent)} of {sent} images are unaccounted for: {one.diagnostics}'
    if one.count('failed'):
        return f'{one.count("failed")} frames failed'
    most_mb = one.resident_mb('VmHWM')
    return f'took {most_mb:.0f} MB' if most_mb > _MOST_MB else ''


def _jump(stamp_ns: int, draw: random.Random) -> int:
    if draw.random() < 0.05:
        return draw.choice((_FIRST_NS, -1, 0, 1, _LAST_NS, draw.randrange(_LAST_NS)))
    return min(max(stamp_ns + draw.choice(_JUMPS_NS), _FIRST_NS), _LAST_NS)


def _camera_image(draw: random.Random) -> tuple[Image, int]:
    (height, width), channels = draw.choice(_CAMERAS), draw.choice((1, 3))
    noise = np.random.default_rng(draw.getrandbits(32)).integers(0, 256, (height, width), np.uint8)
    kind = {'width': width, 'encoding': 'mono8' if channels == 1 else 'bgr8'}
    return image(np.repeat(noise, channels, axis=1), 10**18, **kind), _BURST


def _odd_image(draw: random.Random) -> tuple[Image, int]:
    height, width = draw.choice(_SIDES), draw.choice(_SIDES)
    if height * width > _MOST_PIXELS:
        height = 480
    encoding = draw.choice((*ENCODINGS, '', '32FC1', 'mono8 ', '\0', 'x' * 300))
    size = ENCODINGS[encoding].bytes_per_pixel if encoding in ENCODINGS else 1
    data = np.random.default_rng(draw.getrandbits(32)).integers(
        0, 256, (height, width * size), np.uint8
    )
    message = image(data, draw.choice((0, 1, _FIRST_NS, _LAST_NS, 10**18)))
    message.width, message.encoding = width, encoding
    lie = draw.choice(('none', 'none', 'none', 'height', 'width', 'step', 'data', 'nanosec'))
    if lie == 'data':
        message.data = array('B', draw.randbytes(draw.choice((0, 1, 1000))))
    elif lie == 'nanosec':
        message.header.stamp.nanosec = 2**32 - 1
    elif lie != 'none':
        setattr(message, lie, draw.choice((0, 1, 2**31 - 1, 2**32 - 1)))
    burst = draw.choice((1, 1, 1, 5, 30, 300))
    return message, min(burst, 10) if data.size > 1_000_000 else burst


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
