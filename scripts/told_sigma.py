# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Print how often map -> odom is within the standard deviations that are told with it.

Usage: python scripts/told_sigma.py [--seeds 0 1 2 3] [--odometries 5] [--roads FOLDER ...], some
five minutes a seed.

`graph` is pose_graph_node: it maps a drawn town while it drives through it (online), or drives on
another day in that map (preloaded). `node` is vpr_node with publish_tf, in that map with the poses
and the `position_sigma_m` that `convseq map link` puts into it. Closures are those of the
recogniser. Odometry drifts by three sizes, with a covariance that grows by its random errors
alone, or without one; the robot may be carried 320 m, or odometry begin anew. Each drive is
recognised once, with the town's odometry, and then driven with several odometries.
Roads are folders of KITTI's odometry with images/, poses.txt and calib.txt; every second image is
the map, and odometry is drawn.

An error is of the robot's pose in the frame of the map's first pose: position in metres, and
angle. Frames without a transform do not count.
"""

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import chain, product
import math
from pathlib import Path
import tempfile
from unittest.mock import Mock

from convseq_ros import build_map
from convseq_ros.app.pipeline import Pipeline
from convseq_ros.config import make_config
from convseq_ros.config.node_config import NodeConfig
from convseq_ros.config.pose_graph_config import PoseGraphConfig
from convseq_ros.core.map.reader import open_map
from convseq_ros.core.pose.estimate import with_map_errors
from convseq_ros.core.rigid import angle, inverse, Matrix, matrix, pose_of
from convseq_ros.core.types import Frame, LocalizationState, Match, PoseEstimate
from convseq_ros.node.inputs.closures_heard import closure_of
from convseq_ros.node.outputs.closure_messages import closure_odometry_message
from convseq_ros.node.outputs.measured_transform import MeasuredTransform
from convseq_ros.pose_graph.closures import Closure
from convseq_ros.pose_graph.graph import PoseGraph
from convseq_ros.pose_graph.stored import graph_of, solved
from convseq_ros.simulation.odometry import Drift, DriftingOdometer
from convseq_ros.simulation.town import BLOCK_M, DRIFT, two_blocks
from drives import head, options, progress, road, row, shots, START_NS
import numpy as np

DRIFTS = {
    'small': Drift(scale=0.004, yaw_bias_deg=0.8, noise_m=0.01, yaw_noise_deg=1.0),
    'town': DRIFT,
    'large': Drift(scale=0.03, yaw_bias_deg=6.0, noise_m=0.05, yaw_noise_deg=6.0),
}
DAY_NS, STEP_NS = 86_400 * 10**9, 250_000_000
FRAMES, HALF, CARRIED_M = 270, 100, 320.0  # of a next day; where the robot is carried, how far
SPEED_MPS, RATE_HZ = 6.0, 3.0
FURTHEST_M = 5.0  # between frames; beyond, the robot was carried
CLOSURES = {'threads': 1, 'closure_interval_s': 2.0}  # as slam.launch.py has them
GRAPH, NODE = PoseGraphConfig(), NodeConfig()
Told = tuple[Matrix, float, float]  # map -> odom (4, 4), its sigmas in metres and radians


@dataclass(frozen=True, eq=False, slots=True)
class Heard:
    """What `vpr_node` tells of a frame, and the truth; the frame has no image."""

    frame: Frame
    true: Matrix  # (4, 4)
    match: Match | None = None  # None before it is recognised
    estimate: PoseEstimate | None = None
    closure: tuple[str, Closure] | None = None


class ByGraph:
    """`pose_graph_node` with what `vpr_node` tells it; it solves once a second."""

    def __init__(self, graph: PoseGraph) -> None:
        self._graph, self._solved_ns, self._was = graph, 0, False

    def hear(self, heard: Heard) -> None:
        """Take in a frame's odometry and its closure."""
        frame, graph = heard.frame, self._graph
        assert frame.pose
        graph.add_odometry(frame.stamp_ns, matrix(frame.pose), frame.pose.variances)
        if heard.closure:
            own, closure = heard.closure
            if own:
                graph.name_session(own)
            graph.add_closure(closure)
            if one := heard.estimate:
                graph.add_pose(frame.stamp_ns, matrix(one.pose), one.covariance)
        now = heard.match and heard.match.localization
        is_localised = bool(now and now.state is LocalizationState.LOCALISED)
        if self._was and not is_localised:
            graph.lose()
        self._was = is_localised
        if frame.stamp_ns - self._solved_ns >= 10**9:
            self._solved_ns = frame.stamp_ns
            if problem := graph.problem():
                graph.adopt(problem, problem.solve())

    def told(self) -> Told | None:
        """Return what the node tells."""
        moved = self._graph.correction
        return None if moved is None else (moved, *self._graph.sigmas)


