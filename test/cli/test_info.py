# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""`convseq info` tells what a recording holds, and `build-map` why places have no pose."""

import json
from pathlib import Path
import re
import shlex

from drives import shots_of
import pytest

pytest.importorskip('rosbags')

from convseq_ros import __version__
from convseq_ros.cli import main
from convseq_ros.cli.info import recording_lines
from convseq_ros.core.compiled import library
from convseq_ros.simulation.drive import Drive
from convseq_ros.simulation.recording import write_recording
from convseq_ros.simulation.street import Street
import numpy as np


@pytest.fixture(scope='module')
def drive(tmp_path_factory) -> Path:
    path = tmp_path_factory.mktemp('drive') / 'first drive'
    shots = shots_of(Street(60.0, seed=3), Drive(num_frames=30, width_px=160, height_px=120))[:12]
    write_recording(path, shots, odom_topic='/wheels/odom', info_topic='/camera/camera_info')
    return path


def test_the_line_to_paste_builds_a_map_with_poses(drive, capsys, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert main(['info', str(drive)]) == 0
    (line,) = re.findall(r'^  convseq (build-map .*)$', capsys.readouterr().out, re.MULTILINE)
    assert main(shlex.split(line)) == 0
    assert '12 references, 12 with a pose' in capsys.readouterr().out
    assert main(['info', 'map.db', '--json']) == 0
    facts = json.loads(capsys.readouterr().out)
    assert (len(facts['sessions']), facts['path_m']) == (1, pytest.approx(11.0, abs=0.1))


def test_without_a_file_it_says_what_is_installed(capsys):
    assert main(['info', '--json']) == 0
    told = json.loads(capsys.readouterr().out)
    assert told['convseq_ros'] == __version__ and told['numpy'] == np.__version__
    assert told['kernels'] == library().variant or library().problem in told['kernels']
    assert main(['info']) == 0
    assert [line.split()[0] for line in capsys.readouterr().out.splitlines()] == [*told]


def test_what_a_stranger_called_a_topic_is_one_word_to_paste():
    cameras = ['/a; touch owned', "/b' $(id)\n\x1b[2J"]
    each = {'type': 'sensor_msgs/msg/Image', 'messages': 2, 'rate_hz': 1.0}
    facts = {'recording': 'x', 'images': 2, 'seconds': 1.0, 'warnings': []}
    facts['topics'] = [{'topic': name, **each} for name in cameras]
    lines = recording_lines(facts | {'use': {'--topic': cameras}})
    assert all(line.isprintable() for line in lines)
    pasted = [shlex.split(line) for line in lines if '--topic' in line or ' -r ' in line]
    assert [words[-1] for words in pasted] == [
        cameras[0], f'image:={cameras[0]}', "/b' $(id)??[2J"
    ]  # fmt: skip


def test_a_map_without_poses_says_which_topic_has_them(drive, capsys, tmp_path):
    assert main(['build-map', str(drive), str(tmp_path / 'map.db')]) == 0
    assert 'no poses: none were asked for; add --odom /wheels/odom' in capsys.readouterr().out


def test_poses_of_another_time_are_said_not_to_fit(drive, capsys, tmp_path):
    poses = tmp_path / 'poses.txt'
    poses.write_text('1.0 0 0 0 0 0 0 1\n2.0 1 0 0 0 0 0 1\n')
    assert main(['build-map', str(drive), str(tmp_path / 'm.db'), '--poses', str(poses)]) == 0
    assert 'poses.txt has no pose at the time of an image' in capsys.readouterr().out
