# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The growing pose graph: drift goes, false closures are refused, bad input is survived."""

from dataclasses import replace
import math

from convseq_ros.config.pose_graph_config import PoseGraphConfig
from convseq_ros.core.rigid import inverse
from convseq_ros.core.types import UNKNOWN_M2
from convseq_ros.pose_graph.closures import Closure
from convseq_ros.pose_graph.edges import EDGE
from convseq_ros.pose_graph.graph import PoseGraph
from convseq_ros.pose_graph.output import trajectory
import numpy as np
import pytest
from squares import closure, DRIFTED, driven, LAP, MEASURED, pose, RIGHT, SECOND, stamp, TRUE

pytest.importorskip('gtsam', reason='needs gtsam: pip install gtsam')

SAME_PLACE = np.diag([UNKNOWN_M2] * 3 + [0.02] * 3)
FALSE = [closure(120, 12, np.eye(4)), closure(135, 24, np.eye(4)), closure(150, 100, np.eye(4))]


def solve(graph: PoseGraph, *closures: Closure) -> list[bool | None]:
    """Add closures and solve; return which are kept."""
    for one in closures:
        graph.add_closure(one)
    if problem := graph.problem():
        graph.adopt(problem, problem.solve())
    return [graph.known[one.key].kept for one in closures]


def error_m(graph: PoseGraph) -> float:
    positions = graph.corrected(graph.running)[:, :3, 3]
    return float(np.abs(positions - np.array(TRUE)[:, :3, 3]).max())


def test_closures_take_the_drift_out_and_false_ones_are_refused():
    graph = driven(DRIFTED)
    assert error_m(graph) > 5
    kept = solve(graph, *FALSE, *RIGHT)
    assert kept == [False] * 3 + [True] * len(RIGHT)
    assert all(graph.known[one.key].apart_m > 5 for one in FALSE)
    with_false = error_m(graph)
    alone = driven(DRIFTED)
    solve(alone, *RIGHT)
    assert with_false == pytest.approx(error_m(alone), abs=0.02)
    # The second lap lies on the first one, which drifts as far as odometry says it may.
    positions = graph.corrected(graph.running)[:, :3, 3]
    assert np.linalg.norm(positions[LAP + 1 :] - positions[1 : LAP + 1], axis=1).max() < 0.5
    assert graph.counts['refused'] == 3 and graph.counts['kept'] == len(RIGHT)


def test_a_kept_closure_is_refused_when_later_ones_contradict_it():
    """Alone, a false closure is possible; those that contradict it come later."""
    config = PoseGraphConfig(graph_spacing_m=0.9, odometry_sigma_rad=0.05)
    graph = driven(DRIFTED, PoseGraph(config))
    near = closure(LAP + 3, 3, pose(4.0, 3.0))
    assert solve(graph, near) == [True]
    solve(graph, *RIGHT)
    assert graph.known[near.key].kept is False


@pytest.mark.parametrize('far_m', [1e5, 1e8])
def test_a_closure_beyond_all_that_odometry_may_err_spoils_no_right_one(far_m):
    graph = driven(DRIFTED)
    kept = solve(graph, RIGHT[0], closure(LAP + 3, 3, pose(far_m)), *RIGHT[1:5])
    assert kept == [True, False, True, True, True, True]
    assert all(solve(graph, *RIGHT[5:]))


def test_the_correction_moves_the_newest_odometry_to_the_end_of_the_path():
    graph = driven(DRIFTED)
    assert np.allclose(graph.correction, np.eye(4))
    solve(graph, *RIGHT)
    end = graph.corrected(graph.running)[-1]
    assert np.allclose(graph.correction @ DRIFTED[-1], end)
    # New keyframes extend the path without being solved.
    graph.add_odometry(stamp(len(TRUE)), DRIFTED[-1] @ pose(1.0))
    assert np.allclose(graph.corrected(graph.running)[-1], end @ pose(1.0))


def test_keyframes_between_nodes_are_corrected_by_interpolation(monkeypatch):
    from convseq_ros.pose_graph import graph as module

    exact = driven(DRIFTED)
    solve(exact, *RIGHT)
    few = type('Few', (), {**{name: getattr(module.LIVE, name) for name in OTHERS}, 'fine': 0})
    monkeypatch.setattr(module, 'LIVE', few)
    coarse = driven(DRIFTED)
    solve(coarse, *RIGHT)
    assert len(exact.poses()) - 1 == len(DRIFTED) > 3 * len(coarse.poses())
    positions = (graph.corrected(graph.running)[:, :3, 3] for graph in (coarse, exact))
    assert np.abs(np.subtract(*positions)).max() < 0.2


OTHERS = 'every', 'agreeing', 'loose', 'patience_ns', 'most_waiting'