class ByNode:
    """`vpr_node` with `publish_tf`."""

    def __init__(self, position_sigma_m: float) -> None:
        self._transform, self._of_map_m = MeasuredTransform(Mock(), NODE), position_sigma_m
        self._sent: Matrix | None = None
        self._transform._output = Mock(publish=self._keep, stamp_ns=0)

    def _keep(self, _stamp_ns: int, _frame: str, moved: Matrix) -> None:
        self._sent = moved

    def hear(self, heard: Heard) -> None:
        """Take in a frame and its match."""
        assert heard.match
        self._transform.update(heard.frame, heard.match, heard.estimate, self._of_map_m)
        self._transform.on_odometry(heard.frame.stamp_ns, 'odom')

    def told(self) -> Told | None:
        """Return what the node tells."""
        values = self._transform.values
        if self._sent is None:
            return None
        return self._sent, values['map_to_odom_sigma_m'], values['map_to_odom_sigma_rad']


def drawn(seed: int, day: int, carried: bool = False) -> list[Frame]:
    """Return the frames of the first day, all of the route, or of a part on another day."""
    route, rng = two_blocks(*BLOCK_M, seed), np.random.default_rng(100 * seed + day)
    lanes = np.clip(rng.uniform(-1.9, -1.1, 60), -3, 3)
    at = np.arange(60) * 30.0
    start_m, step_m = float(rng.uniform(0, 120)) if day else 0.0, SPEED_MPS / RATE_HZ
    how = {
        'speed_mps': SPEED_MPS, 'frame_rate_hz': RATE_HZ, 'seed': 100 * seed + day,
        'light': 'overcast' if day else 'day',
        'lanes': tuple(zip(at.tolist(), lanes.tolist(), strict=True)),
    }  # fmt: skip
    begun_ns = START_NS + day * DAY_NS
    whole = FRAMES if day else int((route.length_m - 1) / step_m)
    parts = [(start_m, begun_ns, whole)]
    if carried:
        there_m = start_m + HALF * step_m + CARRIED_M
        rest = min(int((route.length_m - there_m - 1) / step_m), FRAMES - HALF)
        later_ns = begun_ns + round((HALF + 8) / RATE_HZ * 1e9)
        parts = [(start_m, begun_ns, HALF), (there_m, later_ns, rest)]
    return [
        frame
        for from_m, from_ns, count in parts
        for _, frame in shots(route, start_m=from_m, start_ns=from_ns, num_frames=count, **how)
    ]


def driven(
    heard: Iterable[Heard], drift: Drift, grows: bool = False, anew: bool = False
) -> Iterator[Heard]:
    """Yield frames with drifting odometry; half-way it may begin anew."""
    odometer, last, driven_m = DriftingOdometer(drift), np.eye(4), 0.0
    for number, one in enumerate(heard):
        step_m = math.dist(last[:3, 3], one.true[:3, 3]) if number else 0.0
        if anew and number == HALF:
            odometer, driven_m = DriftingOdometer(replace(drift, seed=drift.seed + 1)), 0.0
        elif step_m > FURTHEST_M:
            odometer.lift()
        else:
            driven_m += step_m
        last = one.true
        pose = odometer.moved_to(pose_of(one.true))
        posed = replace(pose, variances=_told(drift, driven_m, grows))
        yield replace(one, frame=replace(one.frame, pose=posed))


def _told(drift: Drift, driven_m: float, grows: bool) -> tuple[float, float]:
    """Return the variances in a message of odometry that knows its random errors, or says none."""
    if not grows:
        return 0.0, 0.0
    of_yaw = math.radians(drift.yaw_noise_deg) ** 2 / 100
    return 1e-3 + drift.noise_m**2 * driven_m, 1e-4 + of_yaw * driven_m


