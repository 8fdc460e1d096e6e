# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Image messages are read as rosbags reads them, whatever their order of bytes; or refused."""

import pytest

pytest.importorskip('rosbags', reason='needs rosbags: pip install rosbags')

from convseq_ros.errors import ImageError
from convseq_ros.sources.raw_message import COMPRESSED_IMAGE, IMAGE, RawMessage
from hypothesis import given
from hypothesis import strategies as st
import numpy as np
from rosbags.typesys import get_typestore, Stores

ROS2 = get_typestore(Stores.ROS2_JAZZY)
NUMBER, TEXT, DATA = st.integers(0, 2**32 - 1), st.text(max_size=9), st.binary(max_size=40)


def serialized(kind, frame, little_endian, **fields):
    types = ROS2.types
    stamp = types['builtin_interfaces/msg/Time'](sec=-3, nanosec=7)
    header = types['std_msgs/msg/Header'](stamp=stamp, frame_id=frame)
    fields['data'] = np.frombuffer(fields['data'], np.uint8)
    message = types[kind](header=header, **fields)
    return bytes(ROS2.serialize_cdr(message, kind, little_endian=little_endian))


@given(NUMBER, NUMBER, NUMBER, st.integers(0, 255), TEXT, TEXT, DATA, st.booleans())
def test_an_image_has_the_fields_that_were_written(
    height, width, step, order, frame, encoding, data, is_little
):
    fields = {'height': height, 'width': width, 'encoding': encoding, 'is_bigendian': order}
    cdr = serialized(IMAGE, frame, is_little, **fields, step=step, data=data)
    assert RawMessage(0, IMAGE, cdr).image() == (height, width, encoding, order, step, data)


@given(TEXT, TEXT, DATA, st.booleans())
def test_a_compressed_image_has_the_fields_that_were_written(frame, name, data, is_little):
    cdr = serialized(COMPRESSED_IMAGE, frame, is_little, format=name, data=data)
    assert RawMessage(0, COMPRESSED_IMAGE, cdr).image() == (name, data)


def test_a_truncated_image_message_is_reported_as_damaged():
    fields = {'height': 1, 'width': 3, 'encoding': 'mono8', 'is_bigendian': 0, 'step': 3}
    cdr = serialized(IMAGE, 'camera', True, **fields, data=b'abc')
    whole = len(cdr.rstrip(b'\0'))
    for end in range(whole):
        with pytest.raises(ImageError, match=rf'sensor_msgs/msg/Image of {end} bytes is damaged'):
            RawMessage(0, IMAGE, cdr[:end]).image()
    assert bytes(RawMessage(0, IMAGE, cdr[:whole]).image().data) == b'abc'
