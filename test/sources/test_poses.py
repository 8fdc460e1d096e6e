# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Poses out of text files and odometry, and at any time between."""

import math
from pathlib import Path
import re
import sys
from types import SimpleNamespace

from convseq_ros.core.types import Camera, Frame, Pose
from convseq_ros.errors import SourceError
from convseq_ros.sources import in_order, open_annotated
from convseq_ros.sources.annotated_frames import AnnotatedFrames
from convseq_ros.sources.pose_file import read_pose_file
from convseq_ros.sources.pose_track import axes_problem, pose_from_message, PoseTrack
from convseq_ros.sources.source import Lines
import cv2
from hypothesis import given, strategies
import numpy as np
from poses import at as pose
from programs import run
import pytest
import recordings

AHEAD = '1 0 0 0 0 1 0 0 0 0 1 2.5'  # of a lens: 2.5 m along its axis
# Turned by 90 degrees to the right, about the axis that points down; 1 m to the right and 3 down.
RIGHT = '0 0 1 1 0 1 0 3 -1 0 0 0'


@pytest.fixture
def file(tmp_path):
    """Return a function that writes lines to a file and names it."""

    def write(*lines):
        path = tmp_path / 'poses.txt'
        path.write_text('\n'.join(lines) + '\n')
        return path

    return write


def test_the_axes_of_kitti_become_those_of_a_robot(file):
    pose_at = read_pose_file(file(AHEAD, '', RIGHT), 2)
    assert pose_at(0, 0) == pose(2.5)
    assert pose_at(1, 0).position == (0.0, -1.0, -3.0)
    marked = read_pose_file(file(f'\ufeff{AHEAD}'), 1)  # as some editors of Windows save it
    assert marked(0, 0) == pose_at(0, 0)
    # To the right is clockwise from above: a negative turn about the axis that points up.
    half = math.sqrt(0.5)
    assert pose_at(1, 0).orientation == pytest.approx((0.0, 0.0, -half, half))


def test_stamps_of_tum_are_exact_and_frames_lie_between_them(file):
    lines = '1700000000.000000003 2 0 0 0 0 0 2', '1700000000.5 1 0 0 0 0 0 1'
    pose_at = read_pose_file(file('# timestamp tx ty', *lines), 7)
    assert pose_at(0, 1_700_000_000_000_000_003) == pose(2)
    assert pose_at(9, 1_700_000_000_250_000_001).position[0] == pytest.approx(1.5)
    assert pose_at(0, 1_700_000_000_000_000_002) is None
    assert pose_at(0, 1_700_000_002_000_000_000) is None


@pytest.mark.parametrize(
    'lines',
    [
        ('1700000000000000003.000000 2 0 0 0 0 0 1',),  # ORB-SLAM3's nanoseconds
        ('1700000000000000.003 2 0 0 0 0 0 1',),
        ('1700000000000.000003 2 0 0 0 0 0 1',),
        ('#timestamp, x, y, z, qx, qy, qz, qw', '1700000000.000000003, 2, 0, 0, 0, 0, 0, 1'),
        ('timestamp x y z qx qy qz qw', '1700000000.000000003,2,0,0,0,0,0,1'),
        ('#timestamp x y z qx qy qz qw id', '1700000000.000000003 2 0 0 0 0 0 1 7'),  # RTAB-Map's
    ],
)
def test_poses_as_other_programs_write_them_are_read(file, lines):
    pose_at = read_pose_file(file(*lines), 1)
    assert pose_at(0, 1_700_000_000_000_000_003).position == (2.0, 0.0, 0.0)


def test_a_folder_has_a_matrix_for_each_image(tmp_path):
    for number, matrix in ((10, RIGHT), (9, AHEAD)):
        path = tmp_path / f'frame-{number}.pose.txt'
        path.write_text('\n'.join([*matrix.split(), '0 0 0 1']))
    pose_at = read_pose_file(tmp_path, 2)
    assert pose_at(0, 0).position == (2.5, 0.0, 0.0)
    assert pose_at(1, 0).position == (0.0, -1.0, -3.0)
    (tmp_path / 'frame-11.pose.txt').write_text('1 0')
    with pytest.raises(SourceError, match=r'frame-11.pose.txt: 2 numbers; expected 8'):
        read_pose_file(tmp_path, 3)