def recognised(unheard: Iterable[Heard], by: Pipeline) -> Iterator[Heard]:
    """Yield what `vpr_node` tells of frames with odometry."""
    reference_map = by.recognizer.reference_map
    for one in unheard:
        match, estimate, closure = by.recognizer.process(one.frame), None, None
        by.save()
        if match.accepted:
            start = by.recognizer.mapping.session_start
            message = closure_odometry_message(match, reference_map, start)
            closure = closure_of(message, GRAPH.closure_sigma_rad)
            at = reference_map.places[match.accepted.reference_index].pose
            if match.pose and at:
                sigmas = NODE.position_sigma_m, NODE.heading_sigma_rad
                estimate = with_map_errors(match.pose, at, *sigmas)
        yield Heard(replace(one.frame, gray=None), one.true, match, estimate, closure)
    by.close()


def unheard(frames: Iterable[Frame]) -> Iterator[Heard]:
    """Yield frames that are not recognised yet."""
    for frame in frames:
        assert frame.pose
        yield Heard(frame, matrix(frame.pose))


def measured(
    heard: Iterable[Heard], what: ByGraph | ByNode, origin: Matrix
) -> Iterator[tuple[float, ...]]:
    """Yield the errors (m, rad) and the sigmas of each frame with a transform."""
    for one in heard:
        what.hear(one)
        if told := what.told():
            assert one.frame.pose
            off = inverse(inverse(origin) @ one.true) @ told[0] @ matrix(one.frame.pose)
            yield float(np.linalg.norm(off[:3, 3])), angle(off[:3, :3]), *told[1:]


def in_solved(heard: Iterable[Heard], poses: dict[int, Matrix]) -> Iterator[Heard]:
    """Yield what is told in the same map with other poses (4, 4), by the stamps of its places."""
    for one in heard:
        match, estimate = one.match, None
        if match and match.accepted and match.relative_pose and match.relative_pose.pose:
            moved = poses[match.accepted.reference_stamp_ns] @ matrix(match.relative_pose.pose)
            estimate = PoseEstimate(pose_of(moved), match.relative_pose.covariance)
        yield replace(one, estimate=estimate)


class Town:
    """Drives through a drawn town, each recognised once, with one odometry."""

    def __init__(self, seed: int, folder: Path) -> None:
        self._seed, self._path = seed, folder / f'{seed}.db'
        self.first_day = self._recognised(0, False, self._path, 'online')
        self.origin = self.first_day[0].true

    def _recognised(
        self, day: int, carried: bool, path: Path | None, mode: str = 'preloaded'
    ) -> list[Heard]:
        progress(f'town {self._seed}, day {day}, {mode}{", carried" * carried}')
        drift = replace(DRIFT, seed=10 * self._seed + day)
        seen = driven(unheard(drawn(self._seed, day, carried)), drift)
        return [*recognised(seen, Pipeline(path, make_config(CLOSURES | {'mode': mode})))]

    @cached_property
    def first_day_carried(self) -> list[Heard]:
        """A drive that maps its way, and is carried."""
        return self._recognised(0, True, None, 'online')

    @cached_property
    def next_day(self) -> list[list[Heard]]:
        """Two drives in the map of the first day; in the second one the robot is carried."""
        return [self._recognised(1, carried, self._path) for carried in (False, True)]

    @cached_property
    def solved(self) -> tuple[dict[int, Matrix], float]:
        """The poses (4, 4) of the map as `convseq map link` solves them, by stamp, and a sigma."""
        mapped = open_map(self._path)
        found = solved(mapped)
        by_stamp = {mapped.places[at].stamp_ns: pose for at, pose in found.places.items()}
        return by_stamp, found.position_sigma_m()

    def graph(self) -> PoseGraph:
        """Return the graph of the map of the first day."""
        return graph_of(open_map(self._path), GRAPH)


Run = tuple[str, str, Iterable[tuple[float, ...]]]


