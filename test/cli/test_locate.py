# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Where images were taken, asked by `convseq locate`."""

import json

from convseq_ros.cli import main
from convseq_ros.core.map.writer import save_map
import cv2
import numpy as np
import pictures
import pytest
from world import street_of

# Sure of single frames that have nothing in common.
SETTINGS = ('--matching', 'regional', '--search', 'exhaustive', '--fixed-length', '1')


@pytest.fixture(scope='module')
def walls():
    return pictures.walls(25)


@pytest.fixture(scope='module', params=[True, False], ids=['poses', 'no_poses'])
def place_map(request, walls, tmp_path_factory):
    path = tmp_path_factory.mktemp('map') / 'walls.db'
    save_map(street_of(walls, is_posed=request.param), path)
    return path, request.param


@pytest.fixture
def images(walls, tmp_path):
    for index, gray in enumerate(walls):
        cv2.imwrite(str(tmp_path / f'{index}.png'), gray)
    return lambda *indices: [str(tmp_path / f'{index}.png') for index in indices]


def test_the_last_few_images_give_place_pose_and_quality(place_map, images, tmp_path, capsys):
    path, has_poses = place_map
    picture = tmp_path / 'match.png'
    asked = [*images(3, 4), '--map', str(path), '--picture', str(picture)]
    assert main(['locate', *asked, *SETTINGS]) == 0
    told = capsys.readouterr().out.splitlines()
    assert told[:2] == ['localised: place 4, quality not known', 'taken at 5 ns, from street']
    assert told[2].startswith('x 4.00 y 2.00 z 0.50 m' if has_poses else 'no pose: the map has')
    assert cv2.imread(str(picture)).shape == (264, 640, 3)


@pytest.mark.parametrize('rule', ['belief', 'margin'])
def test_one_image_is_a_candidate_or_localised_by_its_margin(place_map, images, capsys, rule):
    path, has_poses = place_map
    settings = SETTINGS if rule == 'margin' else ['--search', 'exhaustive']
    assert main(['locate', *images(7), '--map', str(path), '--json', *settings]) == 0
    answer = json.loads(capsys.readouterr().out)
    assert (answer['place'], answer['images']) == (7, 1)
    assert answer['state'] == ('localised' if rule == 'margin' else 'candidate')
    if rule == 'belief':
        assert answer['problem'] == 'nothing recognised in 1 keyframes (1 weak)'
        assert 0.1 <= answer['quality'] < 0.9
    if has_poses:
        assert answer['pose']['position_m'] == [7.0, 2.0, 0.5]
        assert len(answer['pose']['covariance']) == 36
    else:
        assert answer['pose'] is None


def test_a_distortion_of_another_name_and_the_mount_are_a_line_each(
    place_map, images, tmp_path, capsys
):
    (tmp_path / 'camera.yaml').write_text(
        'image_width: 160\nimage_height: 120\ndistortion_model: rational_polynomial\n'
        'camera_matrix: {data: [90, 0, 80, 0, 90, 60, 0, 0, 1]}\n'
        'distortion_coefficients: {data: [.1, 0, 0, 0, 0]}\n'
    )
    asked = [*images(3, 4), '--map', str(place_map[0]), '--camera-info']
    assert main(['locate', *asked, str(tmp_path / 'camera.yaml'), *SETTINGS]) == 0
    warning, mount = capsys.readouterr().err.splitlines()
    assert mount.startswith('camera_to_base is "0 0 0 0 0 0": the base is at the lens')
    assert warning == (
        f"warning: {tmp_path}/camera.yaml: distortion 'rational_polynomial' of 5 numbers is read "
        "as 'plumb_bob'; mend the name in the calibration"
    )


def test_an_image_that_is_not_recognised_gets_an_answer(place_map, tmp_path, capsys):
    path, _ = place_map
    cv2.imwrite(str(tmp_path / 'black.png'), np.zeros((120, 160), np.uint8))
    assert main(['locate', str(tmp_path / 'black.png'), '--map', str(path), *SETTINGS]) == 0
    told = 'lost: no keyframe yet: move the robot, so that the image changes\n'
    assert capsys.readouterr().out == told


def test_an_unreadable_image_among_others_is_warned_about(place_map, images, tmp_path, capsys):
    (tmp_path / 'text.png').write_text('no picture')
    asked = [str(tmp_path / 'text.png'), *images(3, 4)]
    assert main(['locate', *asked, '--map', str(place_map[0]), *SETTINGS]) == 0
    told = capsys.readouterr()
    assert told.out.startswith('localised: place 4')
    assert told.err.startswith(f'warning: {tmp_path / "text.png"}: not a readable picture (')
