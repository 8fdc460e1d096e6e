# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What a pipeline says of impossible odometry, stamps that go back, and a map that is cut."""

from contextlib import closing
from dataclasses import replace
import os

from convseq_ros.app.map_builder import build_map
from convseq_ros.app.pipeline import Pipeline
from convseq_ros.config import make_config, with_values
from convseq_ros.core.types import Frame, Pose
from convseq_ros.errors import MapError
from pictures import walls
import pytest

CONFIG = make_config({'image_size_px': 128, 'keyframe_overlap': 1.0})
FRAMES = [Frame(number * 10**8, gray) for number, gray in enumerate(walls(30))]


@pytest.fixture
def opened(tmp_path):
    """Return a function that opens a map with some values of parameters."""
    build_map(FRAMES, tmp_path / 'map.db', CONFIG)
    return lambda **used: closing(Pipeline(tmp_path / 'map.db', with_values(CONFIG, used)))


@pytest.mark.parametrize('rule', ['auto', 'margin'])
def test_steps_of_odometry_that_no_robot_can_make_are_counted_and_reported(opened, rule):
    with opened(acceptance_rule=rule) as pipeline:
        cameras = pipeline.cameras
        for number, frame in enumerate(FRAMES):
            pose = Pose((0.1 * number + 12 * (number > 20), 0.0, 0.0), (0.0, 0.0, 0.0, 1.0))
            cameras.process(replace(frame, stamp_ns=frame.stamp_ns + 10**12, pose=pose))
            if number == 20:
                assert not cameras.odometry_jumps and not cameras.problems
        assert cameras.odometry_jumps == (rule == 'auto')
        assert len(cameras.problems) == (rule == 'auto')
        assert all('odometry has steps faster than 40 m/s' in one for one in cameras.problems)


def test_stamps_that_go_back_are_reported(opened):
    with opened() as pipeline:
        for stamp_ns in (5 * 10**12, 5 * 10**12 - 9 * 10**8):  # late, which is no jump
            pipeline.cameras.process(replace(FRAMES[0], stamp_ns=stamp_ns))
        assert not pipeline.cameras.problems
        pipeline.cameras.process(replace(FRAMES[0], stamp_ns=10**12))
        (line,) = pipeline.cameras.problems
        assert line.startswith('the stamps of images went back by more than a second')


def test_a_map_that_is_cut_short_ends_the_drive(opened):
    with opened() as pipeline:
        os.truncate(pipeline.path, pipeline.path.stat().st_size // 2)
        with pytest.raises(MapError, match='damaged map'):
            for frame in FRAMES:
                pipeline.cameras.process(frame)
