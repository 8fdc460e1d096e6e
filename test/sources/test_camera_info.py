# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What a recording says of its camera and of where its frames were taken."""

from convseq_ros.core.types import Camera, Pose
from convseq_ros.errors import SourceError
from convseq_ros.sources import open_annotated, open_source
from convseq_ros.sources.camera_info import camera_from_info, correction, fitted
from convseq_ros.sources.recording import read_camera_in
import pytest
import recordings

K = (500.0, 0.0, 320.0, 0.0, 510.0, 240.0, 0.0, 0.0, 1.0)
P = (400.0, 0.0, 300.0, 0.0, 0.0, 410.0, 230.0, 0.0, 0.0, 0.0, 1.0, 0.0)
CAMERA = Camera(640, 480, 500.0, 510.0, 320.0, 240.0)


def info(k=K, p=P, size=(640, 480), model='plumb_bob', d=(0.0,) * 5, **more):
    return recordings.camera_info(k, p, size, model, d, **more)


def test_k_is_taken_and_p_where_it_is_zero():
    assert camera_from_info(info()) == CAMERA
    rectified = camera_from_info(info(k=(0.0,) * 9))
    assert rectified == Camera(640, 480, 400.0, 410.0, 300.0, 230.0)


def with_centre(x, y):
    return {'k': (500.0, 0.0, x, 0.0, 510.0, y, 0.0, 0.0, 1.0)}


ASIDE = 'px of 640 x 480, .*: K is of another size'


@pytest.mark.parametrize(
    ('change', 'said'),
    [
        ({'k': (-500.0, *K[1:])}, 'calibrate it'),
        ({'k': (float('nan'), *K[1:])}, 'calibrate it'),
        ({'k': (0.0, *K[1:])}, 'calibrate it'),
        ({'k': (5e-324, *K[1:])}, 'calibrate it'),  # the least above zero: 1 / fx is infinite
        ({'k': (*K[:5], 1e300, *K[6:])}, 'calibrate it'),
        ({'binning': (2**32 - 1, 1)}, 'calibrate it'),
        ({'size': (0, 480)}, 'calibrate it'),
        (with_centre(640.0, 480.0), f'640, 480 {ASIDE}'),
        (with_centre(320.0, 20.0), f'320, 20 {ASIDE}'),
        (with_centre(-1.0, 240.0), f'-1, 240 {ASIDE}'),
        (with_centre(160.0, 120.0), f'160, 120 {ASIDE}'),  # of half the size
        (with_centre(480.0, 370.0), f'480, 370 {ASIDE}'),
        ({'model': 'plumb_bob', 'd': (0.1,) * 6}, "'plumb_bob' of 6 numbers cannot be taken out"),
        ({'model': 'equidistant', 'd': (0.1,) * 5}, "'equidistant' of 5 numbers cannot be taken"),
    ],
)
def test_an_impossible_calibration_is_refused_in_one_line(change, said):
    with pytest.raises(SourceError, match=said) as caught:
        camera_from_info(info(**change))
    assert '\n' not in str(caught.value)


@pytest.mark.parametrize('centre', [(250.0, 190.0), (320.0, 120.0), (160.0, 360.0)])
def test_a_lens_that_is_not_quite_in_the_middle_or_a_cut_image_is_none(centre):
    camera = camera_from_info(info(**with_centre(*centre)))
    assert (camera.cx_px, camera.cy_px) == centre


def test_the_centre_of_a_part_that_is_cut_out_may_lie_anywhere():
    part = camera_from_info(info(roi=(0, 300, 180, 640)))
    assert (part.height_px, part.cy_px) == (180, -60.0)


@pytest.mark.parametrize(
    ('named', 'count', 'taken'),
    [('plumb_bob', 8, 'rational_polynomial'), ('rational_polynomial', 5, 'plumb_bob')],
)
def test_the_number_of_coefficients_decides_the_distortion_model(named, count, taken):
    message = info(model=named, d=(0.1,) * count)
    camera = camera_from_info(message)
    assert (camera.distortion_model, camera.distortion) == (taken, (0.1,) * count)
    line = correction(message, camera)
    assert line.startswith(f'distortion {named!r} of {count} numbers is read as {taken!r}; ')
    right = info(model=taken, d=(0.1,) * count)
    assert camera_from_info(right) == camera and correction(right, camera) == ''


