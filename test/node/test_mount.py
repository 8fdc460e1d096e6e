# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Where TF says that the camera is; tf2_ros itself is replaced by what it answers."""

import sys
from types import SimpleNamespace

from convseq_ros.node.frame_context import Mount
import pytest

LENS = SimpleNamespace(x=-0.5, y=0.5, z=-0.5, w=0.5)  # x right, y down, z ahead: REP-103


class Buffer:
    def __init__(self):
        self.known, self.asked = False, 0

    def can_transform(self, target, source, _time):
        self.asked += 1
        return self.known and (target, source) == ('base_link', 'lens')

    def lookup_transform(self, *_frames):
        at = SimpleNamespace(x=0.3, y=0.0, z=1.2)
        return SimpleNamespace(transform=SimpleNamespace(translation=at, rotation=LENS))


@pytest.fixture
def node():
    said = []
    logger = SimpleNamespace(info=said.append)
    return SimpleNamespace(get_logger=lambda: logger, said=said)


def test_a_lens_that_looks_ahead_is_a_camera_that_is_not_turned(node, monkeypatch):
    tf = SimpleNamespace(Buffer=Buffer, TransformListener=lambda _buffer, _node: None)
    monkeypatch.setitem(sys.modules, 'tf2_ros', tf)
    mount = Mount(node, 'base_link')
    assert mount.of('lens') is None and mount.of('') is None
    mount._buffer.known = True
    pose = mount.of('lens')
    assert pose.position == pytest.approx((0.3, 0.0, 1.2))
    assert pose.orientation == pytest.approx((0, 0, 0, 1), abs=1e-9)
    asked = mount._buffer.asked
    assert mount.of('lens') is pose and mount._buffer.asked == asked and len(node.said) == 1
    assert mount.of('another') is None


def test_without_tf2_the_parameter_decides(node, monkeypatch):
    monkeypatch.setitem(sys.modules, 'tf2_ros', None)
    assert Mount(node, 'base_link').of('lens') is None
