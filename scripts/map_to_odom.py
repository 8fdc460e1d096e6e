# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Print the error of `map -> base` that `publish_tf` of vpr_node gives by itself.

Usage: python scripts/map_to_odom.py [--streets 31 32 33] [--metres 250], some minutes.

Drawn streets are mapped by day, a place per metre, and driven again by day, up to 1 m beside the
map's line, with odometry that drifts by 2 %. Errors are those at each frame while the robot is
localised, from the first measured pose on.
"""

from dataclasses import replace
from types import SimpleNamespace
from typing import cast
from unittest.mock import Mock

from convseq_ros import build_map, PlaceRecognizer
from convseq_ros.config.node_config import NodeConfig
from convseq_ros.core.encoding.descriptor import describe
from convseq_ros.core.pose.estimate import with_map_errors
from convseq_ros.core.rigid import inverse, matrix
from convseq_ros.core.types import LocalizationState
from convseq_ros.node.frame_context import OdometryListener
from convseq_ros.node.map_to_odom import MapToOdom
from convseq_ros.node.measured_transform import MeasuredTransform
from convseq_ros.simulation.odometry import Drift, DriftingOdometer
from convseq_ros.simulation.street import Street
from drives import head, HOUR_NS, lanes, options, row, shots, START_NS
import numpy as np

DRIFT = Drift(scale=0.02, yaw_bias_deg=2.0, noise_m=0.02, yaw_noise_deg=2.0)
SIZE = {'width_px': 640, 'height_px': 480}
HEADS = (
    'street', 'frames', 'localised', 'measured', 'median m', '95 % m', 'worst m',
    'as measured: median m', '95 % m',
)  # fmt: skip


def main() -> None:
    """Measure each street, and all together."""
    chosen = options(__doc__, streets=[31, 32, 33], metres=250)
    head(*HEADS)
    frames, localised, off, alone = 0, 0, list[float](), list[float]()
    for seed in chosen.streets:
        result = driven(seed, chosen.metres)
        show(str(seed), *result)
        frames, localised = frames + result[0], localised + result[1]
        off, alone = off + result[2], alone + result[3]
    show('all', frames, localised, off, alone)


def show(name: str, frames: int, localised: int, off: list[float], alone: list[float]) -> None:
    """Print a row."""
    numbers = [*np.percentile(off, [50, 95, 100]), *np.percentile(alone, [50, 95])]
    row(name, frames, localised, len(alone), *(f'{number:.2f}' for number in numbers))


def driven(seed: int, metres: int) -> tuple[int, int, list[float], list[float]]:
    """Return frames, those localised, and errors in metres: with odometry, and as measured."""
    street = Street(metres + 40, seed)
    shown = [frame for _, frame in shots(street, num_frames=metres, **SIZE)]
    mapped = build_map(shown)
    line = lanes(metres, -1.5, 1.0, np.random.default_rng(seed))
    again = shots(
        street, num_frames=metres - 20, start_m=8.4, lanes=line, seed=seed + 1,
        start_ns=START_NS + HOUR_NS, **SIZE,
    )  # fmt: skip
    recognizer, odometer = PlaceRecognizer(mapped), DriftingOdometer(DRIFT)
    odometry, sent = cast(OdometryListener, SimpleNamespace(on_pose=None)), list[np.ndarray]()
    transform = MeasuredTransform(Mock(), NodeConfig(), odometry)
    output = SimpleNamespace(publish=lambda *all_: sent.append(all_[2]), stamp_ns=0)
    transform._output = cast(MapToOdom, output)
    localised, off, alone = 0, list[float](), list[float]()
    for _, frame in again:
        true, pose = matrix(frame.pose), odometer.moved_to(frame.pose)
        moved = replace(frame, pose=pose)
        match = recognizer.process(moved, describe(frame.gray))
        state = match.localization and match.localization.state
        if match.accepted:
            place = mapped.places[match.accepted.reference_index].pose
            estimate = match.pose and with_map_errors(match.pose, place, 0.05, 0.01)
            if estimate and match.relative_pose and match.relative_pose.pose:
                alone.append(away(true, matrix(estimate.pose)))
            if estimate:
                transform.update(moved, match, estimate)
        if state is LocalizationState.LOCALISED:
            localised += 1
            sent.clear()
            odometry.on_pose(frame.stamp_ns, 'odom')
            if sent:
                off.append(away(true, sent[-1] @ matrix(pose)))
    return len(again), localised, off, alone


def away(true: np.ndarray, found: np.ndarray) -> float:
    """Return the distance in metres."""
    return float(np.linalg.norm((inverse(true) @ found)[:3, 3]))


if __name__ == '__main__':
    main()
