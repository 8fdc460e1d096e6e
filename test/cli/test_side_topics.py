# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Which topics besides the images a demo plays: the only one of its kind, if it can be used."""

from dataclasses import replace
import math

from convseq_ros.cli.demo_drives import side_topics
from convseq_ros.core.types import Camera, Pose
import numpy as np
import pytest

pytest.importorskip('rosbags')

from convseq_ros.simulation.drive import Shot
from convseq_ros.simulation.recording import write_recording

AT_REST = (0.0, 0.0, 0.0, 1.0)
SHOTS = [
    Shot(
        10**9 + index, np.full((12, 16, 3), 9, np.uint8), Pose((1.0 * index, 0.0, 0.0), AT_REST),
        1.0 * index, camera=Camera(16, 12, 10.0, 10.0, 8.0, 6.0),
    )
    for index in range(3)
]  # fmt: skip
LOST = Pose((math.nan, 0.0, 0.0), AT_REST)
UNCALIBRATED = Camera(16, 12, 0.0, 0.0, 0.0, 0.0)


@pytest.fixture
def recorded(tmp_path):
    """Return a writer of small recordings."""

    def write(**changes):
        shots = [replace(shot, **changes) for shot in SHOTS]
        write_recording(tmp_path / 'drive', shots, odom_topic='/wheels', info_topic='/info')
        return tmp_path / 'drive'

    return write


def test_odometry_that_could_be_meant_twice_is_left_out_and_named(recorded, capsys):
    assert side_topics(recorded(odometry=SHOTS[0].pose)) == ('', '/info')
    said = capsys.readouterr().err
    assert 'left out /ground_truth, /wheels' in said and said.count('\n') == 1


@pytest.mark.parametrize(
    ('changes', 'found'),
    [({'pose': LOST}, ('', '/info')), ({'camera': UNCALIBRATED}, ('/wheels', ''))],
)
def test_what_cannot_be_used_is_left_out_and_named(recorded, capsys, changes, found):
    assert side_topics(recorded(**changes)) == found
    said = capsys.readouterr().err
    assert said.startswith('warning: left out /') and said.count('\n') == 1
