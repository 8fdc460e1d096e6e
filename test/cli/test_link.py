# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""`convseq map link` and `unlink`: drives find each other and their own way, and part again."""

from dataclasses import replace
import json
import math

from convseq_ros.app.map_builder import MapBuilder
from convseq_ros.cli import main
from convseq_ros.cli.demo_slam import error_m
from convseq_ros.config import Config, EVERY_FRAME
from convseq_ros.core.map.format import MapSession
from convseq_ros.core.map.place import Place
from convseq_ros.core.map.reader import open_map
from convseq_ros.core.map.reference_map import ReferenceMap
from convseq_ros.core.rigid import matrix, of_roll_pitch_yaw, pose_of
from convseq_ros.core.types import RelativePose
from convseq_ros.pose_graph.edges import EDGE, Edge, link_edge
from convseq_ros.pose_graph.lines import g2o
from convseq_ros.pose_graph.optimisation import position_sigma_m
from convseq_ros.pose_graph.stored import solved
from convseq_ros.simulation.drive import Drive
from convseq_ros.simulation.odometry import Drift, with_odometry
from convseq_ros.simulation.route import Route
from convseq_ros.simulation.street import Street
from drives import shots_of
import numpy as np
import pytest

PLACES = 24
# What the second drive's odometry calls its origin.
AWAY = matrix(of_roll_pitch_yaw((80.0, -30.0, 0.0), 0.0, 0.0, 2.0))


@pytest.fixture(scope='module')
def driven(tmp_path_factory):
    """Return a map of two drives, each in the frame of its own odometry, and where it was."""
    path, truth = tmp_path_factory.mktemp('link') / 'two.db', []
    for number, light in enumerate(('day', 'evening')):
        drive = Drive(
            num_frames=PLACES, lane_offset_m=-1.5 + 0.5 * number, light=light, seed=number,
            start_m=0.4 * number, width_px=320, height_px=240, frame_rate_hz=7.0,
            start_ns=10**18 + number * 10**12,
        )  # fmt: skip
        config = Config(keyframes=EVERY_FRAME)
        with MapBuilder(path, config, number > 0, light) as builder:
            for shot in shots_of(Street(60.0, seed=5), drive):
                truth.append(np.array(shot.pose.position))
                pose = pose_of(AWAY @ matrix(shot.pose)) if number else shot.pose
                builder.process(replace(shot.frame, pose=pose, camera=drive.camera))
    return path, truth


def test_two_drives_are_linked_brought_together_and_drawn(driven, tmp_path, capsys):
    pytest.importorskip('gtsam')
    pytest.importorskip('matplotlib')
    path, truth = driven
    files = [tmp_path / name for name in ('graph.g2o', 'one.db', 'drives.png', 'tum.txt')]
    options = zip(('--g2o', '-o', '--picture', '--tum'), map(str, files), strict=True)
    asked = (one for pair in options for one in pair)
    assert main(['map', 'link', str(path), *asked, '--json']) == 0
    said = capsys.readouterr()
    assert 'its poses are known to 0.' in said.err
    assert 0 < open_map(files[1]).position_sigma_m < 1 and not open_map(path).position_sigma_m
    links = json.loads(said.out)
    assert PLACES >= len(links) >= 0.75 * PLACES
    for link in links:
        assert math.dist(truth[link['place']], truth[link['other']]) < 3.0
        assert link['session'] != link['other_session']
        assert 0.9 <= link['confidence'] <= 1 and link['inliers'] > 0
        if link['position_m']:
            assert (np.linalg.eigvalsh(link['covariance']) > 0).all()
    opened = open_map(files[1])
    frames = {session.frame for session in opened.sessions}
    assert len(frames) == 1 and None not in frames
    off_m = map(math.dist, (one.pose.position for one in opened.places), truth)
    assert len(opened) == len(truth) and max(off_m) < 0.5
    lines = files[0].read_text().splitlines()
    assert sum(line.startswith('VERTEX_SE3:QUAT') for line in lines) == 2 * PLACES
    measured = sum(link['position_m'] is not None for link in links)
    assert sum(line.startswith('EDGE') for line in lines) == 2 * (PLACES - 1) + measured
    assert files[2].stat().st_size > 10_000
    rows = [line.split() for line in files[3].read_text().splitlines()[1:]]
    stamps = sorted(place.stamp_ns for place in opened.places)
    assert [int(row[0].replace('.', '')) for row in rows] == stamps


