# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The pose graph of a map: a killed node goes on where it was."""

from dataclasses import replace

from convseq_ros.config.pose_graph_config import PoseGraphConfig
from convseq_ros.core.graph.trail import Keyframe
from convseq_ros.core.map.place import Place
from convseq_ros.core.map.reference_map import ReferenceMap
from convseq_ros.core.rigid import inverse, Matrix, pose_of
from convseq_ros.core.types import Pose
from convseq_ros.pose_graph import solver
from convseq_ros.pose_graph.graph import PoseGraph
from convseq_ros.pose_graph.output import whole
from convseq_ros.pose_graph.stored import graph_of, solved
import numpy as np
import pytest
from squares import (
    add_drive,
    closure,
    DRIFTED,
    driven,
    LAP,
    pose,
    relative,
    RIGHT,
    SECOND,
    stamp,
    TRUE,
)

pytest.importorskip('gtsam', reason='needs gtsam: pip install gtsam')

CONFIG = PoseGraphConfig(graph_spacing_m=0.9)
NEXT_DAY = 86_400 * SECOND


def right(last: int) -> list[tuple[int, int, Matrix]]:
    return [(LAP + at, at, inverse(TRUE[at]) @ TRUE[LAP + at]) for at in range(1, last, 5)]


@pytest.fixture
def stored() -> ReferenceMap:
    """Return a map of one drive of two laps, without its last 20 poses."""
    made = ReferenceMap()
    add_drive(made, DRIFTED[:-20], right(LAP - 20))
    return made


def test_a_graph_from_the_map_goes_on_where_the_killed_one_was(stored):
    killed = driven(DRIFTED[:-20], PoseGraph(CONFIG))
    for one in RIGHT[:-4]:
        killed.add_closure(one)
    while problem := killed.problem():
        killed.adopt(problem, problem.solve())
    graph = graph_of(stored, CONFIG)
    assert graph.correction is None  # until odometry tells that the drive goes on
    driven(DRIFTED[-18:-16], graph, len(DRIFTED) - 18)
    assert np.allclose(graph.correction, killed.correction, atol=1e-3)
    assert graph.counts['kept'] == killed.counts['kept'] == 12
    assert not graph.earlier and graph.running.hints == [len(DRIFTED) - 19]
    # A closure with a place of before the kill counts.
    driven(DRIFTED[-16:], graph, len(DRIFTED) - 16)
    graph.add_closure(late := closure(LAP + 71, 71))
    graph.adopt(problem := graph.problem(), problem.solve())
    assert graph.known[late.key].kept


def test_odometry_of_the_map_is_believed_as_its_variances_say():
    made = ReferenceMap()
    made.begin_session(stamp(0))
    for step in range(6):
        at = replace(pose_of(TRUE[step]), variances=(4.0 * step, 0.01 * step))
        made.trail.add(Keyframe(made.sessions[0].id, stamp(step), at))
    assert graph_of(made, CONFIG).running.spread[-1] == pytest.approx((20.0, 0.05))


def test_odometry_that_began_anew_or_comes_late_is_another_drive(stored):
    end = len(DRIFTED) - 20
    for poses, after_ns in ((DRIFTED, NEXT_DAY), (DRIFTED[60:], stamp(end) - stamp(0))):
        graph = graph_of(stored, CONFIG)
        graph.add_odometry(SECOND + after_ns, poses[0])
        assert len(graph.earlier) == 1 and graph.correction is None
        assert len(graph.running.keyframes) == 1 and graph.counts['clock_jumps'] == 0


@pytest.mark.parametrize(
    ('passed_s', 'further_m', 'goes_on'),
    # It drove 5.15 m/s: twice that, and a metre.
    [(2.0, 21.0, True), (2.0, 22.5, False), (29.9, 0.0, True), (30.1, 0.0, False)],
)
def test_a_drive_goes_on_for_half_a_minute_at_twice_its_speed(
    stored, passed_s, further_m, goes_on
):
    graph, last = graph_of(stored, CONFIG), len(DRIFTED) - 21
    graph.add_odometry(stamp(last) + int(passed_s * SECOND), DRIFTED[last] @ pose(further_m))
    assert bool(graph.earlier) is not goes_on
    assert (graph.correction is not None) is goes_on


