# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The pose graph corrects a drifting path, and believes no false closure."""

import math

import numpy as np
import pytest

pytest.importorskip('gtsam', reason='needs gtsam: pip install gtsam')

from comparison import absolute_error_m, aligned, compare, error_m, rmse_m, Trial
from graph import Closure, Noise, Odometry, optimise, Pose, read_record, write_record
import gtsam
from incremental import Incremental

SECOND = 1_000_000_000
COUNTS = (0, 1, 3, 6, 12)


def square(side=10, laps=1, turn=math.pi / 2, length=1.0):
    """Return odometry of a square, and the truth, a pose a second, side steps a side."""
    odometry, truth = Odometry(0.5), {}
    x = y = yaw = true_yaw = 0.0
    true_x = true_y = 0.0
    stamp_ns = 0
    for step in range(4 * side * laps + 1):
        odometry.add(stamp_ns, Pose(x, y, yaw))
        truth[stamp_ns] = (true_x, true_y)
        x, y = x + length * math.cos(yaw), y + length * math.sin(yaw)
        true_x, true_y = true_x + math.cos(true_yaw), true_y + math.sin(true_yaw)
        if step % side == side - 1:
            yaw, true_yaw = yaw + turn, true_yaw + math.pi / 2
        stamp_ns += SECOND
    return odometry, truth


@pytest.mark.parametrize('robust', [False, True])
def test_one_closure_shares_out_the_drift_of_a_line(robust):
    odometry = Odometry(0.5)
    for second in range(11):
        odometry.add(second * SECOND, Pose(0.1 * second, 0.0, 0.0))
    noise = Noise(odometry_m=0.3, closure_m=0.3, closure_rad=0.1)
    solution = optimise(odometry, [Closure(10 * SECOND, 0)], noise, robust)
    steps = np.diff(solution.before[:, 0])
    assert len(odometry) == 3 and steps == pytest.approx([0.5, 0.5])
    # Three equally stiff springs in a line: two say 0.5 m apart, one says 0 m from end to end.
    stiffness = 1 / (0.3**2 * 0.5), 1 / 0.3**2
    end = stiffness[0] / 2 * 1.0 / (stiffness[0] / 2 + stiffness[1])
    assert solution.after[-1, 0] == pytest.approx(end, abs=1e-4)
    assert solution.after[1, 0] == pytest.approx(end / 2, abs=1e-4)


def test_closures_bring_a_drifting_square_back():
    odometry, truth = square(side=20, laps=2, turn=math.pi / 2 + 0.08, length=1.03)
    closures = [Closure((80 + at) * SECOND, at * SECOND) for at in range(0, 80, 5)]
    solution = optimise(odometry, closures)
    assert all(solution.kept)
    assert error_m(solution, truth, before=True) > 2.0
    assert error_m(solution, truth) < 0.4 * error_m(solution, truth, before=True)


def test_isam2_is_where_the_batch_is_and_tells_the_correction():
    odometry, _ = square(side=20, laps=2, turn=math.pi / 2 + 0.08, length=1.03)
    closures = [Closure((80 + at) * SECOND, at * SECOND) for at in range(0, 80, 5)]
    batch, graph, growing = optimise(odometry, closures), Incremental(), Odometry(0.5)
    for stamp_ns, pose in odometry.measured:
        growing.add(stamp_ns, pose)
        graph.update(growing, [one for one in closures if one.query_ns <= stamp_ns])
    assert np.abs(graph.path - batch.after).max() < 5e-3
    # What map -> odom would be brings the odometry's end where the path ends.
    end = gtsam.Pose2(*graph.correction).compose(gtsam.Pose2(*odometry.keyframes[-1]))
    assert (end.x(), end.y(), end.theta()) == pytest.approx(tuple(batch.after[-1]), abs=5e-3)
    # A closure that is no longer believed is taken back.
    graph.update(odometry, closures[:4])
    few = optimise(odometry, closures[:4], robust=False)
    assert np.abs(graph.path - few.after).max() < 0.05
    graph.update(odometry, [])
    assert np.abs(graph.path[:, :2] - few.before[:, :2]).max() < 1e-6