def test_without_a_position_both_visits_are_near_each_other():
    graph = driven(DRIFTED)
    steps = range(1, LAP, 5)
    kept = solve(
        graph, *(Closure(stamp(LAP + at), stamp(at), np.eye(4), SAME_PLACE) for at in steps)
    )
    assert all(kept)
    positions = graph.corrected(graph.running)[:, :3, 3]
    assert np.linalg.norm(positions[LAP + 1 :] - positions[1 : LAP + 1], axis=1).max() < 2.0


def test_odometry_with_a_growing_covariance_is_believed_accordingly():
    """One closure contradicts odometry by a metre: the more certain one wins."""
    ends = []
    for variance in (1e-4, 1e2):
        graph = PoseGraph(PoseGraphConfig())
        for step in range(11):
            told = variance * (1 + step), variance * (1 + step)
            graph.add_odometry(stamp(step), pose(2.0 * step), told)
        solve(graph, Closure(stamp(10), stamp(0), pose(21.0), MEASURED))
        ends.append(graph.corrected(graph.running)[-1, 0, 3])
    assert ends[0] < 20.15 and ends[1] > 20.9


@pytest.mark.parametrize('growth', [1e-20, 1e-9, 1e15, math.inf, math.nan])
def test_a_covariance_of_odometry_that_is_absurd_refuses_no_closure(growth):
    """No odometry is better than 1 cm and 0.3 degrees after a metre, nor worse than a reset."""
    graph = PoseGraph(PoseGraphConfig(graph_spacing_m=0.9))
    for step, at in enumerate(DRIFTED):
        graph.add_odometry(stamp(step), at, (growth * step, growth * step))
    assert all(solve(graph, *RIGHT)) and not graph.counts['carried']
    assert error_m(graph) < 5


def test_odometry_is_believed_to_a_centimetre_after_a_metre_and_not_where_it_says_inf():
    config = PoseGraphConfig(graph_spacing_m=0.9)
    graph = PoseGraph(config)
    for step in range(11):
        told = math.inf if step == 5 else 1e-20 * step
        graph.add_odometry(stamp(step), pose(float(step)), (told, told))
    told_m2 = 8 * 0.01**2 + 2 * config.odometry_sigma_m**2
    told_rad2 = 8 * 0.005**2 + 2 * config.odometry_sigma_rad**2
    assert graph.running.spread[-1] == pytest.approx((told_m2, told_rad2))


# Bad input.


def test_the_graph_continues_at_the_robots_position_after_an_odometry_reset():
    graph = driven(DRIFTED[:100])
    driven([inverse(DRIFTED[100]) @ at for at in DRIFTED[100:]], graph, 100)  # begins at zero
    assert graph.running.resets == 1
    right = [one for one in RIGHT if one.query_ns > stamp(100)]
    assert all(solve(graph, *right))
    end = graph.correction @ inverse(DRIFTED[100]) @ DRIFTED[-1]
    assert np.linalg.norm((inverse(end) @ graph.corrected(graph.running)[-1])[:3, 3]) < 1e-6
    positions = graph.corrected(graph.running)[:, :3, 3]
    assert np.linalg.norm(positions[-10:] - positions[LAP - 9 : LAP + 1], axis=1).max() < 1.0


def test_a_gap_in_odometry_is_no_reset():
    graph = PoseGraph(PoseGraphConfig())
    driven(TRUE[60:100], driven(TRUE[:10], graph), 60)
    assert graph.running.resets == 0
    assert solve(graph, closure(95, 5)) == [True]


def test_closures_before_odometry_wait_for_it():
    graph = PoseGraph(PoseGraphConfig(graph_spacing_m=0.9))
    assert solve(graph, *RIGHT[:2]) == [None, None]
    driven(DRIFTED[: LAP + 4], graph)
    assert solve(graph) == [] and [graph.known[one.key].kept for one in RIGHT[:2]] == [True, None]
    driven(DRIFTED[LAP + 4 :], graph, LAP + 4)
    solve(graph)
    assert graph.known[RIGHT[1].key].kept
    assert graph.counts['waiting'] == 0


def test_the_same_closure_again_counts_once_and_a_measured_one_wins():
    graph = driven(DRIFTED)
    same = Closure(RIGHT[0].query_ns + 300, RIGHT[0].reference_ns, np.eye(4), SAME_PLACE)
    solve(graph, same, RIGHT[0], RIGHT[0], same)  # 300 ns are less than a float64 tells
    assert len(graph.known) == 1 and graph.twice == 3
    assert graph.known[RIGHT[0].key].closure is RIGHT[0]


