# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Stamps of broken drivers: the times of recording are taken where they tell more."""

from convseq_ros.sources import open_annotated, open_source
from convseq_ros.sources.recording import Recording
import pytest
import recordings

TOPIC = '/camera/image_raw'
SECOND_NS = 1_000_000_000


def stamped(write, pictures, stamps_ns, layout='mcap file', log_step_ns=recordings.STEP_NS):
    """Write images with stamps, recorded a step apart; return path and times of recording."""
    logged = [recordings.START_NS + log_step_ns * number for number in range(len(pictures))]
    rows = [
        (TOPIC, log_ns, recordings.image(gray, stamp_ns))
        for gray, stamp_ns, log_ns in zip(pictures, stamps_ns, logged, strict=True)
    ]
    return write(layout, rows), logged


def whole_seconds(count, step_ns=recordings.STEP_NS):
    times = [recordings.START_NS + 40_000_000 + step_ns * number for number in range(count)]
    return [time - time % SECOND_NS for time in times]


@pytest.mark.parametrize(
    ('stamps', 'told'),
    [([7 * SECOND_NS + 5] * 12, 'one stamp'), (whole_seconds(12), '2 stamps of whole seconds')],
)
def test_times_of_recording_replace_stamps_that_tell_no_time(
    write, layout, pictures, stamps, told
):
    path, logged = stamped(write, pictures, stamps, layout)
    source = open_source(path)
    assert isinstance(source, Recording)
    for _ in range(2):
        assert [frame.stamp_ns for frame in source] == logged
    assert [message.stamp_ns for message in source.messages()] == logged
    assert source.warnings == [
        f'{path}: the first 12 messages of {TOPIC} have {told}; the times of recording are taken '
        'instead: check the driver'
    ]


def kept(write, pictures, stamps, **how):
    path, _ = stamped(write, pictures, stamps, **how)
    source = open_source(path)
    return [frame.stamp_ns for frame in source] == stamps and source.warnings == []


def test_stamps_that_tell_the_time_are_kept(write, pictures):
    one_a_second = [recordings.START_NS + SECOND_NS * number for number in range(12)]
    assert kept(write, pictures, one_a_second)


def test_a_driver_that_sends_each_image_twice_keeps_its_stamps(write, pictures):
    twice = [recordings.START_NS + recordings.STEP_NS * (number // 2) + 1 for number in range(12)]
    assert kept(write, pictures, twice)


def test_stamps_are_kept_where_times_of_recording_tell_no_more(write, pictures):
    assert kept(write, pictures, [7 * SECOND_NS] * 12, log_step_ns=0)


def test_two_images_of_one_stamp_are_too_few_to_tell(write, pictures):
    assert kept(write, pictures[:2], [7 * SECOND_NS] * 2)


def test_images_of_one_stamp_get_the_odometry_of_their_time(write, pictures):
    rows = [
        (TOPIC, recordings.START_NS + recordings.STEP_NS * i, recordings.image(gray, SECOND_NS))
        for i, gray in enumerate(pictures)
    ]
    for i in range(12):
        time_ns = recordings.START_NS + recordings.STEP_NS * i
        rows.append(('/odom', time_ns, recordings.odometry(float(i), time_ns)))
    source = open_annotated(write('mcap file', rows), odom='/odom')
    assert [frame.pose.position[0] for frame in source] == list(range(12))
