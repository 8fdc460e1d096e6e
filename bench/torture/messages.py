# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Odd messages over DDS."""

from array import array
from collections.abc import Callable, Iterator
from pathlib import Path
import random
import re
from typing import Any

from convseq_ros.sources.images import ENCODINGS
from nav_msgs.msg import Odometry
import numpy as np
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import CameraInfo, Image

from bench import recordings
from bench.robot import greet, image, Robot, robot, unaccounted
from bench.torture.attack import Try

_SIDES = (1, 2, 3, 16, 47, 64, 240, 480, 1_080, 2_160, 6_000, 8_000)
_CAMERAS = ((480, 640), (1_080, 1_920), (2_160, 3_840), (4_320, 7_680))
_BURST, _SHARE_OF_CAMERAS, _MOST_PIXELS = 30, 0.05, 48_000_000
_MOST_MB, _MOST_LEFT_MB = 2_000, 256 + 100
_NEXT_S, _PATIENCE_S, _LEFT_S = 10.0, 120.0, 10.0  # until the next image, all answers, the end
_ANSWER_S = 30.0  # until an image after odd messages is answered
_FLOATS = (
    0.0, 1.0, -1.0, 500.0, 5e-324, 2.2e-308, 1e-300, 1e308, float('inf'), float('-inf'),
    float('nan'),
)  # fmt: skip
_NUMBERS: dict[str, tuple[Any, ...]] = {
    'double': _FLOATS, 'int32': (-(2**31), -1, 0, 1, 2**31 - 1), 'uint32': (0, 1, 480, 2**32 - 1),
}  # fmt: skip
_TOPICS = {Odometry: '/odom', CameraInfo: '/camera_info', Clock: '/clock'}
_FIRST_NS, _LAST_NS = -(2**31) * 10**9, 2**31 * 10**9 - 1
_JUMPS_NS = (10**8, 10**8, 10**8, 0, 1, -1, -(10**9) - 1, 10**9, 10**12, -(10**12), 10**18)


class Sender:
    """Sends a node what is drawn."""

    def __init__(self, one: Robot, draw: random.Random) -> None:
        self.one, self._draw = one, draw
        self._sent, self._stamp_ns, self._before_mb = 0, 10**18, one.resident_mb()
        self._publishers = {
            kind: one.node.create_publisher(kind, topic, 10) for kind, topic in _TOPICS.items()
        }

    def images(self) -> Try:
        """Send a burst of odd images; all of them must be accounted for."""
        is_camera = self._draw.random() < _SHARE_OF_CAMERAS
        message, burst = (_camera_image if is_camera else _odd_image)(self._draw)
        for kind in (Odometry, CameraInfo):
            self._publishers[kind].publish(_odd(kind, self._draw))
        for _ in range(burst):
            self.one.camera.publish(message)
        self._sent += burst
        for patience_s in (_NEXT_S, _PATIENCE_S):  # losses are detected with the next image
            self._send_image()
            if self.one.wait_for(lambda: unaccounted(self.one, self._sent) <= 0, patience_s):
                break
        problem = self._problem()
        if is_camera and not problem:
            self.one.spin(_LEFT_S)
            left_mb = self.one.resident_mb() - self._before_mb
            problem = f'{left_mb:.0f} MB are left' if left_mb > _MOST_LEFT_MB else ''
        self._sent -= unaccounted(self.one, self._sent)  # report a problem only once
        return Try(f'{message.height} x {message.width} {message.encoding!r}', problem, burst)

    def message(self) -> Try:
        """Publish an odd message that is no image of the camera."""
        kind = self._draw.choice([*_TOPICS])
        odd = _odd_image(self._draw)[0] if kind is Image else _odd(kind, self._draw)
        self._publishers[kind].publish(odd)
        return Try(kind.__name__, self._unanswered())

    def _send_image(self) -> None:
        """Send a good image, whose stamp may have jumped."""
        odd = (_FIRST_NS, -1, 0, 1, _LAST_NS, self._draw.randrange(_LAST_NS))
        next_ns = self._stamp_ns + self._draw.choice(_JUMPS_NS)
        next_ns = self._draw.choice(odd) if self._draw.random() < 0.05 else next_ns
        self._stamp_ns = min(max(next_ns, _FIRST_NS), _LAST_NS)
        self.one.camera.publish(image(recordings.gray(self._sent % 50), self._stamp_ns))
        self._sent += 1

    def _unanswered(self) -> str:
        """Send a good image; return a problem if it is not answered."""
        before = self.one.answers
        self._send_image()
        if self.one.wait_for(lambda: self.one.answers > before, _ANSWER_S):
            return ''
        return self._ended() or 'the next image is not answered'

    def _ended(self) -> str:
        code = self.one.process.poll()
        return '' if code is None else f'the node ended with {code}'

    def _problem(self) -> str:
        if ended := self._ended():
            return ended
        if (lost := unaccounted(self.one, self._sent)) > 0:
            return f'{lost} of {self._sent} images are unaccounted for: {self.one.diagnostics}'
        if self.one.count('failed'):
            return f'{self.one.count("failed")} frames failed'
        most_mb = self.one.resident_mb('VmHWM')
        return f'took {most_mb:.0f} MB' if most_mb > _MOST_MB else ''