@pytest.mark.parametrize(
    'absent',
    [
        closure(100, 10, session='another map'),
        Closure(stamp(100), -SECOND, np.eye(4), MEASURED),
        Closure(-SECOND, stamp(3), np.eye(4), MEASURED),
    ],
)
def test_a_closure_to_a_place_without_a_pose_is_counted(absent):
    graph = driven(DRIFTED)
    assert solve(graph, absent) == [False]
    assert graph.without_place == 1 and graph.counts['refused'] == 0
    assert graph.problem() is None


def test_closures_later_than_all_odometry_are_kept_up_to_a_number_and_said():
    graph = driven(DRIFTED)
    for step in range(1500):
        graph.add_closure(Closure(10**18 + 1000 * step, stamp(3), np.eye(4), MEASURED))
    assert graph.problem() is None
    assert len(graph.known) == 1000 and graph.without_place == 500
    assert graph.apart_ns == (10**18 + 1_499_000, stamp(len(DRIFTED) - 1))
    solve(graph, RIGHT[0])
    assert graph.counts['kept'] == 1 and graph.apart_ns is None


def test_of_a_long_path_every_nth_keyframe_is_told():
    graph = driven(DRIFTED)
    solve(graph, *RIGHT)
    whole, few = trajectory(graph), trajectory(graph, 60)
    assert [stamp_ns for stamp_ns, _ in few] == [stamp_ns for stamp_ns, _ in whole[1::3]]
    assert np.allclose([at for _, at in few], [at for _, at in whole[1::3]])
    assert few[-1][0] == whole[-1][0] and trajectory(PoseGraph(), 60) == []


def test_a_place_of_the_map_moves_the_drive_into_the_frame_of_the_map():
    graph, there = driven(DRIFTED[:30]), pose(200.0, -50.0, 2.0)
    for step in (22, 25, 28):
        graph.add_pose(stamp(step), there @ DRIFTED[step], MEASURED)
        graph.add_closure(closure(step, 3, session='earlier'))
    solve(graph)
    assert np.allclose(graph.correction, there, atol=0.2)


def test_a_match_in_a_map_that_is_told_as_a_pair_too_counts_once():
    graph, there = driven(DRIFTED[:30], PoseGraph(in_map=True)), pose(200.0, -50.0, 2.0)
    graph.add_pose(stamp(22), there @ DRIFTED[22], MEASURED)
    own = Closure(stamp(22), -SECOND, np.eye(4), SAME_PLACE)
    assert solve(graph, own, replace(own, session='earlier')) == [None, True]
    assert graph.counts['kept'] == 1 and graph.correction is None  # which takes two matches
    driven(DRIFTED[30:90], graph, first=30)  # until nothing waits
    assert graph.problem() is None and (graph.twice, graph.without_place) == (1, 0)


def out_and_back(graph: PoseGraph, length_m: int) -> PoseGraph:
    there = [pose(float(x)) for x in range(length_m + 1)]
    return driven([*there, *there[-2::-1]], graph)  # in reverse gear


def test_the_sigma_of_the_correction_grows_as_odometry_has_it():
    config = PoseGraphConfig(graph_spacing_m=0.9)
    variance, turn = config.odometry_sigma_m**2, config.odometry_sigma_rad**2
    straight = driven([pose(float(x)) for x in range(101)], PoseGraph(config))
    # A heading error moves the end aside by its distance from there: the integral of squares.
    assert straight.sigmas == pytest.approx(
        (math.sqrt(100 * variance + turn * 100**3 / 3), math.sqrt(100 * turn)), rel=0.02
    )
    returned = out_and_back(PoseGraph(config), 50)
    expected_m = math.sqrt(100 * variance + 2 * turn * 50**3 / 3)
    assert returned.sigmas[0] == pytest.approx(expected_m, rel=0.03)
    # Also between two keyframes.
    coarse = driven([pose(float(x)) for x in range(5)], PoseGraph(PoseGraphConfig()))
    coarse.add_odometry(stamp(5), pose(5.0))
    assert coarse.sigmas[1] == pytest.approx(math.sqrt(5 * turn))


def test_a_closure_makes_the_sigma_as_small_as_its_own_and_a_contradiction_as_large_as_it_is():
    config = PoseGraphConfig(graph_spacing_m=0.9)
    graph = out_and_back(PoseGraph(config), 50)
    solve(graph, closure(100, 0, np.eye(4)))
    own_m, own_rad = math.sqrt(0.01 + EDGE.finest_m**2), math.sqrt(1e-4 + EDGE.finest_rad**2)
    assert graph.sigmas == pytest.approx((own_m, own_rad), rel=0.1)
    assert graph.counts['map_to_odom_sigma_m'] == graph.sigmas[0]
    # It goes on 10 m, and the arm of the heading with it.
    driven([pose(-float(x)) for x in range(1, 11)], graph, 101)
    grown_m2 = own_m**2 + (10 * own_rad) ** 2
    grown_m2 += 10 * config.odometry_sigma_m**2 + config.odometry_sigma_rad**2 * 10**3 / 3
    assert graph.sigmas[0] == pytest.approx(math.sqrt(grown_m2), rel=0.1)
    assert solve(graph, closure(110, 5, pose(40.0, 0.0, 1.0))) == [False]
    assert graph.sigmas[0] == pytest.approx(55, rel=0.02)
    assert graph.sigmas[1] == pytest.approx(1.0, rel=0.02)


