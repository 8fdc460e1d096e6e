# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Feeds loop closures into a pose graph, live: `make demo-slam`."""

import argparse
from collections.abc import Mapping, Sequence
import math
from pathlib import Path
import shutil
import sys

try:
    import gtsam
    import matplotlib  # noqa: F401
    import rclpy  # noqa: F401
except ModuleNotFoundError as error:
    sys.exit(f"demo: {error.name} is not installed; in a clone, pip install '.[slam,ros,plot]'")
from comparison import absolute_error_m, compare, draw_false, Trial, true_path, Truth, twice
from convseq_ros.cli.demo import make_empty
from convseq_ros.core.types import Pose
from convseq_ros.errors import ConvseqError
from convseq_ros.sources.recording import read_poses
from graph import Closure, micro, Odometry, optimise, read_record, Solution
from incremental import Incremental
from live import play
import numpy as np
from picture import draw_picture
from simulated import DRIFT, record, two_blocks

Errors = Mapping[str, tuple[float, float]]
_MARKER = '.convseq-demo-slam'
_BLOCK_M = 110.0, 70.0  # of the town
_COUNTS = (0, 1, 3, 6, 12)
_RIGHT_M, _RIGHT_DEG = 2.0, 10.0  # largest errors of a right closure
_VPR = {
    'mode': 'online', 'closure_interval_s': 2.0,
    'matching': 'coherent', 'search': 'shortlist', 'queue_size': 1000, 'max_wait_s': 0.0,
    'odom_wait_s': 2.0,
}  # fmt: skip


def main() -> int:
    """Simulate, run the nodes, compare, and draw; return the exit code."""
    parser = argparse.ArgumentParser(prog='demo', description=__doc__)
    parser.add_argument('--output', type=Path, default=Path('demo-slam'), help='(demo-slam)')
    parser.add_argument('--picture', type=Path, help='where to put a copy of the picture')
    parser.add_argument('--rate', type=float, default=3.0, help='speed of playing (3)')
    parser.add_argument('--false', type=int, default=6, help='false closures sent live (6)')
    parser.add_argument('--draws', type=int, default=10, help='of false closures, each count (10)')
    parser.add_argument('--seed', type=int, default=0, help='another town, drive and drift (0)')
    chosen = parser.parse_args()
    try:
        _run(chosen)
    except (ConvseqError, OSError) as error:
        print(f'demo: {error}', file=sys.stderr)
        return 1
    return 0


def _run(chosen: argparse.Namespace) -> None:
    folder: Path = chosen.output.absolute()
    make_empty(folder, _MARKER)
    _progress('drawing a drive through a town')
    route = two_blocks(*_BLOCK_M, chosen.seed)
    recording = folder / 'drive'
    record(recording, route, chosen.seed)
    poses = dict(read_poses(recording, '/ground_truth'))
    truth = {stamp_ns: pose.position[:2] for stamp_ns, pose in poses.items()}
    false = draw_false(np.random.default_rng(0), truth, chosen.false)
    _progress(f'playing it to vpr_node and to the pose graph, at {chosen.rate:g} times its speed')
    play(folder, len(truth), chosen.rate, _VPR, false)

    stamped, closures, kept = read_record(folder / 'pose_graph.json')
    injected = {(micro(c.query_ns), micro(c.reference_ns)) for c in false}
    is_false = [(micro(c.query_ns), micro(c.reference_ns)) in injected for c in closures]
    ours = [c for c, wrong in zip(closures, is_false, strict=True) if not wrong]
    odometry = Odometry()
    for stamp_ns, pose in stamped:
        odometry.add(stamp_ns, pose)
    right = [closure for closure in ours if _is_right(*_off(poses, closure))]
    _progress(f'adding false closures, {chosen.draws} times each number')
    trials = compare(odometry, right, truth, _COUNTS, chosen.draws)

    live = optimise(odometry, closures)
    errors = _errors(odometry, ours, live, truth)
    print(f'\n{_description(route.length_m, len(truth))}\n')
    print(_summary(poses, ours, kept, is_false))
    print()
    print(_table(errors, trials, len(right)))
    picture = folder / 'demo_slam.png'
    draw_picture(
        picture,
        odometry,
        live,
        closures,
        truth,
        trials,
        f'{len(ours)} closures of its online mode, {len(ours) - len(right)} of them wrong, and '
        f'{sum(is_false)} false ones sent in between: the graph kept {sum(live.kept)} and '
        f'rejected {len(closures) - sum(live.kept)}',
    )
    if chosen.picture:
        shutil.copyfile(picture, chosen.picture)
    print(f'\npicture  {chosen.picture or picture}')