CALIBRATION = """image_width: 32
image_height: 24
camera_matrix: {data: [25, 0, 16, 0, 25, 12, 0, 0, 1]}
distortion_model: plumb_bob
distortion_coefficients: {data: [.1, .1, .1, .1, .1, .1, .1, .1]}
"""


@pytest.mark.parametrize('is_file', [False, True])
def test_a_distortion_under_the_other_name_is_one_warning(write, pictures, tmp_path, is_file):
    named = tmp_path / 'camera.yaml' if is_file else '/info'
    (tmp_path / 'camera.yaml').write_text(CALIBRATION)
    rows = [('/info', number, info(d=(0.1,) * 8)) for number in (1, 2)]
    path = write('mcap file', [*recordings.drive(pictures), *rows])
    source = open_annotated(path, camera_info=str(named))
    for _ in range(2):
        assert {frame.camera.distortion_model for frame in source} == {'rational_polynomial'}
    where = str(named) if is_file else f'{path}: /info'
    assert source.warnings == [
        f"{where}: distortion 'plumb_bob' of 8 numbers is read as 'rational_polynomial'; "
        'mend the name in the calibration'
    ]


def test_binning_and_a_region_of_interest_change_the_camera():
    assert camera_from_info(info(binning=(2, 2))) == Camera(320, 240, 250.0, 255.0, 160.0, 120.0)
    part = camera_from_info(info(roi=(100, 40, 200, 400)))
    assert part == Camera(400, 200, 500.0, 510.0, 220.0, 200.0)


def test_the_first_calibrated_camera_of_a_recording_is_used(write, pictures):
    infos = info(k=(0.0,) * 9, p=(0.0,) * 12), info(size=(0, 0)), info()
    rows = [('/camera_info', number, one) for number, one in enumerate(infos, 1)]
    path = write('mcap folder', [*recordings.drive(pictures), *rows])
    assert read_camera_in(path)[0] == CAMERA
    with pytest.raises(SourceError, match='--camera-info /camera_info'):
        read_camera_in(path, '/other')


def test_a_recording_without_a_usable_camera_is_refused_with_the_reason(write):
    path = write('mcap folder', [('/info', 1, info(size=(0, 0)))])
    with pytest.raises(SourceError, match=r'of /info can be used: .*calibrate'):
        read_camera_in(path)


def test_frames_know_their_pose_and_a_camera_of_their_size(write, pictures):
    rows = [*recordings.drive(pictures), ('/info', 1, info())]
    for i in range(3):
        moved = recordings.odometry(float(i), recordings.START_NS + 2 * i * recordings.STEP_NS)
        rows.append(('/odom', i, moved))
    path = write('mcap folder', rows)
    source = open_annotated(path, odom='/odom', camera_info='/info')
    frames = list(source)
    assert len(source) == len(frames) == 12
    assert source.topic == open_source(path).topic
    poses = [frame.pose for frame in frames]
    assert [pose.position[0] for pose in poses[:6]] == pytest.approx([0, 0.5, 1, 1.5, 2, 2.5])
    assert poses[0] == Pose((0.0, 2.0, 3.0), (0.0, 0.0, 0.6, 0.8))
    assert poses[6:] == [None] * 6
    assert {frame.camera for frame in frames} == {fitted(CAMERA, 24, 32)}
    assert fitted(CAMERA, 24, 32).fx_px == 25.0


@pytest.mark.parametrize(('size', 'told'), [((640, 480), 0), ((640, 472), 0), ((480, 480), 1)])
def test_a_camera_of_other_proportions_is_left_out_and_told_once(write, pictures, size, told):
    path = write('mcap folder', [*recordings.drive(pictures), ('/info', 1, info(size=size))])
    source = open_annotated(path, camera_info='/info')
    # It is left out: no pose is measured by it.
    assert all((frame.camera is None) == told for frame in [*source, *source])
    lines = [line for line in source.warnings if 'proportions' in line]
    assert len(lines) == told
    for line in lines:
        assert line.startswith('camera_info is of 480 x 480 px, and images of 32 x 24 px')
