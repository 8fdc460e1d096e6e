# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The real process survives whatever a camera sends, and says so."""

import signal
import time

from convseq_ros.results import read_results
from diagnostic_msgs.msg import DiagnosticArray
import numpy as np
from rclpy.serialization import serialize_message
from sensor_msgs.msg import Image
from std_msgs.msg import Int32

SECOND = 1_000_000_000


def bad_images(image, gray):
    """Yield images that no decoder can read."""
    for field, value in (
        ('encoding', 'mono7'),
        ('encoding', ''),
        ('step', 3),
        ('data', b'short'),
        ('data', b''),
        ('height', 0),
        ('width', 0),
        ('width', 2**32 - 1),
        ('height', 2**32 - 1),
    ):
        message = image(gray, 0)
        setattr(message, field, value)
        yield message


def test_corrupt_frames_are_counted_and_good_ones_answered(
    client, start, map_path, street, image, tmp_path
):
    result_file = tmp_path / 'result.csv'
    settings = {'map_path': map_path, 'fixed_length': 1, 'result_file': result_file}
    process = start('vpr_node', diagnostics_period_s=0.1, **settings)
    heard = client.listen(Int32, '/vpr_node/match_index')
    diagnostics = client.listen(DiagnosticArray, '/diagnostics')
    camera = client.camera(Image)
    odd = [
        *bad_images(image, street[0]),
        image(np.zeros((120, 160), np.uint8), 0),
        image(np.full((1, 1), 77, np.uint8), 0),
    ]
    for number, message in enumerate([image(street[3], 0), *odd, image(street[4], 0)]):
        message.header.stamp.sec = number + 1
        camera.publish(message)
    # Bytes that are no message at all do not even arrive.
    camera.publish(serialize_message(odd[0])[:30])
    camera.publish(image(street[5], 60 * SECOND))
    client.wait_for(lambda: len(heard) == 14)
    assert [message.data for message in heard] == [3] + [-1] * 11 + [4, 5]

    def counts():
        values = {item.key: item.value for item in diagnostics[-1].status[0].values}
        return values if values['processed'] == '14' else None

    values = client.wait_for(counts)
    assert (values['unreadable'], values['reason_unreadable']) == ('9', '9')
    assert (values['reason_uninformative'], values['failed']) == ('2', '0')
    assert (values['map_path'], values['map_size']) == (str(map_path), '25')
    process.send_signal(signal.SIGTERM)
    assert process.wait(60) == 0
    reasons = [row['reason'] for row in read_results(result_file)]
    assert reasons == ['accepted'] + ['unreadable'] * 9 + ['uninformative'] * 2 + ['accepted'] * 2
    _, errors = process.communicate()
    assert 'mono7' in errors
    assert 'Traceback' not in errors


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
        client.wait_for(lambda number=index: node._statistics.received > number)
    due_s = time.monotonic() + 0.001
    client.wait_for(lambda: time.monotonic() > due_s)
    held.set()
    client.wait_for(lambda: len(heard) == 2, 'the first and the last')
    assert node._worker.dropped == 8


def test_keyframes_that_the_map_does_not_have_are_ignored_and_it_says_so(start, map_path):
    process = start('vpr_node', map_path=map_path, keyframe_interval_s=0.7)
    told = [process.stderr.readline() for _ in range(2)]
    assert sum('keyframe_interval_s 0.7 is ignored' in line for line in told) == 1
