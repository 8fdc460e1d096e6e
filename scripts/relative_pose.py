# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Print how far off measured relative poses are, and how well their covariance says so.

Usage: python scripts/relative_pose.py [--streets 31 32 33] [--roads FOLDER ...]
       [--images-px 320] [--depth]

Rows tell the pose from the place that lies nearest along the way, from those 2 m and 3 m before
that, and what is shipped 2 m away: it is measured once more from the place that turns out to be
nearest;
`ms` are medians of the processor's time, on all cores.
Streets are drawn: mapped by day, a place each metre; driven again in the evening, under clouds,
and at night with noise, anywhere between the own lane and 2 m to the left, up to 3 degrees turned.
Roads are folders of KITTI's odometry with images/, poses.txt and calib.txt: each image is asked
about the one so many before it, and what came before that is the map; then darkened.
"""

from collections.abc import Iterator
from dataclasses import astuple, dataclass, replace
import math
from pathlib import Path
import time

from convseq_ros.config import Config
from convseq_ros.core.encoding.descriptor import describe
from convseq_ros.core.map.reference_map import ReferenceMap
from convseq_ros.core.matcher import make_matcher
from convseq_ros.core.pose.relative_pose import RelativePoses
from convseq_ros.core.rigid import angle, inverse, matrix
from convseq_ros.core.types import Candidate, Descriptor, Frame
from convseq_ros.simulation.street import Street
from convseq_ros.sources.camera_info import read_camera_file
from convseq_ros.sources.folder import ImageFolder
from convseq_ros.sources.pose_file import read_pose_file
import cv2
from drives import head, options, row, shots
import numpy as np

QUERIES = {'evening': {'light': 'evening', 'noise': 5}, 'overcast': {'light': 'overcast'},
           'night': {'light': 'night', 'noise': 10}}  # fmt: skip
SIZE = {'width_px': 640, 'height_px': 480}
EXPECTED = 12.6  # .95 of a chi squared of six degrees of freedom
Shown = list[tuple[Frame, Descriptor]]


@dataclass(frozen=True, slots=True)
class Error:
    """What is wrong with one measured pose."""

    position_m: float
    turn_deg: float
    squared: float  # normalised error of all six numbers
    same_m: float  # error of saying that the query is at its place
    ms: float  # of the processor that it took


class FromOnePlace(RelativePoses):
    """Measures from the place asked for, with places up to a last one only."""

    last = 1 << 30

    def __init__(self, reference_map, matcher):
        super().__init__(reference_map, matcher)
        moved, self.ways.nearest = self.ways.moved, lambda index, _pose: index
        self.ways.moved = lambda index, other: (
            moved(index, other) if max(index, other) <= self.last else None
        )


def main() -> None:
    """Measure and print."""
    chosen = options(__doc__, streets=[31, 32, 33], roads=[], images_px=0, depth=False)
    head('what', 'n', 'none', 'median m', '90 %', 'median deg', '90 %', 'squared', f'< {EXPECTED}',
         'same pose m', 'ms')  # fmt: skip
    found: dict[str, list[Error | None]] = {}
    for seed in chosen.streets:
        for name, error in of_street(seed, chosen.images_px, chosen.depth):
            found.setdefault(name, []).append(error)
    for name, errors in found.items():
        tell(name, errors)
    for folder in chosen.roads:
        for name, errors in of_road(folder, chosen.images_px):
            tell(f'{folder.name} {name}', errors)


def tell(name: str, errors: list[Error | None]) -> None:
    """Print one row."""
    known = [one for one in errors if one]
    numbers = np.array([astuple(one) for one in known] or [(np.nan,) * 5])
    metres, degrees, squared, same_m, ms = numbers.T
    told = [f'{part:.2f}' for one in (metres, degrees) for part in np.percentile(one, (50, 90))]
    told += [f'{np.median(squared):.1f}', f'{np.mean(squared < EXPECTED):.2f}']
    told += [f'{np.median(same_m):.2f}', f'{np.median(ms):.0f}']
    row(name, len(errors), len(errors) - len(known), *told)


def of_street(seed: int, images_px: int, depth: bool) -> Iterator[tuple[str, Error | None]]:
    """Yield what is wrong with poses on a drawn street, from three places each."""
    map_shown, queries = drawn(seed, depth)
    poses_of_map = [frame.pose for frame, _ in map_shown]
    if depth:
        map_shown = [(replace(frame, pose=None), descriptor) for frame, descriptor in map_shown]
    reference_map = made(map_shown, images_px)
    for light, shown in queries.items():
        matcher = make_matcher(reference_map, Config())
        one, best = (kind(reference_map, matcher) for kind in (FromOnePlace, RelativePoses))
        for _, descriptor in shown:  # a drive is longer: by then its background is known
            matcher.extract(descriptor)
        for frame, descriptor in shown:
            features = matcher.extract(descriptor)
            along_m = [pose.position[0] for pose in poses_of_map]
            nearest = int(np.argmin(np.abs(np.array(along_m) - frame.pose.position[0])))
            for name, index, poses in (
                ('nearest', nearest, one),
                ('2 m away', nearest - 2, one),
                ('2 m away, shipped', nearest - 2, best),
                ('3 m away', nearest - 3, one),
            ):
                found = Candidate(index, 0, 0, matcher.shift(features, index))
                what_is_wrong = error(poses, features, frame, found, poses_of_map[index])
                yield f'{light:9}{name}', what_is_wrong


def of_road(folder: Path, images_px: int) -> Iterator[tuple[str, list[Error | None]]]:
    """Yield what is wrong with poses on a road, so many frames from the reference."""
    shown, dark = road(folder)
    for name, queries in (('', shown), ('dark', dark)):
        matcher = make_matcher(reference_map := made(shown, images_px), Config())
        extracted = [matcher.extract(descriptor) for _, descriptor in queries]
        poses = FromOnePlace(reference_map, matcher)
        for apart in (1, 2, 4):
            errors = []
            for at in range(apart + 3, len(shown)):
                poses.last = index = at - apart
                found = Candidate(index, 0, 0, matcher.shift(extracted[at], index))
                place = reference_map.places[index]
                errors.append(error(poses, extracted[at], queries[at][0], found, place.pose))
            yield f'{name:5}{apart} frames', errors


def error(poses, features, frame, found, place) -> Error | None:
    """Return what is wrong with one pose; None if none in metres is measured."""
    started = time.process_time()
    told = poses.measure(features, frame, found)
    ms = (time.process_time() - started) * 1e3
    if told is None or told.position_m is None:
        return None
    truth = inverse(matrix(place)) @ matrix(frame.pose)
    said = matrix(replace(place, position=told.position_m, orientation=told.orientation))
    turned = said[:3, :3] @ truth[:3, :3].T
    turn = cv2.Rodrigues(turned)[0].ravel()
    off = np.concatenate((said[:3, 3] - truth[:3, 3], turn))
    squared = float(off @ np.linalg.solve(told.covariance, off))
    metres, same_m = float(np.linalg.norm(off[:3])), math.dist(truth[:3, 3], (0, 0, 0))
    return Error(metres, math.degrees(angle(turned)), squared, same_m, ms)


def made(shown: Shown, images_px: int) -> ReferenceMap:
    """Return a map of every frame, with images of a size or without."""
    reference_map = ReferenceMap()
    for frame, descriptor in shown:
        reference_map.add_frame(frame, descriptor, 0, images_px)
    if images_px:
        kept = [len(one.image) for one in reference_map.pictures(range(len(shown)), True)]
        print(f'{np.mean(kept) / 1e3:.1f} kB an image', flush=True)
    return reference_map


def drawn(seed: int, depth: bool = False) -> tuple[Shown, dict[str, Shown]]:
    """Return a map's frames and those of some drives."""
    street, rng = Street(120.0, seed), np.random.default_rng(seed)
    along = np.arange(0.0, 121.0, 12.0).tolist()
    queries = {}
    for name, how in QUERIES.items():
        lanes = tuple(zip(along, rng.uniform(-1.5, 0.5, len(along)).tolist(), strict=True))
        heading_deg, noise_seed = float(rng.uniform(-3, 3)), seed + len(queries) + 1
        drive = shots(
            street, start_m=4.3, frame_rate_hz=5.3, num_frames=22, lanes=lanes,
            heading_deg=heading_deg, seed=noise_seed, **SIZE, **how,
        )  # fmt: skip
        queries[name] = described(frame for _, frame in drive)
    mapped = shots(street, num_frames=50, seed=seed, has_depth=depth, **SIZE)
    return described(frame for _, frame in mapped), queries


