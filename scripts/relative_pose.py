# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Print the errors of measured relative poses, and how well the covariance predicts them.

Usage: python scripts/relative_pose.py [--streets 31 32 33] [--roads FOLDER ...]
       [--images-px 320]

Rows are for the pose from the nearest place along the way, and from the places 2 m and 3 m before.
`2 m away, shipped` is the shipped method: it measures again from the place that is nearest to the
first estimate.
`ms` are medians of the CPU time, on all cores.
Drawn streets are mapped by day, with a place per metre. They are driven again in the evening,
under clouds, and at night with noise, up to 2 m to the left and turned by up to 3 degrees.
Roads are folders of KITTI's odometry with images/, poses.txt and calib.txt. Each image is measured
against an earlier one, with only earlier images in the map; then all again with darkened images.
"""

from collections.abc import Iterator
from dataclasses import astuple, dataclass, replace
from itertools import chain
import math
from pathlib import Path
import time
from typing import Any

from convseq_ros.config import Config
from convseq_ros.core.map.reference_map import ReferenceMap
from convseq_ros.core.pose.relative_pose import RelativePoses
from convseq_ros.core.rigid import angle, inverse, matrix
from convseq_ros.core.similarity.matcher import make_matcher, Matcher
from convseq_ros.core.similarity.scorer import Features
from convseq_ros.core.types import Candidate, Frame
from convseq_ros.simulation.street import Street
import cv2
from drives import Described, described, head, options, road, row, shots
import numpy as np

QUERIES: dict[str, dict[str, Any]] = {
    'evening': {'light': 'evening', 'noise': 5},
    'overcast': {'light': 'overcast'},
    'night': {'light': 'night', 'noise': 10},
}
SIZE = {'width_px': 640, 'height_px': 480}
EXPECTED = 12.6  # 95 % quantile of chi squared with six degrees of freedom


@dataclass(frozen=True, slots=True)
class Error:
    """The errors of one measured pose."""

    position_m: float
    turn_deg: float
    squared: float  # squared normalised error of all six components
    same_m: float  # error of assuming the reference's own pose
    ms: float  # CPU time


class FromOnePlace(RelativePoses):
    """Measures from the given place only, with no places after `last`."""

    last = 1 << 30

    def __init__(self, reference_map: ReferenceMap, matcher: Matcher) -> None:
        super().__init__(reference_map, matcher)
        motion, moved = self.motion, self.motion.moved
        motion.nearest = lambda index, _pose: index  # type: ignore[method-assign,assignment]
        motion.moved = lambda index, other: (  # type: ignore[method-assign]
            moved(index, other) if max(index, other) <= self.last else None
        )


def main() -> None:
    """Measure and print."""
    chosen = options(__doc__, streets=[31, 32, 33], roads=[], images_px=0)
    head('what', 'n', 'none', 'median m', '90 %', 'median deg', '90 %', 'squared', f'< {EXPECTED}',
         'same pose m', 'ms')  # fmt: skip
    errors_of: dict[str, list[Error | None]] = {}
    streets = (of_street(seed, chosen.images_px) for seed in chosen.streets)
    roads = (of_road(folder, chosen.images_px) for folder in chosen.roads)
    for name, error in chain.from_iterable(chain(streets, roads)):
        errors_of.setdefault(name, []).append(error)
    for name, errors in errors_of.items():
        print_row(name, errors)


def print_row(name: str, errors: list[Error | None]) -> None:
    """Print one row."""
    measured = [error for error in errors if error]
    numbers = np.array([astuple(error) for error in measured] or [(np.nan,) * 5])
    metres, degrees, squared, same_m, ms = numbers.T
    cells = [f'{part:.2f}' for all_ in (metres, degrees) for part in np.percentile(all_, (50, 90))]
    cells += [f'{np.median(squared):.1f}', f'{np.mean(squared < EXPECTED):.2f}']
    cells += [f'{np.median(same_m):.2f}', f'{np.median(ms):.0f}']
    row(name, len(errors), len(errors) - len(measured), *cells)


def of_street(seed: int, images_px: int) -> Iterator[tuple[str, Error | None]]:
    """Yield the errors of poses on a drawn street, from three places each."""
    map_shown, queries = drawn(seed)
    poses_of_map = [frame.pose for frame, _ in map_shown if frame.pose]
    reference_map = made(map_shown, images_px)
    for light, shown in queries.items():
        matcher = make_matcher(reference_map, Config())
        single, best = (kind(reference_map, matcher) for kind in (FromOnePlace, RelativePoses))
        for _, descriptor in shown:  # warm up the background, as on a longer drive
            matcher.extract(descriptor)
        for frame, descriptor in shown:
            features = matcher.extract(descriptor)
            assert features and frame.pose
            along_m = [pose.position[0] for pose in poses_of_map]
            nearest = int(np.argmin(np.abs(np.array(along_m) - frame.pose.position[0])))
            for name, index, poses in (
                ('nearest', nearest, single),
                ('2 m away', nearest - 2, single),
                ('2 m away, shipped', nearest - 2, best),
                ('3 m away', nearest - 3, single),
            ):
                yield f'{light:9}{name}', error(poses, features, frame, index)


def of_road(folder: Path, images_px: int) -> Iterator[tuple[str, Error | None]]:
    """Yield the errors of poses on a road, at 1, 2 and 4 frames from the reference."""
    frames, rng = road(folder), np.random.default_rng(1)
    shown = described(frames)
    dark = described(replace(one, gray=darkened(one.gray, rng)) for one in frames)
    for name, queries in (('', shown), ('dark', dark)):
        matcher = make_matcher(reference_map := made(shown, images_px), Config())
        extracted = [matcher.extract(descriptor) for _, descriptor in queries]
        poses = FromOnePlace(reference_map, matcher)
        for apart in (1, 2, 4):
            for at in range(apart + 3, len(shown)):
                poses.last = index = at - apart
                features, frame = extracted[at], queries[at][0]
                assert features
                pose_error = error(poses, features, frame, index)
                yield f'{folder.name} {name:5}{apart} frames', pose_error


def error(poses: RelativePoses, features: Features, frame: Frame, index: int) -> Error | None:
    """Return the errors of a pose from a place; None if no pose in metres is measured."""
    place = poses._map.places[index].pose
    candidate = Candidate(index, 0, 0, poses._matcher.shift(features, index))
    started = time.process_time()
    pose = poses.measure(features, frame, candidate)
    ms = (time.process_time() - started) * 1e3
    if pose is None or pose.position_m is None:
        return None
    assert place and frame.pose
    truth = inverse(matrix(place)) @ matrix(frame.pose)
    estimate = matrix(replace(place, position=pose.position_m, orientation=pose.orientation))
    turned = estimate[:3, :3] @ truth[:3, :3].T
    turn = cv2.Rodrigues(turned)[0].ravel()
    off = np.concatenate((estimate[:3, 3] - truth[:3, 3], turn))
    squared = float(off @ np.linalg.solve(pose.covariance, off))
    metres, same_m = float(np.linalg.norm(off[:3])), math.dist(truth[:3, 3], (0, 0, 0))
    return Error(metres, math.degrees(angle(turned)), squared, same_m, ms)


def made(shown: Described, images_px: int) -> ReferenceMap:
    """Return a map of all frames, with images of a size or without images."""
    reference_map = ReferenceMap()
    for frame, descriptor in shown:
        reference_map.add_frame(frame, descriptor, 0, images_px)
    return reference_map


def drawn(seed: int) -> tuple[Described, dict[str, Described]]:
    """Return the frames of the map, and of the query drives."""
    street, rng = Street(120.0, seed), np.random.default_rng(seed)
    along = np.arange(0.0, 121.0, 12.0).tolist()
    queries = dict[str, Described]()
    for name, how in QUERIES.items():
        lanes = tuple(zip(along, rng.uniform(-1.5, 0.5, len(along)).tolist(), strict=True))
        heading_deg, noise_seed = float(rng.uniform(-3, 3)), seed + len(queries) + 1
        drive = shots(
            street, start_m=4.3, frame_rate_hz=5.3, num_frames=22, lanes=lanes,
            heading_deg=heading_deg, seed=noise_seed, **SIZE, **how,
        )  # fmt: skip
        queries[name] = described(frame for _, frame in drive)
    mapped = shots(street, num_frames=50, seed=seed, **SIZE)
    return described(frame for _, frame in mapped), queries


def darkened(gray: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """Return an image at a quarter of its light, with four lamps, blur and noise."""
    height, width = gray.shape
    rows, columns = np.mgrid[:height, :width]
    light = gray * 0.25
    for _ in range(4):
        x, y = rng.uniform(0, width), rng.uniform(0, 0.6 * height)
        light += 120 * np.exp(-((columns - x) ** 2 + (rows - y) ** 2) / (2 * (0.06 * height) ** 2))
    blurred = cv2.GaussianBlur(light, (0, 0), 1.2) + rng.normal(0, 6, gray.shape)
    return blurred.clip(0, 255).astype(np.uint8)


if __name__ == '__main__':
    main()