# Of two numbers so small that they have few digits left, the direction below is not known.
@given(strategies.lists(strategies.floats(-1, 1, allow_subnormal=False), min_size=4, max_size=4))
def test_a_kitti_rotation_keeps_its_axis_and_angle(tmp_path_factory, numbers):
    length = math.hypot(*numbers)
    if length < 0.1:
        return
    x, y, z, w = (value / length for value in numbers)
    angle = 2 * math.atan2(math.hypot(x, y, z), w)
    vector = np.array([x, y, z]) / (math.hypot(x, y, z) or 1) * angle
    rotation, _ = cv2.Rodrigues(vector)
    path = tmp_path_factory.mktemp('poses') / 'poses.txt'
    path.write_text(' '.join(repr(float(v)) for row in rotation for v in (*row, 0.0)))
    found = read_pose_file(path, 1)(0, 0).orientation
    # The same turn about the same axis, with the axes named as a robot does.
    wanted = (z, -x, -y, w)
    assert abs(sum(a * b for a, b in zip(found, wanted, strict=True))) == pytest.approx(1)
    assert found[3] >= 0


@pytest.mark.parametrize(
    ('lines', 'said'),
    [
        ((), 'holds no pose'),
        (None, 'no such file; give a text file with one pose'),
        (('timestamp tx', '{'), 'holds no pose'),
        (('#timestamp [ns], p_RS_R_x [m], q_RS_w [], q_RS_x []',), 'line 1: .* begin with w; TUM'),
        (('VehicleName TimeStamp POS_X Q_W Q_X',), 'line 1: .* docs/FILES.md shows how AirSim'),
        (('{"fl_x": 1.5,', '"frames": [{'), 'line 1: 2 numbers; .* docs/FILES.md .* and NeRF'),
        (b'\xff\xfe\x00', 'not a text file'),
        (('# nothing',), 'holds no pose'),
        (('1 2 3',), 'line 1: 3 numbers'),
        ((AHEAD, '1 2 3'), 'line 2: 3 numbers'),
        ((AHEAD, AHEAD.replace('2.5', 'x')), "line 2: could not convert string to float: 'x'"),
        ((AHEAD, AHEAD.replace('2.5', 'nan')), 'line 2: a number is not finite'),
        ((AHEAD, '2' + AHEAD[1:]), 'line 2: its first three columns are not a rotation'),
        ((AHEAD, '-' + AHEAD), 'line 2: its first three columns are not a rotation'),
        ((AHEAD,), '1 poses for 2 images'),
        (('1 0 0 0 0 0 0 0',), 'line 1: the quaternion is zero'),
        (('1 2 0 0 1 0 0 0 a.png',), "line 1: .* to float: 'a.png'"),  # AirSim's, without a head
        (('-1 0 0 0 0 0 0 1',), 'line 1: -1 is not a stamp'),
        (('1e99 0 0 0 0 0 0 1',), 'line 1: 1e99 is not a stamp'),
        (('1e99999999 0 0 0 0 0 0 1',), 'line 1: 1e99999999 is not a stamp'),
        (('nan 0 0 0 0 0 0 1',), 'line 1: nan is not a stamp'),
        (('inf 0 0 0 0 0 0 1',), 'line 1: inf is not a stamp'),
        (('x 0 0 0 0 0 0 1',), 'line 1: x is not a stamp'),
        (('2 1e308 0 0 0 0 0 1',), 'line 1: a position of 1e.308 m is beyond'),
        ((AHEAD, AHEAD.replace('2.5', '-3e8')), 'line 2: a position of -3e.08 m is beyond'),
    ],
)
def test_an_invalid_pose_is_named_with_its_line(file, tmp_path, lines, said):
    path = file(*lines) if isinstance(lines, tuple) else tmp_path / ('binary' if lines else 'none')
    if isinstance(lines, bytes):
        path.write_bytes(lines)
    with pytest.raises(SourceError, match=said):
        read_pose_file(path, 2)