def test_the_sigma_of_a_drive_that_is_nowhere_yet_is_infinite():
    graph = driven(DRIFTED, PoseGraph(in_map=True))
    assert graph.sigmas == (math.inf, math.inf)


def test_a_clock_that_goes_back_begins_the_graph_anew():
    graph = driven(DRIFTED)
    solve(graph, *RIGHT)
    graph.add_odometry(stamp(40), DRIFTED[40])
    assert graph.counts['clock_jumps'] == 1
    assert len(graph.running.keyframes) == 1 and not graph.known
    assert np.allclose(graph.correction, np.eye(4))
    graph.add_odometry(stamp(40) - 1000, DRIFTED[39])  # late by a little: left out
    assert graph.counts['clock_jumps'] == 1


# A robot that was carried away.

CARRIED_AT, FURTHER = 60, 30  # step at which it is carried on by so many steps, unseen by odometry


def carried_away(is_online: bool, is_seen_lost: bool) -> list[tuple[bool, float, dict]]:
    """Return for each closure whether it is after the carrying, the error in m, and counts."""
    graph, there, found = driven([]), np.eye(4) if is_online else pose(200.0, -50.0, 2.0), []
    unseen = DRIFTED[CARRIED_AT - 1] @ inverse(DRIFTED[CARRIED_AT + FURTHER - 1])
    for step in range(110):
        is_after = step >= CARRIED_AT
        at = step + FURTHER * is_after
        if step == CARRIED_AT and is_seen_lost:
            graph.lose()
        graph.add_odometry(
            stamp(step), odometry := unseen @ DRIFTED[at] if is_after else DRIFTED[at]
        )
        true, before = there @ TRUE[at], at - LAP
        if step % 8 != 7 or (is_online and not is_after):
            continue
        if is_online:
            solve(graph, closure(step, before, inverse(TRUE[before]) @ TRUE[at]))
            true = graph.corrected(graph.running)[before] @ inverse(TRUE[before]) @ true
        else:
            graph.add_pose(stamp(step), true, MEASURED)
            solve(graph, closure(step, 3, session='earlier'))
        off_m = np.linalg.norm((graph.correction @ odometry - true)[:3, 3])
        found.append((is_after, float(off_m), graph.counts))
    return found


@pytest.mark.parametrize('is_seen_lost', [False, True])
@pytest.mark.parametrize('is_online', [False, True])
def test_closures_that_agree_and_contradict_odometry_say_that_the_robot_was_carried(
    is_online, is_seen_lost
):
    rows = carried_away(is_online, is_seen_lost)
    assert all(off_m < 0.5 and not counts['carried'] for after, off_m, counts in rows if not after)
    needed = 2 if is_seen_lost else 3
    for number, (_, off_m, counts) in enumerate((row for row in rows if row[0]), 1):
        if number < needed:
            assert off_m > 5 and counts['contradicting'] == number and not counts['carried']
        else:
            assert off_m < 0.5 and counts['contradicting'] == 0 and counts['carried'] == 1


def test_random_false_closures_do_not_agree_and_break_nothing():
    graph = driven(DRIFTED)
    solve(graph, *RIGHT[:8])
    for query, reference in ((135, 20), (138, 70), (141, 5)):
        assert solve(graph, closure(query, reference, np.eye(4))) == [False]
    assert graph.counts['contradicting'] == 3 and not graph.counts['carried']
    assert solve(graph, *RIGHT[-2:]) == [True, True]
    assert graph.counts['contradicting'] == 0


def test_a_break_by_false_closures_that_agree_is_undone_when_right_ones_come():
    graph = driven(DRIFTED)
    solve(graph, *RIGHT[:8])
    for at in (42, 45, 48):  # as in a street that looks like the one 15 m on
        solve(graph, closure(LAP + at, at - 15, np.eye(4)))
    assert graph.counts['carried'] == 1
    assert solve(graph, *RIGHT[-5:]) == [True] * 5
    assert graph.counts['carried'] == 0 and graph.counts['refused'] == 3
    positions = graph.corrected(graph.running)[:, :3, 3]
    assert np.linalg.norm(positions[LAP + 1 :] - positions[1 : LAP + 1], axis=1).max() < 0.5
