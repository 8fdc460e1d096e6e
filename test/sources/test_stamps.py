# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Stamps of broken drivers: the times of recording are taken where they tell more."""

from convseq_ros.sources import open_annotated, open_source
from convseq_ros.sources.recording import Recording
import pytest
import recordings
from recordings import START_NS, STEP_NS

TOPIC = '/camera/image_raw'
SECOND_NS = 1_000_000_000


def stamped(write, pictures, stamps_ns, layout='mcap file', log_step_ns=STEP_NS):
    """Write images with stamps, recorded a step apart; return path and times of recording."""
    logged = [START_NS + log_step_ns * number for number in range(len(pictures))]
    images = map(recordings.image, pictures, stamps_ns)
    rows = [(TOPIC, *row) for row in zip(logged, images, strict=True)]
    return write(layout, rows), logged


@pytest.mark.parametrize(
    ('stamps', 'told'),
    [
        ([7 * SECOND_NS + 5] * 12, 'one stamp'),
        ([START_NS + SECOND_NS * (at // 10) for at in range(12)], '2 stamps of whole seconds'),
    ],
)
def test_times_of_recording_replace_constant_or_whole_second_stamps(
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


@pytest.mark.parametrize(
    ('stamps', 'log_step_ns'),
    [
        ([START_NS + SECOND_NS * at for at in range(12)], STEP_NS),
        # A driver that sends each image twice.
        ([START_NS + STEP_NS * (at // 2) + 1 for at in range(12)], STEP_NS),
        ([7 * SECOND_NS] * 12, 0),  # times of recording tell no more
        ([7 * SECOND_NS] * 2, STEP_NS),  # two are too few to tell
    ],
)
def test_other_stamps_are_kept(write, pictures, stamps, log_step_ns):
    path, _ = stamped(write, pictures[: len(stamps)], stamps, log_step_ns=log_step_ns)
    source = open_source(path)
    assert [frame.stamp_ns for frame in source] == stamps and source.warnings == []


def test_images_of_one_stamp_get_the_odometry_of_their_time(write, pictures):
    rows = []
    for i, gray in enumerate(pictures):
        time_ns = START_NS + STEP_NS * i
        rows.append((TOPIC, time_ns, recordings.image(gray, SECOND_NS)))
        rows.append(('/odom', time_ns, recordings.odometry(float(i), time_ns)))
    source = open_annotated(write('mcap file', rows), odom='/odom')
    assert [frame.pose.position[0] for frame in source] == list(range(12))