def made(count, wrong=0, unmeasured=(), without_pose=()):
    """Return a map of two drives along x, the second's odometry elsewhere; `wrong` of 3 links."""
    whole, cells = ReferenceMap(), np.ones((32, 32, 8), np.float16)
    for number in range(2):
        whole.sessions.append(MapSession(f'{number}', '', 0))
        for index in range(count):
            pose = of_roll_pitch_yaw((float(index), float(number), 0.0), 0.0, 0.0, 0.0)
            pose = pose_of(AWAY @ matrix(pose)) if number else pose
            kept = None if len(whole) in without_pose else pose
            whole.add(Place(index, pose=kept, session=number), cells)
    noise = np.diag([0.01] * 3 + [1e-4] * 3)
    for at in range(count):
        position_m = None if at in unmeasured else (9.0 * (at % 3 < wrong), 1.0, 0.0)
        relative = RelativePose((0.0, 0.0, 0.0, 1.0), position_m, None, noise, 9)
        whole.links.add(count + at, at, 1.0, 100, relative)
    return whole


@pytest.mark.parametrize('wrong', [0, 1])
def test_most_links_decide_where_a_session_lies(wrong):
    pytest.importorskip('gtsam')
    found = solved(made(20, wrong)).places
    for at in range(20):
        assert np.allclose(found[at][:3, 3], (at, 0.0, 0.0), atol=0.05)
        assert np.allclose(found[20 + at][:3, 3], (at, 1.0, 0.0), atol=0.05)


def test_the_graph_that_gtsam_reads_is_the_one_that_is_solved(tmp_path):
    gtsam = pytest.importorskip('gtsam')
    root = np.random.default_rng(0).random((6, 6))
    there = matrix(of_roll_pitch_yaw((1.0, 2.0, 0.3), 0.2, 0.3, 1.5))
    covariance = root @ root.T + np.eye(6)  # in the axes of the earlier place
    edges = [link_edge(0, 1, there, covariance)]
    path = tmp_path / 'graph.g2o'
    path.write_text(''.join(f'{line}\n' for line in g2o({0: np.eye(4), 1: there}, edges)))
    factor = gtsam.readG2o(str(path), True)[0].at(0)
    read = factor.noiseModel().covariance()
    # GTSAM has turns first, and all in the axes of the later place.
    turn = np.kron(np.eye(2), there[:3, :3].T)
    floor = np.diag([EDGE.finest_rad**2] * 3 + [EDGE.finest_m**2] * 3)
    expected = np.roll(turn @ covariance @ turn.T, (3, 3), (0, 1)) + floor
    assert np.allclose(read, expected, rtol=1e-4)
    assert np.allclose(factor.measured().matrix(), there)


def test_poses_are_known_as_well_as_odometry_and_a_link_know_them():
    pytest.importorskip('gtsam')
    there, turn = matrix(of_roll_pitch_yaw((10.0, 0.0, 0.0), 0, 0, 0)), [1e-4] * 3
    poses = {1: np.eye(4), 2: there}
    step = Edge(1, 2, there, np.diag([0.25] * 3 + turn), False)
    link = link_edge(1, 2, there, np.diag([0.03] * 3 + turn))
    # The first pose is known, the second one by odometry, or by it and the link.
    assert position_sigma_m(poses, [step]) == pytest.approx(math.sqrt(0.25 / 2), rel=1e-3)
    both = 1 / (1 / 0.25 + 1 / (0.03 + EDGE.finest_m**2))
    assert position_sigma_m(poses, [step, link]) == pytest.approx(math.sqrt(both / 2), rel=1e-3)


