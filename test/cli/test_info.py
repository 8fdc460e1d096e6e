# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""`convseq info` tells what a recording holds, and `build-map` why places have no pose."""

from dataclasses import replace
import json
from pathlib import Path
import re
import shlex

from drives import small_drive
import pytest

pytest.importorskip('rosbags')

from convseq_ros import __version__
from convseq_ros.cli import main
from convseq_ros.cli.map_picture import draw_map
from convseq_ros.cli.recording import describe_recording, recording_lines
from convseq_ros.core.compiled import library
from convseq_ros.core.map.place import Place
from convseq_ros.core.map.reference_map import ReferenceMap
from convseq_ros.core.types import Pose
from convseq_ros.simulation.recording import write_recording as write_drive
import cv2
import numpy as np
from pictures import picture
import recordings
from recordings import compressed, image, START_NS, STEP_NS, write_recording


@pytest.fixture(scope='module')
def drive(tmp_path_factory) -> Path:
    path = tmp_path_factory.mktemp('drive') / 'first drive'
    shots = small_drive()[:12]
    write_drive(path, shots, odom_topic='/wheels/odom', info_topic='/camera/camera_info')
    return path


def test_the_line_to_paste_builds_a_map_with_poses(drive, capsys, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert main(['info', str(drive)]) == 0
    (line,) = re.findall(r'^  convseq (build-map .*)$', capsys.readouterr().out, re.MULTILINE)
    assert main(shlex.split(line)) == 0
    assert '12 added, 12 with a pose, from' in capsys.readouterr().out
    assert main(['info', 'map.db', '--json']) == 0
    facts = json.loads(capsys.readouterr().out)
    assert (len(facts['sessions']), facts['path_m']) == (1, pytest.approx(11.0, abs=0.1))


def test_build_map_info_and_replay_tell_where_the_camera_is(drive, capsys, tmp_path):
    path, output = str(tmp_path / 'map.db'), ['--output', str(tmp_path / 'result.csv')]
    camera = ['--camera-info', '/camera/camera_info', '--camera-to-base']
    assert main(['build-map', str(drive), path, *camera, '1 0 1 0 0 0']) == 0
    assert 'camera_to_base is "1 0 1 0 0 0", as given' in capsys.readouterr().err
    assert main(['info', path]) == 0
    assert 'camera_to_base "1 0 1 0 0 0"' in capsys.readouterr().out
    replay = ['replay', str(drive), '--map', path, *output, *camera]
    assert main([*replay, '1 0 1 0 0 0']) == 0
    assert capsys.readouterr().err == 'camera_to_base is "1 0 1 0 0 0", as given\n'
    assert main([*replay, '2 0 1 0 0 0']) == 0
    assert capsys.readouterr().err.startswith('warning: camera_to_base is "2 0 1 0 0 0", and was')


def test_odometry_comes_before_the_truth(tmp_path):
    shots = small_drive()[:2]
    measured = [replace(shot, odometry=shot.pose) for shot in shots]
    write_drive(tmp_path / 'drive', measured, odom_topic='/odom')
    assert describe_recording(tmp_path / 'drive')['use']['--odom'] == ['/odom', '/ground_truth']


def test_info_without_a_file_lists_the_installed_versions(capsys):
    assert main(['info', '--json']) == 0
    told = json.loads(capsys.readouterr().out)
    assert told['convseq_ros'] == __version__ and told['numpy'] == np.__version__
    assert told['kernels'] == library().variant or library().problem in told['kernels']
    assert main(['info']) == 0
    assert [line.split()[0] for line in capsys.readouterr().out.splitlines()] == [*told]


def test_a_hostile_topic_name_is_quoted_as_one_word():
    cameras = ['/a; touch owned', "/b' $(id)\n\x1b[2J"]
    each = {'type': 'sensor_msgs/msg/Image', 'messages': 2, 'rate_hz': 1.0}
    facts = {'recording': 'x', 'images': 2, 'seconds': 1.0, 'warnings': []}
    facts['topics'] = [{'topic': name, **each} for name in cameras]
    lines = recording_lines(facts | {'use': {'--topic': cameras}})
    assert all(line.isprintable() for line in lines)
    pasted = [shlex.split(line) for line in lines if '--topic' in line or ' -r ' in line]
    assert [words[-1] for words in pasted] == [
        cameras[0], f'image:={cameras[0]}', r"/b' $(id)\x0a\x1b[2J"
    ]  # fmt: skip


DEPTH_CAMERAS = {  # the colour topic, one of depth, and the encoding of depth
    'TUM RGB-D': ('/camera/rgb/image_color', '/camera/depth/image', '32FC1'),
    'RealSense': (
        '/camera/color/image_raw', '/camera/aligned_depth_to_color/image_raw', '16UC1'
    ),
}  # fmt: skip


def camera_info(focal_px=60.0):
    k = np.array([focal_px, 0, 40, 0, focal_px, 30, 0, 0, 1 if focal_px else 0])
    projection = np.insert(k.reshape(3, 3), 3, 0, axis=1).ravel()
    return recordings.camera_info(k, projection, (80, 60), 'plumb_bob', (0.0,) * 5, START_NS)


def told(path, capsys):
    """Return the commands to paste, and all lines."""
    assert main(['info', str(path)]) == 0
    lines = capsys.readouterr().out.splitlines()
    return [shlex.split(line) for line in lines if line.startswith('  convseq ')], lines


@pytest.mark.parametrize('name', DEPTH_CAMERAS)
def test_colour_is_proposed_and_depth_never(name, tmp_path, capsys):
    color, depth, encoding = DEPTH_CAMERAS[name]
    rooms = (topic.rpartition('/')[0] for topic in (color, depth))
    color_info, depth_info = (f'{room}/camera_info' for room in rooms)
    gray, rows = picture(0), []
    for stamp_ns in (START_NS, START_NS + STEP_NS):
        depths = image(gray, stamp_ns, encoding=encoding)
        rows += [(depth, stamp_ns, depths), (color, stamp_ns, image(gray, stamp_ns))]
        rows += [(depth_info, stamp_ns, camera_info()), (color_info, stamp_ns, camera_info())]
    path = write_recording(tmp_path, 'mcap folder', rows)
    (build,), lines = told(path, capsys)
    chosen = ['--topic', color, '--camera-info', color_info]
    assert build[1:] == ['build-map', str(path), 'map.db', *chosen]
    assert f'  ros2 bag play {path}' in lines and ': 2 images' in lines[0]
    assert f'-r image:={color} -r camera_info:={color_info}' in '\n'.join(lines)
    assert not [line for line in lines[5:] if f'{depth} ' in f'{line} ']
    assert main([*build[1:3], str(tmp_path / 'map.db'), *build[4:]]) == 0


def test_colour_comes_first_then_raw_images_and_usual_names(tmp_path, capsys):
    gray = picture(0)
    color = {'encoding': 'bgr8', 'step': 3 * gray.shape[1], 'data': np.repeat(gray, 3)}
    messages = {
        '/a/debug_image': image(gray),
        '/a/drawn': image(gray, **color),
        '/a/mono': image(gray),
        '/b/compressed': compressed(gray, name='rgb8; jpeg compressed bgr8'),
        '/b/compressedDepth': compressed(gray, name='16UC1; compressedDepth png'),
        '/b/image_raw': image(gray, **color),
    }
    rows = [(topic, START_NS, message) for topic, message in messages.items()]
    path = write_recording(tmp_path, 'mcap folder', rows)
    facts = describe_recording(path)
    assert facts['use']['--topic'] == ['/b/image_raw', '/a/drawn', '/b/compressed', '/a/mono']
    assert facts['images'] == 4


def test_a_camera_that_is_not_calibrated_or_of_another_image_is_not_proposed(tmp_path, capsys):
    rows = [
        ('/a/image', START_NS, image(picture(0))), ('/a/camera_info', START_NS, camera_info(0.0)),
        ('/b/image', START_NS, image(picture(0))), ('/c/camera_info', START_NS, camera_info()),
    ]  # fmt: skip
    commands, lines = told(write_recording(tmp_path, 'mcap folder', rows), capsys)
    assert [command[-2:] for command in commands] == [['--topic', '/a/image']]
    assert lines[-2:] == ['  --topic /b/image', '  --camera-info /c/camera_info']


def test_a_recording_without_a_camera_gets_no_map_command(tmp_path, capsys):
    rows = [('/vpr_node/debug_image', START_NS, image(picture(0)))]
    commands, lines = told(write_recording(tmp_path, 'mcap folder', rows), capsys)
    assert commands == [] and lines[-1] == 'no images of a camera: no map can be made of it'


def test_building_a_map_without_poses_names_the_topic_that_has_them(drive, capsys, tmp_path):
    assert main(['build-map', str(drive), str(tmp_path / 'map.db')]) == 0
    assert 'no poses: none were asked for; add --odom /wheels/odom' in capsys.readouterr().out


def test_poses_of_another_time_are_reported(drive, capsys, tmp_path):
    poses = tmp_path / 'poses.txt'
    poses.write_text('1.0 0 0 0 0 0 0 1\n2.0 1 0 0 0 0 0 1\n')
    assert main(['build-map', str(drive), str(tmp_path / 'm.db'), '--poses', str(poses)]) == 0
    assert 'poses.txt has no pose at the times of' in capsys.readouterr().err


def test_the_picture_of_a_straight_street_has_a_height(tmp_path):
    pytest.importorskip('matplotlib')
    street = ReferenceMap()
    cells = np.zeros(street.cell_shape, np.float16)
    for x in range(5):
        street.add(Place(x, '', Pose((float(x), 0.0, 0.0), (0.0, 0.0, 0.0, 1.0))), cells)
    draw_map(tmp_path / 'street.png', street, tmp_path / 'street.db')
    drawn = cv2.imread(str(tmp_path / 'street.png'), cv2.IMREAD_GRAYSCALE)
    rows = np.flatnonzero((drawn < 100).any(axis=1))
    assert rows.max() - rows.min() > drawn.shape[0] / 4


def test_info_reports_that_satellite_fixes_are_not_poses():
    fix = {'topic': '/fix', 'type': 'sensor_msgs/msg/NavSatFix', 'messages': 3, 'rate_hz': 1.0}
    facts = {'recording': 'drive', 'images': 2, 'seconds': 2.0, 'topics': [fix], 'warnings': []}
    lines = [line for line in recording_lines(facts) if '--poses' in line]
    assert lines == [
        '/fix has satellite fixes, which are no poses; docs/howto/satellite_fixes.md makes a file '
        'for --poses of them'
    ]
