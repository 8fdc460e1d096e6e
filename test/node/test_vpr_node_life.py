# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""How the node's process starts, refuses to start, bears bad input, uses memory, and ends."""

import os
import signal
import subprocess
import sys
import time

from convseq_ros.io.results import read_results
from diagnostic_msgs.msg import DiagnosticArray
import numpy as np
from programs import run
import pytest
from rclpy.serialization import serialize_message
from sensor_msgs.msg import Image
from std_msgs.msg import Int32
from std_srvs.srv import Trigger

SECOND = 1_000_000_000


def test_a_signal_in_the_middle_of_a_frame_ends_the_node_cleanly(
    client, start, map_path, street, image, tmp_path
):
    result_file = tmp_path / 'result.csv'
    process = start('vpr_node', map_path=map_path, queue_size=1000, result_file=result_file)
    heard = client.listen(Int32, '/vpr_node/match_index')
    camera = client.camera(Image)
    for index in range(300):
        camera.publish(image(street[index % len(street)], (index + 1) * SECOND))
    client.wait_for(lambda: len(heard) >= 3)
    process.send_signal(signal.SIGTERM)
    assert process.wait(60) == 0
    rows = read_results(result_file)
    assert 3 <= len(rows) < 300
    assert [int(row['query_index']) for row in rows] == list(range(len(rows)))
    _, errors = process.communicate()
    assert 'Traceback' not in errors and '[ERROR]' not in errors


SLOW_TO_SAVE = """
import atexit, sys, time
from convseq_ros.node.services import map_services
from convseq_ros.node import vpr_node

def slowly(_, path):
    print('saving', flush=True)
    time.sleep(1.0)
    path.touch()

map_services.save_map = slowly
atexit.register(print, 'tidying up')
sys.exit(vpr_node.main(sys.argv[1:]))
"""


def test_a_signal_in_the_middle_of_saving_waits_for_it(client, map_path, tmp_path):
    target = tmp_path / 'copy.db'
    settings = f'-p map_path:={map_path} -p save_map_path:={target}'.split()
    with subprocess.Popen(
        [sys.executable, '-c', SLOW_TO_SAVE, '--ros-args', *settings], text=True,
        env=os.environ | {'PYTHONPATH': os.pathsep.join(sys.path)},
        stdout=subprocess.PIPE, stderr=subprocess.PIPE,
    ) as process:  # fmt: skip
        try:
            # Only what is saved holds up the end, not what is still warming up.
            client.wait_for(lambda: client.node.count_subscribers('/image'))
            client.service(Trigger, '/vpr_node/save_map').call_async(Trigger.Request())
            assert process.stdout.readline() == 'saving\n'
            process.send_signal(signal.SIGINT)
            output, errors = process.communicate(timeout=180)
        finally:
            process.kill()
    assert process.returncode == 0 and 'Traceback' not in errors, errors
    assert target.exists() and output == 'tidying up\n'


def test_a_second_signal_does_not_disturb_the_shutdown(client, start, map_path):
    process = start('vpr_node', map_path=map_path)
    # The first publisher appears while the node is still being made.
    client.wait_for(lambda: client.node.count_publishers('/vpr_node/match_index'))
    process.send_signal(signal.SIGINT)
    time.sleep(0.05)
    process.send_signal(signal.SIGINT)
    _, errors = process.communicate(timeout=180)
    assert process.returncode == 0, errors
    assert 'Traceback' not in errors


MISSPELT = "unknown parameter 'min_margim'; did you mean min_margin?"
CANNOT_START = [  # parameters, words, and the line
    ({'map_path': 'missing.db'}, (), 'missing.db: no such map'),
    ({'min_margim': 0.1}, (), MISSPELT),
    ({'result_file': 'missing/result.csv'}, (), 'missing/result.csv cannot be written'),
    ({'map_path': 'two\nlines'}, (), 'two lines: no such map'),
    ({}, ('-r', 'image:=caf\udce9'), r"'image:=caf\xe9' is not UTF-8; write it in UTF-8"),
    ({}, ('-r', 'image:=1a'), "1a'. Error: error not set; check the words after --ros-args"),
]


@pytest.mark.parametrize(('parameters', 'words', 'reason'), CANNOT_START)
def test_a_node_that_cannot_start_gives_the_reason_in_one_line(start, parameters, words, reason):
    process = start('vpr_node', *words, **parameters)
    _, errors = process.communicate(timeout=180)
    assert process.returncode == 1
    (line,) = [line for line in errors.splitlines() if not words or '[rcl]' not in line]
    assert line.endswith(reason) if words else reason in line and '[ERROR]' in line