CALIBRATION = """
image_width: 64
image_height: 48
camera_matrix: {rows: 3, cols: 3, data: [50, 0, 30, 0, 51, 20, 0, 0, 1]}
"""
KITTI = 'P0: 50 0 30 0 0 51 20 0 0 0 1 0\nP1: 9 0 9 0 0 9 9 0 0 0 1 0'
ONE_LINE = CALIBRATION + 'projection_matrix:\n  data: [9, 0, 9, 0, 0, 9, 9, 0, 0, 0, 1, 0]\n'
MATRIX = '50 0 30\n0 51 20\n0 0 1\n'


@pytest.fixture
def folder(tmp_path):
    """Return a folder of two pictures, 48 px high and 64 wide."""
    (tmp_path / 'images').mkdir()
    for name in 'ab':
        cv2.imwrite(str(tmp_path / 'images' / f'{name}.png'), np.zeros((48, 64), np.uint8))
    return tmp_path / 'images'


@pytest.mark.parametrize(
    'text',
    [
        CALIBRATION,
        KITTI,
        ONE_LINE,
        ONE_LINE.replace('data: [9', '{data: [9').replace('1, 0]', '1, 0]}'),
        MATRIX,
        '[[50., 0, 30], [0, 51, 20],\n [0, 0, 1]]',
        '50,0,30,0\n0,51,20,0\n0,0,1,0\n0,0,0,1',  # ScanNet's
    ],
)
def test_frames_of_a_folder_know_their_poses_and_their_camera(folder, file, tmp_path, text):
    (tmp_path / 'camera').write_text(text)
    source = open_annotated(folder, camera_info=str(tmp_path / 'camera'), poses=file(AHEAD, RIGHT))
    first, second = source
    assert first.pose.position == (2.5, 0.0, 0.0) and second.pose.position == (0.0, -1.0, -3.0)
    assert first.camera == second.camera == Camera(64, 48, 50.0, 51.0, 30.0, 20.0)


@pytest.mark.parametrize(
    ('text', 'said'),
    [
        ('', 'neither a calibration of ROS'),
        ('image_width: 64', 'neither a calibration of ROS'),
        ('[' * 1000, 'neither a calibration of ROS'),
        ('!!python/object/apply:os.system [true]', 'neither a calibration of ROS'),
        (MATRIX.replace('0 1', '1 0'), 'nor a 3 x 3 matrix'),
        (CALIBRATION.replace('50, 0,', '50,'), 'matrices K and P of 8 and 12 numbers'),
        (CALIBRATION.replace('50, 0, 30, 0, 51, 20', '0, 0, 0, 0, 0, 0').replace(', 1]', ', 0]'),
         'not calibrated'),
        (CALIBRATION.replace('50', '-50'), 'are not those of a camera'),
        (KITTI.replace('50', 'nan'), 'are not those of a camera'),
    ],
)  # fmt: skip
def test_an_invalid_camera_is_refused(folder, tmp_path, text, said):
    (tmp_path / 'camera').write_text(text)
    with pytest.raises(SourceError, match=said):
        list(open_annotated(folder, camera_info=str(tmp_path / 'camera')))


def test_a_folder_has_no_topics_and_one_source_of_poses(folder, file):
    with pytest.raises(SourceError, match='a folder of pictures has no topics'):
        open_annotated(folder, camera_info='/camera_info')
    with pytest.raises(SourceError, match='give one of them'):
        open_annotated(folder, odom='/odom', poses=file(AHEAD, AHEAD))


SECOND, MS = 1_000_000_000, 1_000_000  # in nanoseconds


