# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Calls services at 10 or 50 Hz while frames arrive at 10 Hz."""

from collections.abc import Iterator
from pathlib import Path
import random
import time

from nav_msgs.srv import LoadMap
from rcl_interfaces.srv import GetParameters, SetParameters
from rclpy.parameter import Parameter
from rclpy.qos import QoSProfile
from std_srvs.srv import SetBool, Trigger

from bench.torture import corpus
from bench.torture.attack import Try
from bench.torture.robot import image, Robot, robot

ABOUT = (
    '`~/reset`, `~/set_enabled`, `~/save_map`, `~/load_map` and parameters, called at 50 Hz, or '
    'by odd seeds at 10 Hz'
)
ORACLE = 'every call is answered within 30 s; the node lives, and answers frames afterwards'
COUNT, PORTION, SHORT, SEED = 1_200, 200, 0, 16
_CALLS_HZ, _FRAME_HZ = (50, 10), 10
_PATIENCE_S = 30.0


def run(count: int, seed: int, folder: Path) -> Iterator[Try]:
    """Call the services in turn."""
    draw = random.Random(seed)
    with robot(
        folder,
        mode='online',
        map_path=folder / 'map.db',
        save_map_path=folder / 'copy.db',
        image_size_px=256,
    ) as one:
        yield from _called(one, count, _CALLS_HZ[seed % 2], draw, folder)


def _called(
    one: Robot, count: int, call_hz: int, draw: random.Random, folder: Path
) -> Iterator[Try]:
    clients = {
        name: one.node.create_client(kind, f'/vpr_node/{name}', qos_profile=QoSProfile(depth=1000))
        for name, kind in {
            'reset': Trigger,
            'set_enabled': SetBool,
            'save_map': Trigger,
            'load_map': LoadMap,
            'set_parameters': SetParameters,
            'get_parameters': GetParameters,
        }.items()
    }
    for client in clients.values():
        one.wait_for(client.service_is_ready, _PATIENCE_S)
    # DDS discovery is not symmetric: the first answers may be lost.
    warm = [client.call_async(_request(name, draw, folder)) for name, client in clients.items()]
    one.wait_for(lambda: all(each.done() for each in warm), 5.0)
    calls = []
    start_s = time.monotonic()
    for number in range(count):
        if number % (call_hz // _FRAME_HZ) == 0:
            one.camera.publish(image(corpus.gray(number), (number + 1) * 10**9))
        name = draw.choice(list(clients))
        calls.append((name, clients[name].call_async(_request(name, draw, folder))))
        one.spin(max(0.0, start_s + (number + 1) / call_hz - time.monotonic()))
    one.wait_for(lambda: all(future.done() for _, future in calls), _PATIENCE_S)
    alive = one.process.poll() is None
    for number, (name, future) in enumerate(calls):
        problem = '' if future.done() else 'no answer'
        yield Try(f'{number} ({name})', problem if alive else 'the node ended')
    enable = clients['set_enabled'].call_async(SetBool.Request(data=True))
    one.wait_for(enable.done, _PATIENCE_S)
    before = one.answers
    one.camera.publish(image(corpus.gray(1), 10**18))
    if not one.wait_for(lambda: one.answers > before, _PATIENCE_S):
        yield Try('a frame afterwards', 'no answer')


def _request(name: str, draw: random.Random, folder: Path) -> object:
    if name == 'set_enabled':
        return SetBool.Request(data=draw.random() < 0.7)
    if name == 'load_map':
        urls = ('', '/none.db', '/dev/zero', str(folder / 'copy.db'), '\0', 'x' * 5_000)
        return LoadMap.Request(map_url=draw.choice(urls))
    if name == 'get_parameters':
        return GetParameters.Request(names=['min_confidence', 'none', ''])
    if name == 'set_parameters':
        values = (1.5, -1.0, 1e308, float('nan'), 'much', [1, 2], True)
        parameter = Parameter('min_confidence', value=draw.choice(values))
        return SetParameters.Request(parameters=[parameter.to_parameter_msg()])
    return Trigger.Request()