def test_corrupt_frames_are_counted_and_good_ones_answered(
    client, start, map_path, street, image, tmp_path
):
    result_file = tmp_path / 'result.csv'
    settings = {'map_path': map_path, 'fixed_length': 1, 'result_file': result_file}
    process = start('vpr_node', diagnostics_period_s=0.1, **settings)
    heard = client.listen(Int32, '/vpr_node/match_index')
    diagnostics = client.listen(DiagnosticArray, '/diagnostics')
    camera = client.camera(Image)
    unknown = image(street[0], 0)
    unknown.encoding = 'mono7'
    blank, tiny = np.zeros((120, 160), np.uint8), np.full((1, 1), 77, np.uint8)
    odd = [unknown, image(blank, 0), image(tiny, 0)]
    for number, message in enumerate([image(street[3], 0), *odd, image(street[4], 0)]):
        message.header.stamp.sec = number + 1
        camera.publish(message)
    unknown.header.stamp.sec = 20
    camera.publish(serialize_message(unknown)[:30])  # of which all but the header is missing
    camera.publish(image(street[5], 60 * SECOND))
    client.wait_for(lambda: len(heard) == 7)
    assert [message.data for message in heard] == [3, -1, -1, -1, 4, -1, 5]

    def counts():
        values = {item.key: item.value for item in diagnostics[-1].status[0].values}
        return values if values['processed'] == '7' else None

    values = client.wait_for(counts)
    assert (values['unreadable'], values['reason_unreadable']) == ('2', '2')
    assert (values['reason_uninformative'], values['failed']) == ('2', '0')
    assert (values['map_path'], values['map_size']) == (str(map_path), '25')
    process.send_signal(signal.SIGTERM)
    assert process.wait(60) == 0
    reasons = [row['reason'] for row in read_results(result_file)]
    odd_reasons = ['unreadable', 'uninformative', 'uninformative']
    assert reasons == ['accepted', *odd_reasons, 'accepted', 'unreadable', 'accepted']
    _, errors = process.communicate()
    assert 'mono7' in errors and 'Traceback' not in errors


def test_images_without_a_stamp_get_the_time_of_the_node(client, vpr, street, image, tmp_path):
    path = tmp_path / 'result.csv'
    node = vpr(result_file=path)
    heard = client.listen(Int32, '/vpr_node/match_index')
    camera = client.camera(Image)
    before_ns = client.node.get_clock().now().nanoseconds
    camera.publish(image(street[0], 0))
    camera.publish(image(street[1], 0))
    client.wait_for(lambda: len(heard) == 2)
    after_ns = client.node.get_clock().now().nanoseconds
    node.context.try_shutdown()
    client.wait_for(path.exists)
    stamps = [int(row['query_stamp_ns']) for row in read_results(path)]
    assert before_ns < stamps[0] < stamps[1] < after_ns


def test_a_camera_too_fast_for_the_machine_costs_frames_but_no_time(
    client, vpr, street, image, map_path, held
):
    node = vpr(map_path=map_path, queue_size=1000, max_wait_s=0.001)
    heard = client.listen(Int32, '/vpr_node/match_index')
    camera = client.camera(Image)
    for index in range(10):
        camera.publish(image(street[index], (index + 1) * SECOND))
        # Each after the last one has arrived: none is lost on the way.
        client.wait_for(lambda number=index: node._counters.received > number)
    due_s = time.monotonic() + 0.001
    client.wait_for(lambda: time.monotonic() > due_s)
    held.set()
    client.wait_for(lambda: len(heard) == 2, 'the first and the last')
    assert node._worker.dropped == 8


SCRIPT = """
import resource
from convseq_ros.node.running import keep_memory_at_hand
keep_memory_at_hand()
for number in range(40):
    if number == 10:
        before = resource.getrusage(resource.RUSAGE_SELF).ru_minflt
    images = [bytearray(b'x') * 921_600 for _ in range(3)]
    del images
print(resource.getrusage(resource.RUSAGE_SELF).ru_minflt - before)
"""


def test_the_memory_of_an_image_serves_the_next():
    """Three copies of an image of 640 x 480 are 675 pages, 30 times."""
    assert int(run(sys.executable, '-c', SCRIPT).stdout) < 675


HOLES = """
from pathlib import Path
import re
from convseq_ros.node.running import return_free_memory
def held_kb():
    return int(re.search(r'RssAnon:\\s+(\\d+)', Path('/proc/self/status').read_text())[1])
kept = [bytearray(b'x') * 16_384 for _ in range(4000)]
del kept[::2]
before = held_kb()
return_free_memory()
print(before - held_kb())
"""


def test_memory_that_is_free_between_objects_is_returned():
    """Each of 2,000 holes has three whole pages."""
    assert int(run(sys.executable, '-c', HOLES).stdout) > 2000 * 3 * 4 * 0.9


ENDING = """
import os, signal
from convseq_ros.node import running
running._RETURNED_S = 0.0
running.return_free_memory = lambda: os.kill(os.getpid(), signal.SIGTERM)
running.leave(running.run_until_signal(lambda: running.Node('returning')))
"""


def test_a_node_returns_free_memory_now_and_then():
    assert run(sys.executable, '-c', ENDING).returncode == 0


@pytest.mark.parametrize(
    ('home', 'told'),
    [
        ({'HOME': '/proc'}, 'warning: /proc/.ros/log: '),
        ({}, 'warning: HOME is not set; ROS logs to '),
    ],
)
def test_a_home_that_is_read_only_or_missing_stops_nothing(start, home, told, map_path, tmp_path):
    left_out = 'ROS_LOG_DIR', 'ROS_HOME', 'HOME'
    given = {key: value for key, value in os.environ.items() if key not in left_out}
    given |= {'TMPDIR': str(tmp_path), **home}
    process = start('vpr_node', environment=given, map_path=map_path)
    line = process.stderr.readline()
    assert line.startswith(told) and str(tmp_path) in line
    while 'listening to' not in process.stderr.readline():
        assert process.poll() is None
    process.send_signal(signal.SIGINT)
    assert process.wait(60) == 0