def degrees_of(found):
    return math.degrees(2 * math.atan2(found.orientation[2], found.orientation[3]))


@given(strategies.floats(0, 1), strategies.floats(-170, 170))
def test_orientation_is_interpolated_at_a_constant_rate(share, turn):
    track = PoseTrack([(0, pose(0)), (SECOND, pose(4, yaw=math.radians(turn)))])
    found = track.at(round(share * SECOND))
    assert found.position[0] == pytest.approx(4 * share, abs=1e-6)
    assert degrees_of(found) == pytest.approx(share * turn, abs=1e-4)


def test_a_pose_is_extrapolated_for_a_tenth_of_a_second_at_most():
    track = PoseTrack([(0, pose(0)), (SECOND // 2, pose(1, yaw=math.radians(10)))])
    late = track.at(SECOND // 2 + 100 * MS)
    assert late.position[0] == pytest.approx(1.2)
    assert degrees_of(late) == pytest.approx(12, abs=1e-3)
    assert track.at(SECOND // 2 + 101 * MS) is None


def test_late_poses_are_left_out_and_a_backward_clock_jump_restarts_the_track():
    track = PoseTrack([(5 * SECOND, pose(1)), (5 * SECOND, pose(9)), (5 * SECOND - 1, pose(9))])
    assert track.last_stamp_ns == 5 * SECOND and track.at(5 * SECOND) == pose(1)
    track.add(SECOND, pose(2))
    assert track.last_stamp_ns == SECOND
    assert track.at(5 * SECOND) is None and track.at(SECOND) == pose(2)


def track_of(*metres):
    return PoseTrack((SECOND + number * 100 * MS, pose(x)) for number, x in enumerate(metres))


@pytest.mark.parametrize(
    'outliers', [[500], [500, 501], [500, -300, 7000], [500, 500.5, 501, 501.5], [12, 13]]
)
def test_poses_that_jump_and_come_back_are_left_out(outliers):
    back = 3 + len(outliers)
    track = track_of(0, 1, 2, *outliers, back, back + 1)
    assert track.left_out == len(outliers)
    for x in np.arange(2, back, 0.5):
        assert track.at(SECOND + int(x * 100) * MS).position[0] == pytest.approx(x)


@pytest.mark.parametrize(
    'metres',
    [
        (0, 1, 2, 500, 501, 502, 503, 504),  # a reset
        (0, 1, 2, 12, 12.5, 13, 13.5, 14),  # which the robot might have reached meanwhile
        (0, 100, 200, 300, 400, 500, 600, 700),  # a wrong unit
        (0, 1, 500, 900, 901, 300, 2000, 100),  # no order at all
    ],
)
def test_poses_that_jump_and_stay_away_are_kept(metres):
    track = track_of(*metres)
    assert not track.left_out
    assert [track.at(SECOND + step * 100 * MS).position[0] for step in range(8)] == list(metres)


def test_a_jump_is_not_believed_until_the_next_poses_confirm_it():
    assert track_of(0, 1, 2, 500, 501, 502, 503).last_stamp_ns == SECOND + 200 * MS
    track = track_of(0, 1, 2, 500)
    for stamp_ns, x in ((SECOND + 300 * MS, 500), (SECOND + 250 * MS, 2.5)):  # late ones replace
        track.add(stamp_ns, pose(x))
    assert track.last_stamp_ns == SECOND + 250 * MS


@pytest.mark.parametrize(
    ('metres', 'count'),
    [([0, 1, 2, 500, 501, *range(5, 12)], 2), ([*range(8), 500, 501, 502, 503], 4)],
)
def test_poses_that_are_left_out_are_told_once(write, pictures, file, metres, count):
    rows, lines = recordings.drive(pictures), []
    for number, x in enumerate(metres):
        stamp_ns = recordings.START_NS + recordings.STEP_NS * number
        rows.append(('/odom', stamp_ns, recordings.odometry(float(x), stamp_ns)))
        lines.append(f'{stamp_ns / 1e9:.9f} {x} 0 0 0 0 0 1')
    path, poses = write('mcap file', rows), file(*lines)
    for name, option in (('/odom', {'odom': '/odom'}), (poses, {'poses': poses})):
        source = in_order([open_annotated(path, **option) for _ in range(2)])
        assert len(list(source)) == 24
        (told,) = source.warnings
        assert told.startswith(f'{name}: poses that jump faster than 40 m/s, and back or at the ')
        assert f'({count})' in told


def test_a_live_track_forgets_what_is_old():
    track = PoseTrack(kept=10)
    for index in range(1000):
        track.add(index * MS, pose(index))
    assert track.at(500 * MS) is None
    assert track.at(995 * MS).position[0] == 995


def message(x, y, z, w, far_m=1):
    position, turn = SimpleNamespace(x=far_m, y=2, z=3), SimpleNamespace(x=x, y=y, z=z, w=w)
    return SimpleNamespace(position=position, orientation=turn)


def test_quaternions_are_made_unit_and_impossible_ones_are_no_pose():
    assert pose_from_message(message(0, 0, 3, 4)).orientation == pytest.approx((0, 0, 0.6, 0.8))
    assert pose_from_message(message(0, 0, 0.6, 0.8)).orientation == (0, 0, 0.6, 0.8)
    assert pose_from_message(message(0, 0, 0, 0)) is None
    assert pose_from_message(message(0, 0, math.nan, 1)) is None
    assert pose_from_message(message(0, 0, 0, 1, far_m=1e300)) is None


def test_opposite_quaternions_are_the_same_turn():
    track = PoseTrack([(0, pose(0)), (SECOND, Pose((1.0, 0.0, 0.0), (0.0, 0.0, 0.0, -1.0)))])
    assert track.at(SECOND // 2).orientation == (0, 0, 0, 1)


def test_there_is_no_pose_before_after_or_in_a_long_gap():
    track = PoseTrack([(SECOND, pose(0)), (3 * SECOND, pose(2))])
    assert [track.at(stamp) for stamp in (0, 2 * SECOND, 4 * SECOND)] == [None] * 3
    assert PoseTrack([]).at(0) is None


def test_poses_once_a_second_with_jitter_leave_no_gap():
    track = PoseTrack([(0, pose(0)), (SECOND + 5_000_000, pose(1)), (2 * SECOND, pose(2))])
    assert all(track.at(stamp) for stamp in range(0, 2 * SECOND, SECOND // 10))


class Shown(list):
    """Stands in for a source of frames."""

    name = topic = ''

    def __init__(self, count):
        super().__init__(Frame(at, np.zeros((4, 4), np.uint8)) for at in range(count))
        self.warnings = Lines()


@pytest.mark.parametrize(
    ('known', 'said'),
    [(0, 'no pose at the times of 5 images'), (2, '2 poses at the times of 5 images'), (3, '')],
)
def test_a_drive_of_which_most_images_have_no_pose_says_so(known, said):
    source = Shown(5)
    found = AnnotatedFrames(source, lambda at, _: pose(at) if at < known else None, None, '/odom')
    assert sum(frame.pose is not None for frame in found) == known
    assert len(source.warnings) == bool(said)
    assert all(line.startswith(f'/odom has {said}; check') for line in source.warnings)


@pytest.mark.parametrize(
    ('way', 'turn', 'is_said'),
    [
        ((0, 0, 1.0), (0, 0, 0, 1), True),  # z ahead, in a world like that
        ((1.0, 0, 0), (-0.5, 0.5, -0.5, 0.5), True),  # z ahead, in a level world
        ((1.0, 0, 0), (0, 0, 0, 1), False),
        ((0.6, 0, 0.5), (0, 0, 0, 1), False),  # a steep way
        ((0, 0, 0.1), (0, 0, 0, 1), False),  # too short
    ],
)
def test_poses_in_axes_of_a_lens_are_told(way, turn, is_said):
    line = axes_problem(Pose(tuple(at * part for part in way), turn) for at in range(8))
    assert line.startswith('poses move along') if is_said else not line


def test_shivering_is_no_motion_along_an_axis():
    assert not axes_problem(Pose((at * 0.1, 0.0, at % 2 * 0.4), (0, 0, 0, 1)) for at in range(99))


def test_a_topic_in_axes_of_a_lens_is_taken_and_told(tmp_path):
    times_ns = [recordings.START_NS + recordings.STEP_NS * at for at in range(8)]
    rows = [*recordings.drive([np.zeros((24, 32), np.uint8)] * 8)]
    for at, stamp_ns in enumerate(times_ns):
        message = recordings.odometry(0.0, stamp_ns)
        message.pose.pose.position.z = float(at)
        rows.append(('/odom', stamp_ns, message))
    source = open_annotated(recordings.write_recording(tmp_path, 'mcap file', rows), odom='/odom')
    assert [frame.pose.position[2] for frame in source] == [*range(8)]
    (line,) = source.warnings
    assert line.startswith('/odom: poses move along their own z (7 of 7 m)')


def test_poses_of_a_lens_are_converted_if_somebody_says_so(file):
    """As KITTI's are turned: a metre to the right, one down and one ahead, turned to the right."""
    half = math.sqrt(0.5)
    turned = read_pose_file(file(f'5 1 3 0 0 {half} 0 {half}'), 1, axes='lens')(0, 5 * SECOND)
    kitti = read_pose_file(file(RIGHT), 1)(0, 0)
    assert turned.position == pytest.approx(kitti.position)
    assert turned.orientation == pytest.approx(kitti.orientation)
    # In a world whose z points up, a lens that looks along x.
    level = read_pose_file(file('5 1 3 2 -0.5 0.5 -0.5 0.5'), 1, axes='lens')(0, 5 * SECOND)
    assert level.position == pytest.approx((1, 3, 2))
    assert level.orientation == pytest.approx((0, 0, 0, 1))


def test_poses_that_move_as_those_of_a_lens_are_refused_unless_somebody_says_so(file):
    path = file(*(f'{at} 0 0 {at} 0 0 0 1' for at in range(8)))
    with pytest.raises(SourceError, match=r'own z \(7 of 7 m\).*--pose-axes lens converts them'):
        read_pose_file(path, 8)
    ways = [read_pose_file(path, 8, axes=axes)(0, 5 * SECOND) for axes in ('robot', 'lens')]
    assert [way.position for way in ways] == [(0, 0, 5), pytest.approx((5, 0, 0))]


PAGE = Path(__file__).resolve().parents[2] / 'docs' / 'howto' / 'satellite_fixes.md'


def test_the_page_makes_poses_of_fixes(tmp_path):
    # A minute of arc near the equator is 1855.32 m eastwards and 1842.90 m northwards (WGS 84).
    minute = 1 / 60
    fixes = (0, 0.0, 0.0, 5), (100, 0.0, minute, 5), (200, minute, minute, 7)
    lines = [','.join(map(str, line)) for line in fixes]
    (tmp_path / 'fixes.csv').write_text('\n'.join(lines))
    (script,) = re.findall(r'```python\n(.*?)```', PAGE.read_text(), re.DOTALL)
    done = run(sys.executable, '-c', script, cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    pose_at = read_pose_file(tmp_path / 'poses.txt', 3)
    east, north = (pose_at(0, stamp_s * SECOND) for stamp_s in (100, 199))
    assert east.position == pytest.approx((1855.32, 0.0, 5.0), abs=0.1)
    assert north.position == pytest.approx((1855.32, 0.99 * 1842.90, 6.98), abs=0.1)
    half = math.sqrt(0.5)
    assert north.orientation == pytest.approx((0, 0, half, half), abs=1e-6)
    assert pose_at(0, 50 * SECOND).orientation == pytest.approx((0, 0, 0, 1), abs=1e-6)
