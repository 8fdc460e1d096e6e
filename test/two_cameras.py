# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A recording of two cameras, for whoever asks for it."""

from pictures import picture

TOPICS = '/front/image', '/rear/image'
COUNT, STEP_NS = 24, 100_000_000


def record_two_cameras(path, start=0):
    """Write one whose rear camera meets what the front one does, backwards, 20 ms later."""
    from recordings import image, StoragePlugin, write_ros2

    rows, pictures = [], [picture(start + number) for number in range(COUNT)]
    for number in range(COUNT):
        stamp_ns = (start + number + 1) * STEP_NS
        late_ns = stamp_ns + 20_000_000
        rows.append((TOPICS[0], stamp_ns, image(pictures[number], stamp_ns)))
        rows.append((TOPICS[1], late_ns, image(pictures[COUNT - 1 - number], late_ns)))
    return write_ros2(path, rows, StoragePlugin.MCAP)