def of_town(town: Town, seed: int, odometries: int) -> Iterator[Run]:
    """Yield the part, the name, and what is measured of each drive through a town."""
    hows = [(size, grows, '') for size in DRIFTS for grows in (False, True)]
    hows += [('town', False, how) for how in ('carried', 'anew')]
    for (size, grows, how), again in product(hows, range(odometries)):
        aside, along = (1 - 2 * (bit & 1) for bit in (seed + again, (seed + again) // 2))
        one = DRIFTS[size]
        one = replace(one, scale=along * one.scale, yaw_bias_deg=aside * one.yaw_bias_deg)
        drift, other = (replace(one, seed=1000 * again + 10 * seed + day) for day in (1, 2))
        name = f'{size}{", growing" * grows}{how and f", {how}"}'
        carried, anew = how == 'carried', how == 'anew'
        first = town.first_day_carried if carried else town.first_day
        seen = driven(first, drift, grows, anew)
        yield 'graph, online', name, measured(seen, ByGraph(PoseGraph(GRAPH)), first[0].true)
        seen = driven(town.next_day[carried], other, grows, anew)
        yield 'graph, preloaded', name, measured(seen, ByGraph(town.graph()), town.origin)
        if not grows:
            poses, sigma_m = town.solved
            heard = [*in_solved(town.next_day[carried], poses)]
            seen = driven(heard, other, grows, anew)
            yield 'node, map link', name, measured(seen, ByNode(sigma_m), town.origin)


def of_road(folder: Path, made: Path) -> Iterator[Run]:
    """Yield drives along a road, of which every second image is the map."""
    shown = [
        replace(frame, stamp_ns=START_NS + number * STEP_NS)
        for number, frame in enumerate(road(folder))
    ]
    path = made / f'{folder.name}.db'
    alike = {'threads': 1, 'keyframe_overlap': 1.0}
    build_map(shown[::2], path, make_config(alike))
    next_day = (replace(one, stamp_ns=one.stamp_ns + DAY_NS) for one in shown[1::2])
    seen = driven(unheard(next_day), DRIFT)
    heard = [*recognised(seen, Pipeline(path, make_config(CLOSURES | alike)))]
    for name, drift in DRIFTS.items():
        bys: dict[str, ByGraph | ByNode] = {
            'graph': ByGraph(graph_of(open_map(path), GRAPH)),
            'node': ByNode(NODE.position_sigma_m),
        }
        for part, by in bys.items():
            found = measured(driven(heard, drift), by, np.eye(4))
            yield f'{part}, preloaded', f'{folder.name}, {name}', found


def shown_row(part: str, name: str, rows: list[tuple[float, ...]]) -> None:
    """Print a row of the table."""
    if not rows:
        row(part, name, 0, *['-'] * 8)
        return
    metres, radians, sigma_m, sigma_rad = np.array(rows).T
    shares = [
        f'{100 * np.mean(errors <= factor * sigmas):.1f}'
        for errors, sigmas in ((metres, sigma_m), (radians, sigma_rad))
        for factor in (1, 2, 3)
    ]
    middle = [f'{np.median(all_):.3f}' for all_ in (metres, sigma_m, radians, sigma_rad)]
    row(part, name, len(rows), *shares, *middle)


def main() -> None:
    """Measure, and print."""
    chosen = options(__doc__, seeds=[0, 1, 2, 3], odometries=5, roads=[])
    head('what', 'odometry', 'frames', '1 sigma, m', '2', '3', '1 sigma, rad', '2', '3',
         'median error, m', 'told', 'rad', 'told')  # fmt: skip
    found: dict[tuple[str, str], list[tuple[float, ...]]] = {}
    with tempfile.TemporaryDirectory() as folder:
        made = Path(folder)
        towns = (of_town(Town(seed, made), seed, chosen.odometries) for seed in chosen.seeds)
        roads = (of_road(each, made) for each in chosen.roads)
        for part, name, rows in chain.from_iterable(chain(towns, roads)):
            shown = [*rows]
            found.setdefault((part, name), []).extend(shown)
            found.setdefault((part, 'all'), []).extend(shown)
    for (part, name), rows in sorted(found.items()):
        shown_row(part, name, rows)


if __name__ == '__main__':
    main()