def test_odometry_of_the_time_that_the_map_has_already_changes_nothing(stored):
    graph = graph_of(stored, CONFIG)
    graph.add_odometry(stamp(len(DRIFTED) - 23), DRIFTED[-23])
    assert graph.correction is None and not graph.earlier
    driven(DRIFTED[-20:-19], graph, len(DRIFTED) - 20)
    assert graph.correction is not None


def test_another_day_finds_the_map_when_two_closures_agree(stored):
    graph, there = graph_of(stored, CONFIG), pose(30.0, 60.0, 1.0)
    earlier, name = graph.running, stored.sessions[0].id
    for step, at in enumerate(DRIFTED[:18]):
        graph.add_odometry(stamp(step) + NEXT_DAY, there @ at)
    for count, step in enumerate((5, 15), 1):
        one = closure(step, step, np.eye(4), session=name)
        graph.add_closure(replace(one, query_ns=one.query_ns + NEXT_DAY))
        graph.adopt(problem := graph.problem(), problem.solve())
        assert (graph.correction is not None) is (count == 2)
    end = graph.correction @ there @ DRIFTED[17]
    assert np.allclose(end, graph.corrected(earlier)[17], atol=0.3)


def test_two_sessions_of_a_map_that_went_on_are_one_drive(stored):
    """The recogniser alone was killed; its next session goes on."""
    second = add_drive(stored, DRIFTED[-16:], right(LAP)[-3:], len(DRIFTED) - 16)
    graph = graph_of(stored, CONFIG)
    assert graph.running.sessions == {stored.sessions[0].id, second} and not graph.earlier
    assert graph.counts['kept'] == 15 and len(graph.running.keyframes) == len(DRIFTED) - 4


def test_drives_of_several_days_are_in_one_frame(stored):
    there = pose(30.0, 60.0, 1.0)
    ends = [(step, step, np.eye(4)) for step in (5, 15, 25, 35)]
    add_drive(stored, [there @ at for at in DRIFTED[:37]], ends, after_ns=NEXT_DAY)
    graph = graph_of(stored, CONFIG)
    first, second = graph.drives
    assert np.allclose(graph.corrected(second), graph.corrected(first)[:37], atol=0.3)
    graph.add_odometry(stamp(37) + NEXT_DAY, there @ DRIFTED[37])
    end = graph.correction @ there @ DRIFTED[37]
    assert np.allclose(end, graph.corrected(first)[37], atol=0.3)


def test_a_map_of_several_days_is_solved_as_a_whole_once(stored, monkeypatch):
    """All days at each would take the square of the time."""
    for day in (1, 2):
        ends = [(step, step, np.eye(4)) for step in (5, 15, 25, 35)]
        add_drive(stored, [pose(30.0) @ at for at in DRIFTED[:37]], ends, after_ns=day * NEXT_DAY)
    sizes, solve = [], solver.optimise
    monkeypatch.setattr(
        solver,
        'optimise',
        lambda edges, start, held: sizes.append(len(start)) or solve(edges, start, held),
    )
    graph = graph_of(stored, CONFIG)
    first, own = len(DRIFTED) - 20, 37
    # The origin of the map, the keyframes of a day, and the places of its closures.
    assert sizes == [1 + first, own + 4, own + 4, 1 + first + 2 * own]
    assert graph.counts['kept'] == 12 + 8 and not graph.problem()


def place(made: ReferenceMap, stamp_ns: int, at: Pose | None = None) -> int:
    cells = np.zeros(made.cell_shape, np.float16)
    made.add(Place(stamp_ns, '', at, len(made.sessions) - 1), cells)
    return len(made) - 1