def test_a_measured_closure_says_more_than_the_same_place():
    odometry, truth = square(side=20, laps=2, turn=math.pi / 2 + 0.08, length=1.03)
    covariance = tuple(np.diag([0.01, 0.01, 1e-4]).ravel())
    # Every second time it passes 2 m to the left of where it was.
    aside = [Pose(0.0, 2.0 * (at % 2), 0.0) for at in range(16)]
    pairs = [((80 + 5 * at) * SECOND, 5 * at * SECOND) for at in range(16)]
    measured = [
        Closure(*pair, None, pose, covariance) for pair, pose in zip(pairs, aside, strict=True)
    ]
    told = optimise(odometry, measured, robust=False).after
    apart = []
    for query_ns, reference_ns in pairs:
        ends = [gtsam.Pose2(*told[odometry.place(at)[0]]) for at in (reference_ns, query_ns)]
        apart.append(ends[0].between(ends[1]).y())
    assert np.mean(apart[1::2]) - np.mean(apart[::2]) > 0.5
    assert error_m(optimise(odometry, [Closure(*pair) for pair in pairs]), truth) < 0.5


def test_a_false_closure_is_rejected_and_would_have_cost_a_lot():
    odometry, truth = square(side=20, laps=2, turn=math.pi / 2 + 0.03)
    right = [Closure((80 + at) * SECOND, at * SECOND) for at in range(0, 80, 5)]
    false = [Closure(120 * SECOND, 10 * SECOND)]
    robust, plain = (optimise(odometry, right + false, robust=way) for way in (True, False))
    alone = optimise(odometry, right)
    assert robust.kept == (*[True] * len(right), False)
    assert error_m(robust, truth) == pytest.approx(error_m(alone, truth), abs=0.01)
    assert plain.kept[-1]
    assert error_m(plain, truth) > 2 * error_m(robust, truth)


@pytest.mark.parametrize(
    'closure',
    [Closure(900 * SECOND, 0), Closure(5 * SECOND, -SECOND), Closure(5 * SECOND, 5 * SECOND)],
)
def test_a_closure_outside_the_odometry_is_left_out(closure):
    odometry, _ = square()
    solution = optimise(odometry, [closure, Closure(40 * SECOND, 0)])
    assert solution.kept == (False, True)


def test_a_record_tells_all_that_the_graph_was_told(tmp_path):
    odometry, _ = square()
    closures = [Closure(40 * SECOND, 0), Closure(39 * SECOND, SECOND, 0.1)]
    write_record(tmp_path / 'graph.json', odometry, closures, [True, False])
    assert read_record(tmp_path / 'graph.json') == (odometry.measured, closures, [True, False])
    assert [path.name for path in tmp_path.iterdir()] == ['graph.json']


def test_alignment_undoes_a_turn_and_a_shift_but_no_mirror():
    rng = np.random.default_rng(1)
    truth = rng.uniform(0, 50, (30, 2))
    cos, sin = math.cos(2.0), math.sin(2.0)
    moved = truth @ np.array(((cos, sin), (-sin, cos))) + (7.0, -3.0)
    assert aligned(moved, truth) == pytest.approx(truth)
    assert absolute_error_m(moved, truth) < 1e-9
    assert absolute_error_m(truth * (1, -1), truth) > 5
    assert rmse_m(truth + np.array((3, 4)), truth) == pytest.approx(5.0)


def test_the_comparison_counts_what_each_way_keeps():
    odometry, truth = square(side=25, laps=2, turn=math.pi / 2 + 0.02)
    right = [Closure((100 + at) * SECOND, at * SECOND) for at in range(0, 100, 5)]
    trials = {(t.false, t.robust): t for t in compare(odometry, right, truth, (0, 3), 2)}
    assert trials[3, False].false_kept == (3, 3)
    assert trials[3, True].false_kept == (0, 0)
    assert trials[3, True].right_kept == (len(right), len(right))
    assert len(trials[0, True].errors_m) == 1 and len(trials[3, True].errors_m) == 2
    assert trials[3, True].median_m < trials[3, False].median_m


def test_the_picture_leaves_out_a_closure_outside_the_odometry(tmp_path):
    pytest.importorskip('matplotlib')
    from picture import draw_picture

    odometry, truth = square()
    closures = [Closure(40 * SECOND, 0), Closure(39 * SECOND, -SECOND)]
    trials = [Trial(count, way, (1.0,), (1,), (0,)) for count in COUNTS for way in (False, True)]
    path = tmp_path / 'a.png'
    draw_picture(path, odometry, optimise(odometry, closures), closures, truth, trials, '')
    assert path.stat().st_size > 5000
