# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Messages that reach rclpy's own callbacks, life cycles cut short, a map cut under the node."""

from collections.abc import Iterator
import os
from pathlib import Path
import random

from convseq_ros.core.map.database import MapLock
from convseq_ros.errors import MapError
from lifecycle_msgs.msg import Transition
from lifecycle_msgs.srv import ChangeState
from rcl_interfaces.srv import SetParameters
from rclpy.parameter import Parameter
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import CameraInfo

from bench.torture import corpus
from bench.torture.attack import Try
from bench.torture.robot import greet, image, Robot, robot

ABOUT = (
    '`/clock` below zero, `use_sim_time` set at run time, `camera_info` of the smallest numbers '
    'there are; then the growing map is cut short; cleanup right after configure'
)
ORACLE = 'the node lives, and answers the next image; after cleanup nobody holds the map'
COUNT, PORTION, SHORT, SEED = 60, 20, 0, 16
_PATIENCE_S = 30.0
_FLOATS = (5e-324, 2.2e-308, 1e-300, 1e300, 0.0, 500.0)


def run(count: int, seed: int, folder: Path) -> Iterator[Try]:
    """Send hostile messages, cut the map, and let a managed node clean up at once."""
    draw, path = random.Random(seed), folder / 'map.db'
    with robot(folder, mode='online', map_path=path, use_sim_time=True) as one:
        clock = one.node.create_publisher(Clock, '/clock', 10)
        info = one.node.create_publisher(CameraInfo, '/camera_info', 10)
        greet(one)
        for number in range(count // 2):
            what = 'cut' if number == count // 2 - 1 else draw.choice(('clock', 'set', 'info'))
            problem = ''
            if what == 'cut':
                os.truncate(path, path.stat().st_size // 2)
            elif what == 'clock':
                clock.publish(Clock(clock=_time(draw.choice((-(2**31), -1, 0, 1, 2**31 - 1)))))
            elif what == 'info':
                k = [draw.choice(_FLOATS) for _ in range(9)]
                info.publish(CameraInfo(k=k, width=640, height=480))
            else:
                problem = _set_clock(one)
            yield Try(f'{number}: {what}', problem or _unanswered(one, number))
            if one.process.poll() is not None:
                return
    yield from _cleaned_up(count - count // 2, folder)


def _cleaned_up(count: int, folder: Path) -> Iterator[Try]:
    path = folder / 'managed.db'
    with robot(folder, waits=False, mode='online', map_path=path, lifecycle=True) as one:
        client = one.node.create_client(ChangeState, '/vpr_node/change_state')
        one.wait_for(client.service_is_ready, _PATIENCE_S)
        one.spin(1.0)
        for number in range(count):
            problem = ''
            for step in (Transition.TRANSITION_CONFIGURE, Transition.TRANSITION_CLEANUP):
                asked = client.call_async(ChangeState.Request(transition=Transition(id=step)))
                if not one.wait_for(asked.done, _PATIENCE_S) or not asked.result().success:
                    problem = f'transition {step} failed'
            try:
                with MapLock(path):
                    pass
            except MapError as error:
                problem = problem or str(error)
            yield Try(f'{number}: cleanup', problem)


def _set_clock(one: Robot) -> str:
    """Set `use_sim_time` to another value; return a problem if that is not refused."""
    client = one.node.create_client(SetParameters, '/vpr_node/set_parameters')
    one.wait_for(client.service_is_ready, _PATIENCE_S)
    one.spin(0.5)
    value = Parameter('use_sim_time', value=False).to_parameter_msg()
    asked = client.call_async(SetParameters.Request(parameters=[value]))
    answered = one.wait_for(asked.done, _PATIENCE_S)
    one.node.destroy_client(client)
    if not answered:
        return 'set_parameters is not answered'
    return 'use_sim_time was set' if asked.result().results[0].successful else ''


def _unanswered(one: Robot, number: int) -> str:
    """Send a good image; return a problem if it is not answered."""
    before = one.answers
    one.camera.publish(image(corpus.gray(number % 50), (number + 10) * 10**9))
    if one.wait_for(lambda: one.answers > before, _PATIENCE_S):
        return ''
    code = one.process.poll()
    return 'the next image is not answered' if code is None else f'the node ended with {code}'


def _time(sec: int) -> object:
    message = Clock().clock
    message.sec = sec
    return message