def images(count: int, seed: int, folder: Path) -> Iterator[Try]:
    """Send a node bursts of odd images."""
    return _run(Sender.images, count, seed, folder)


def node_messages(count: int, seed: int, folder: Path) -> Iterator[Try]:
    """Send a node odd messages that are no images of the camera."""
    return _run(Sender.message, count, seed, folder, use_sim_time=True)


def _run(
    act: Callable[[Sender], Try], count: int, seed: int, folder: Path, **parameters: Any
) -> Iterator[Try]:
    """Do an act again and again with a node."""
    draw, tried = random.Random(seed), 0
    own: dict[str, Any] = {'mode': 'online', 'map_path': folder / 'map.db'}
    with robot(folder, diagnostics_period_s=0.2, **own, **parameters) as one:
        sender = Sender(one, draw)
        greet(one)
        while tried < count and one.process.poll() is None:
            name, problem, made = act(sender)
            yield Try(f'{tried}: {made} of {name}', problem, made)
            tried += made


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
    message = image(data, 10**18, width=width, encoding=encoding)
    _spoil(message, draw, draw.choice((0, 0, 1)))
    if draw.random() < 0.1:
        message.data = array('B', draw.randbytes(draw.choice((0, 1, 1000))))
    burst = draw.choice((1, 1, 1, 5, 30, 300))
    return message, min(burst, 10) if data.size > 1_000_000 else burst


def _odd(kind: type, draw: random.Random) -> Any:
    """Return a message of which one, two or all numbers are odd."""
    message = kind()
    _spoil(message, draw, draw.choice((1, 2, 1000)))
    return message


def _spoil(message: Any, draw: random.Random, most: int) -> None:
    """Give some numbers of a message, at any depth, odd values."""
    numbers = [*_numbers(message)]
    for owner, name, odd, count in draw.sample(numbers, min(most, len(numbers))):
        drawn = [draw.choice(odd) for _ in range(count or 1)]
        setattr(owner, name, drawn if count else drawn[0])


def _numbers(message: Any) -> Iterator[tuple[Any, str, tuple[Any, ...], int]]:
    """Yield owner, name, odd values and count, 0 for one, of each field of numbers."""
    for name, kind in message.get_fields_and_field_types().items():
        if hasattr(value := getattr(message, name), 'get_fields_and_field_types'):
            yield from _numbers(value)
        elif (found := re.fullmatch(r'(\w+?)(?:\[(\d+)\])?', kind)) and found[1] in _NUMBERS:
            yield message, name, _NUMBERS[found[1]], int(found[2] or 0)