def _errors(odometry: Odometry, ours: Sequence[Closure], live: Solution, truth: Truth) -> Errors:
    """Return the errors of each method: of all keyframes, and of those passed twice."""
    real, again = true_path(live, truth), twice(live, truth)
    batch = optimise(odometry, ours)
    kept_closures = [closure for closure, is_kept in zip(ours, batch.kept, strict=True) if is_kept]
    incremental = Incremental()
    incremental.update(odometry, kept_closures)
    paths = {
        'odometry alone': live.before,
        'every closure of vpr_node believed': optimise(odometry, ours, robust=False).after,
        'closures of vpr_node, GNC': batch.after,
        'those that GNC kept, iSAM2': incremental.path,
        'live, with the false ones, GNC': live.after,
    }
    return {
        name: (absolute_error_m(path[:, :2], real), absolute_error_m(path[again, :2], real[again]))
        for name, path in paths.items()
    }


def _description(length_m: float, frames: int) -> str:
    return (
        f'A drawn town: {length_m:.0f} m, {frames} frames; odometry is {DRIFT.scale:.1%} too long '
        f'and turns {DRIFT.yaw_bias_deg:g} degrees too far in 100 m, and noise.'
    )


def _summary(
    poses: Mapping[int, Pose],
    ours: Sequence[Closure],
    kept: Sequence[bool],
    is_false: Sequence[bool],
) -> str:
    off = [_off(poses, closure) for closure in ours]
    right = sum(_is_right(*each) for each in off)
    median_m = np.median([metres for metres, _ in off]) if off else 0.0
    ours_kept = sum(k and not f for k, f in zip(kept, is_false, strict=True))
    false_kept = sum(k and f for k, f in zip(kept, is_false, strict=True))
    lines = [
        f'vpr_node sent {len(ours)} closures, {right} of them right: their poses are off by less '
        f'than {_RIGHT_M:g} m and {_RIGHT_DEG:g} degrees (median {median_m:.2f} m)',
        f'the pose graph, live, kept {ours_kept} of these, and {false_kept} of '
        f'{sum(is_false)} false ones sent in between',
    ]
    return '\n'.join(lines)


def _off(poses: Mapping[int, Pose], closure: Closure) -> tuple[float, float]:
    """Return a closure's errors in metres and degrees; unmeasured closures assume no motion."""
    query, reference = (
        _planar(poses[min(poses, key=lambda at_ns: abs(at_ns - stamp_ns))])
        for stamp_ns in closure[:2]
    )
    measured = gtsam.Pose2(*closure.measured) if closure.measured else gtsam.Pose2()
    off = reference.between(query).between(measured)
    return math.hypot(off.x(), off.y()), abs(math.degrees(off.theta()))


def _planar(pose: Pose) -> gtsam.Pose2:
    return gtsam.Pose2(*pose.position[:2], 2 * math.atan2(*pose.orientation[2:]))


def _is_right(metres: float, degrees: float) -> bool:
    return metres < _RIGHT_M and degrees < _RIGHT_DEG


def _table(errors: Errors, trials: Sequence[Trial], right: int) -> str:
    by = {(trial.false, trial.robust): trial for trial in trials}
    plain, robust = ([by[count, way] for count in _COUNTS] for way in (False, True))
    rows = [
        (f'false ones added to the {right} right ones', [str(count) for count in _COUNTS]),
        ('every closure believed (LM)', [f'{trial.median_m:.2f}' for trial in plain]),
        ('    lowest - highest', [_range(trial) for trial in plain]),
        ('graduated non-convexity (GNC)', [f'{trial.median_m:.2f}' for trial in robust]),
        ('    lowest - highest', [_range(trial) for trial in robust]),
        (f'    right ones kept, of {right}', [_least_most(t.right_kept) for t in robust]),
        ('    false ones kept', [_least_most(t.false_kept) for t in robust]),
    ]
    lines = [
        'Trajectory error (ATE RMSE after SE2 alignment, metres), median of the draws',
        f'{"":38}{"all keyframes":>15}{"passed twice":>15}',
        *(f'{name:38}{all_m:>15.2f}{twice_m:>15.2f}' for name, (all_m, twice_m) in errors.items()),
        'passed twice: keyframes within 5 m of where the robot was 30 s before or later',
        '',
    ]
    lines += [f'{name:38}' + ''.join(f'{cell:>15}' for cell in cells) for name, cells in rows]
    return '\n'.join(lines)


def _range(trial: Trial) -> str:
    return f'{min(trial.errors_m):.2f} - {max(trial.errors_m):.2f}'


def _least_most(counts: Sequence[int]) -> str:
    low, high = min(counts), max(counts)
    return str(low) if low == high else f'{low} - {high}'


def _progress(text: str) -> None:
    print(f'{text} ...', file=sys.stderr)


if __name__ == '__main__':
    sys.exit(main())