def test_odometry_edges_bridge_removed_keyframes_and_links_without_metres_are_left_out():
    pytest.importorskip('gtsam')
    graph = solved(made(5, unmeasured=(0, 3, 4), without_pose=(2,)))
    # Vertices are counted from 1 on; the third place has none.
    steps = [(edge.start, edge.end) for edge in graph.edges if not edge.is_link]
    assert steps == [(1, 2), (2, 3), (3, 4), *((at, at + 1) for at in range(5, 9))]
    assert [(edge.start, edge.end) for edge in graph.edges if edge.is_link] == [(2, 6)]
    assert graph.stamps_ns == dict(enumerate([0, 1, 3, 4, 0, 1, 2, 3, 4], 1))
    assert [*graph.places] == [0, 1, 3, 4, 5, 6, 7, 8, 9]


@pytest.fixture(scope='module')
def circled(tmp_path_factory):
    """Return a map of two rounds of a block, one drive whose odometry drifts, and the truth."""
    path = tmp_path_factory.mktemp('circled') / 'map.db'
    corners = ((10.0, 0.0), (60.0, 0.0), (60.0, 40.0), (0.0, 40.0), (0.0, 0.0), (10.0, 0.0))
    route = Route((*corners[:-1], *corners[1:]), 3)
    how = {'num_frames': 180, 'frame_rate_hz': 2.0, 'width_px': 240, 'height_px': 180}
    drive = Drive(speed_mps=route.length_m / 90, **how)
    shots = shots_of(route, drive)
    truth = [shot.pose.position for shot in shots]
    drift = Drift(scale=0.02, yaw_bias_deg=4.0, seed=2)
    with MapBuilder(path, Config(keyframes=EVERY_FRAME), links=False) as builder:
        for shot in with_odometry(shots, drift):
            builder.process(replace(shot.frame, pose=shot.odometry, camera=drive.camera))
    return path, np.array(truth)


def _off_m(path, truth):
    """Return the error of a map's trajectory, in metres."""
    own = {at: place.pose.position for at, place in enumerate(open_map(path).places)}
    return error_m(own, dict(enumerate(truth)))


def test_a_drive_that_crosses_its_path_is_linked_once_and_improves(circled, tmp_path, capsys):
    gtsam = pytest.importorskip('gtsam')
    path, truth = circled
    graph, better = tmp_path / 'graph.g2o', tmp_path / 'better.db'
    asked = ['map', 'link', str(path), '--json', '--g2o', str(graph), '-o', str(better)]
    assert main(asked) == 0
    links = json.loads(capsys.readouterr().out)
    assert len(links) >= 0.8 * 90
    off_m = [math.dist(truth[one['place']], truth[one['other']]) for one in links]
    # One place of a drawn street looks like another; the poses improve all the same.
    assert sorted(off_m)[-2] < 5.0
    stored = {(one.place, one.other) for one in open_map(path).links.each()}
    assert stored == {(one['place'], one['other']) for one in links}
    assert _off_m(better, truth) < 0.5 * _off_m(path, truth)
    assert len(open_map(better).links) == len(links)
    # GTSAM's own reader, too, finds it there.
    factors, poses = gtsam.readG2o(str(graph), True)
    measured = sum(one['position_m'] is not None for one in links)
    assert measured > 0.8 * len(links)
    assert poses.size() == len(truth) and factors.size() == len(truth) - 1 + measured
    # What is there is not looked up again.
    kept = path.read_bytes()
    assert main(['map', 'link', str(path)]) == 0
    assert f'{len(links)} of 180 places linked' in capsys.readouterr().out
    assert path.read_bytes() == kept


def test_linking_without_poses_or_links_writes_nothing_and_gives_the_reason(tmp_path, capsys):
    pytest.importorskip('gtsam')
    path, better = tmp_path / 'map.db', tmp_path / 'better.db'
    with MapBuilder(path, Config(keyframes=EVERY_FRAME)) as builder:
        drive = Drive(num_frames=4, width_px=160, height_px=120)
        for shot in shots_of(Street(60.0, seed=5), drive):
            builder.process(replace(shot.frame, pose=None))
    assert main(['map', 'link', str(path), '-o', str(better)]) == 1
    assert 'no place was passed twice, so there is no link' in capsys.readouterr().err
    assert not better.exists()
