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

import argparse
from collections.abc import Iterator
from dataclasses import dataclass, replace
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
from convseq_ros.simulation.drive import draw, Drive
from convseq_ros.simulation.street import Street
from convseq_ros.sources.camera_file import read_camera_file
from convseq_ros.sources.folder import ImageFolder
from convseq_ros.sources.pose_file import read_pose_file
import cv2
import numpy as np

QUERIES = {'evening': {'light': 'evening', 'noise': 5}, 'overcast': {'light': 'overcast'},
           'night': {'light': 'night', 'noise': 10}}  # fmt: skip
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
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument('--streets', type=int, nargs='*', default=[31, 32, 33])
    parser.add_argument('--roads', type=Path, nargs='*', default=[])
    parser.add_argument('--images-px', type=int, default=0, help='have the map keep images')
    parser.add_argument(
        '--depth', action='store_true', help='streets: the map has depth images and no odometry'
    )
    chosen = parser.parse_args()
    numbers = 'n  none  median m  90 %  median deg  90 %  squared  <12.6  same pose m    ms'
    print(f'{"what":27}   {numbers}')
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
    if not known:
        print(f'{name:27}{len(errors):4}  none is measured')
        return
    metres, degrees = ([getattr(one, of) for one in known] for of in ('position_m', 'turn_deg'))
    squared = np.array([one.squared for one in known])
    print(
        f'{name:27}{len(errors):4}{len(errors) - len(known):6}{np.median(metres):10.2f}'
        f'{np.percentile(metres, 90):6.2f}{np.median(degrees):12.2f}'
        f'{np.percentile(degrees, 90):6.2f}{np.median(squared):9.1f}'
        f'{np.mean(squared < EXPECTED):7.2f}{np.median([one.same_m for one in known]):13.2f}'
        f'{np.median([one.ms for one in known]):6.0f}',
        flush=True,
    )


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
        drive = Drive(
            start_m=4.3, frame_rate_hz=5.3, num_frames=22, lanes=lanes, heading_deg=heading_deg,
            seed=noise_seed, **how,
        )  # fmt: skip
        queries[name] = described(shot.frame for shot in draw(street, drive))
    mapping = Drive(num_frames=50, seed=seed, has_depth=depth)
    return described(shot.frame for shot in draw(street, mapping)), queries


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