def test_a_link_that_a_person_took_out_is_no_closure_and_one_that_was_found_later_is():
    made = ReferenceMap()
    made.begin_session(0)
    stamps = [*map(stamp, (1, 11, LAP + 1, LAP + 11))]
    first, other, unlinked, linked = (place(made, stamp_ns) for stamp_ns in stamps)
    made.links.add(linked, other, relative=relative(inverse(TRUE[11]) @ TRUE[LAP + 11]))
    made.links.add_unlinked(unlinked)
    made.sessions.clear()
    add_drive(made, DRIFTED, right(3))
    graph = graph_of(made, CONFIG)
    assert [key[2] * 1000 for key in graph.known] == [stamp(11)]
    assert graph.counts['kept'] == 1 and first == 0


def test_a_link_that_was_held_back_is_a_closure_of_map_link_and_not_of_the_node():
    made, moved = ReferenceMap(), inverse(TRUE[11]) @ TRUE[LAP + 11]
    made.begin_session(0)
    first, other = (place(made, stamp(at)) for at in (11, LAP + 11))
    made.links.add(other, first, relative=relative(moved))
    made.sessions.clear()
    add_drive(made, DRIFTED, [(LAP + 11, None, moved)])
    assert not graph_of(made, CONFIG).known
    assert sum(edge.is_link for edge in solved(made).edges) == 1


def test_a_drive_with_poses_of_a_file_is_where_they_are():
    made, there = ReferenceMap(), pose(200.0, -50.0, 2.0)
    made.begin_session(0)
    for step in range(40):
        place(made, stamp(step), pose_of(there @ TRUE[step]))
    ends = [(step, step, np.eye(4)) for step in (5, 15)]
    add_drive(made, TRUE[:20], ends, after_ns=NEXT_DAY)
    graph = graph_of(made, CONFIG)
    graph.add_odometry(stamp(20) + NEXT_DAY, TRUE[20])
    assert np.allclose(graph.correction, there, atol=1e-3)
    # Nothing is told before anything agrees.
    empty = graph_of(_without_trail(made), CONFIG)
    empty.add_odometry(stamp(0) + 2 * NEXT_DAY, DRIFTED[0])
    assert empty.correction is None


def test_the_solved_map_is_the_graph_of_the_node_and_has_the_poses_of_places():
    made = ReferenceMap()
    for step in range(3, len(DRIFTED), 7):
        made.sessions or made.begin_session(stamp(0))
        place(made, stamp(step), pose_of(DRIFTED[step]))
    made.sessions.clear()
    add_drive(made, DRIFTED, right(LAP))
    made.begin_session(NEXT_DAY)  # never meets the first
    alone = place(made, stamp(0) + NEXT_DAY, pose_of(TRUE[0]))
    for at in (0, 1):
        elsewhere = replace(pose_of(TRUE[at]), variances=(0.0, 0.0))
        made.trail.add(Keyframe(made.sessions[1].id, stamp(at) + NEXT_DAY, elsewhere))
    found = solved(made)
    vertices, edges, stamps_ns = whole(graph_of(made, PoseGraphConfig()))
    assert found.vertices.keys() == vertices.keys() and found.stamps_ns == stamps_ns
    assert len(found.edges) == len(edges)
    assert all(np.allclose(found.vertices[at], vertices[at], atol=1e-6) for at in vertices)
    assert [*found.places] == [*range(alone)]
    for at, step in enumerate(range(3, len(DRIFTED), 7)):  # by odometry since the vertex before
        vertex = max(one for one, time in stamps_ns.items() if time <= stamp(step))
        since = inverse(DRIFTED[(stamps_ns[vertex] - stamp(0)) * 5 // SECOND]) @ DRIFTED[step]
        assert np.allclose(found.places[at], vertices[vertex] @ since, atol=1e-6)


def _without_trail(made: ReferenceMap) -> ReferenceMap:
    return ReferenceMap(made.encoding, made.places, sessions=made.sessions)
