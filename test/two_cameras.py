# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A recording of two cameras, for whoever asks for it."""

import numpy as np
from pictures import picture

TOPICS, DEPTH = ('/front/image', '/rear/image'), '/front/depth'
COUNT, STEP_NS = 24, 100_000_000


def record_two_cameras(path, start=0):
    """Write one whose rear camera meets what the front one does, backwards, 20 ms later."""
    from rosbags.rosbag2 import StoragePlugin, Writer
    from rosbags.typesys import get_typestore, Stores

    store = get_typestore(Stores.ROS2_JAZZY)
    kinds = store.types
    pictures = [picture(start + number) for number in range(COUNT)]
    with Writer(path, version=9, storage_plugin=StoragePlugin.MCAP) as writer:
        kind = 'sensor_msgs/msg/Image'
        to = {one: writer.add_connection(one, kind, typestore=store) for one in (*TOPICS, DEPTH)}

        def write(topic, stamp_ns, encoding, shown):
            stamp = kinds['builtin_interfaces/msg/Time'](*divmod(stamp_ns, 10**9))
            header = kinds['std_msgs/msg/Header'](stamp, 'camera')
            size = *shown.shape, encoding, 0, shown.strides[0], shown.view(np.uint8).ravel()
            data = store.serialize_cdr(kinds[kind](header, *size), kind)
            writer.write(to[topic], stamp_ns, data)

        for number in range(COUNT):
            stamp_ns = (start + number + 1) * STEP_NS
            write(TOPICS[0], stamp_ns, 'mono8', pictures[number])
            write(DEPTH, stamp_ns, '16UC1', np.full((60, 80), 1000 + 10 * number, np.uint16))
            write(TOPICS[1], stamp_ns + 20_000_000, 'mono8', pictures[COUNT - 1 - number])
    return path