def road(folder: Path) -> tuple[Shown, Shown]:
    """Return the frames of a road, and the same darkened."""
    source = ImageFolder(folder / 'images')
    frames = list(source)
    pose_at = read_pose_file(folder / 'poses.txt', len(frames))
    camera = read_camera_file(folder / 'calib.txt', *frames[0].gray.shape)
    posed = [
        replace(one, pose=pose_at(index, one.stamp_ns), camera=camera)
        for index, one in enumerate(frames)
    ]
    rng = np.random.default_rng(1)
    dark = [replace(one, gray=darkened(one.gray, rng)) for one in posed]
    return described(posed), described(dark)


def darkened(gray, rng):
    """Return an image at a quarter of its light, with four lamps, blur and noise."""
    height, width = gray.shape
    rows, columns = np.mgrid[:height, :width]
    light = gray * 0.25
    for _ in range(4):
        x, y = rng.uniform(0, width), rng.uniform(0, 0.6 * height)
        light += 120 * np.exp(-((columns - x) ** 2 + (rows - y) ** 2) / (2 * (0.06 * height) ** 2))
    blurred = cv2.GaussianBlur(light, (0, 0), 1.2) + rng.normal(0, 6, gray.shape)
    return blurred.clip(0, 255).astype(np.uint8)


def described(frames) -> Shown:
    """Return frames and what they show."""
    return [(one, describe(one.gray)) for one in frames]


if __name__ == '__main__':
    main()
