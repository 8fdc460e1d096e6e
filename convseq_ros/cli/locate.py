# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Print where in a map images were taken: `convseq locate IMAGE... --map MAP`."""

import argparse
from collections.abc import Sequence
import json
from pathlib import Path
import struct
from typing import Any
import zlib

from convseq_ros.app.match_picture import answer_picture
from convseq_ros.app.pipeline import Pipeline
from convseq_ros.cli.options import add_config, chosen_config, note, warn
from convseq_ros.cli.outputs import add_output
from convseq_ros.core.pose.estimate import estimate_pose
from convseq_ros.core.recognizer import PlaceRecognizer
from convseq_ros.core.types import Frame, Localization, Match, PoseEstimate
from convseq_ros.errors import ConfigError, ConvseqError, ImageError, printable, SourceError
from convseq_ros.io.regular_file import complete_or_absent, MARK
from convseq_ros.models.onnx_model import open_model
from convseq_ros.sources.camera_info import read_camera_file
from convseq_ros.sources.folder import FRAME_INTERVAL_NS, unreadable
from convseq_ros.sources.images import gray_of, read_picture
from convseq_ros.sources.source import Lines
import cv2
import numpy as np
import numpy.typing as npt

_PNG_HEAD = 33  # bytes of its signature and first chunk


def describe(parser: argparse.ArgumentParser) -> None:
    add = parser.add_argument
    add('images', type=Path, nargs='+', help='one image, or the last few of a drive in order')
    add('--map', type=Path, required=True, help='reference map')
    help_ = 'file that describes the camera (YAML of ROS, calib.txt of KITTI, matrix)'
    add('--camera-info', type=Path, metavar='FILE', help=help_)
    help_ = 'PNG to draw: the last image and its place'
    add_output(parser, '--picture', kinds=('.png',), help=help_)
    add('--json', action='store_true', help='print the answer as JSON')
    add_config(parser)


def run(chosen: argparse.Namespace) -> int:
    """Process the images in turn, and print the localisation after the last."""
    config = chosen_config(chosen)
    if config.online.mode != 'preloaded':
        raise ConfigError('mode: locate adds nothing to a map; leave it preloaded')
    pipeline = Pipeline(chosen.map, config, describe=open_model(config))
    for line in pipeline.ignored:
        warn(line)
    try:
        recognizer = pipeline.recognizer
        frames = list(_frames(chosen.images, recognizer, chosen.camera_info))
        matches = [recognizer.process(frame) for frame in frames]
        for line in pipeline.cameras.notes:
            note(line)
        for line in pipeline.cameras.problems:
            warn(line)
        pose = _pose(matches, recognizer)
        answer = _answer(matches, recognizer, pose)
        if chosen.picture:
            _draw(chosen.picture, answer_picture(frames[-1], matches[-1], recognizer))
    finally:
        pipeline.close()
    print(json.dumps(answer) if chosen.json else _in_words(answer, pose))
    return 0


def _frames(
    images: Sequence[Path], recognizer: PlaceRecognizer, camera_info: Path | None
) -> list[Frame]:
    """Return the images as a camera would have sent them."""
    reading = recognizer.config.reading
    frames, told = [], Lines()
    for number, path in enumerate(images, 1):
        if path.is_dir():
            raise SourceError(f'{path}: a folder; give its last few pictures, or use replay')
        stamp_ns = number * FRAME_INTERVAL_NS
        try:
            gray = gray_of(read_picture(path, reading))
        except ImageError as error:
            problem = unreadable(path, error)
            frames.append(Frame(stamp_ns, None, printable(str(path)), problem=problem))
            continue
        height, width = gray.shape
        camera = None
        if camera_info:
            camera = read_camera_file(camera_info, height, width, reading, told)
        frames.append(Frame(stamp_ns, gray, printable(str(path)), camera=camera))
    problems = [frame.problem for frame in frames if frame.gray is None]
    if len(problems) == len(frames):
        raise SourceError(problems[-1])
    for line in [*problems, *told]:
        warn(line)
    return frames


def _pose(matches: Sequence[Match], recognizer: PlaceRecognizer) -> PoseEstimate | None:
    """Return the pose of the camera; None if it is not localised or places have no poses."""
    last = matches[-1].localization
    if last is None or last.reference_index is None:
        return None
    for match in reversed(matches):
        if match.accepted and match.accepted.reference_index == last.reference_index:
            return match.pose
    # No match was accepted for this place: it is a candidate, or a look of the accepted one. So no
    # record has the pose there; it is that of the place, with a heading that is not known.
    return estimate_pose(recognizer.reference_map.places, last.reference_index)


def _answer(
    matches: Sequence[Match], recognizer: PlaceRecognizer, pose: PoseEstimate | None
) -> dict[str, Any]:
    localization = matches[-1].localization or Localization()
    index = localization.reference_index
    answer: dict[str, Any] = {
        'state': localization.state.value,
        'quality': localization.quality,
        'place': index,
        'problem': localization.problem,
        'reason': matches[-1].reason.value,
        'images': len(matches),
        'pose': None,
    }
    if pose:
        answer['pose'] = {
            'position_m': list(pose.pose.position),
            'orientation': list(pose.pose.orientation),
            'covariance': pose.covariance.ravel().tolist(),
        }
    if index is not None:
        place = recognizer.reference_map.places[index]
        answer |= {'stamp_ns': place.stamp_ns, 'source': place.source}
    return answer


def _in_words(answer: dict[str, Any], pose: PoseEstimate | None) -> str:
    if answer['place'] is None:
        return f'{answer["state"]}: {answer["problem"]}'
    quality = 'not known' if answer['quality'] is None else f'{answer["quality"]:.2f}'
    lines = [f'{answer["state"]}: place {answer["place"]}, quality {quality}']
    if answer['problem']:
        lines[0] += f' ({answer["problem"]})'
    lines.append(f'taken at {answer["stamp_ns"]} ns, from {answer["source"]}')
    if pose is None:
        lines.append('no pose: the map has none; build it with --odom or --poses')
    else:
        lines.append(f'{pose}, in the frame of the map')
    return '\n'.join(lines)


def _draw(path: Path, picture: npt.NDArray[np.uint8]) -> None:
    done, png = cv2.imencode('.png', picture)
    if not done:
        raise ConvseqError(f'{path}: the picture cannot be encoded')
    with complete_or_absent(path) as part:
        data, comment = png.tobytes(), f'tEXtComment\0{MARK}'.encode()
        chunk = struct.pack('>I', len(comment) - 4) + comment
        chunk += struct.pack('>I', zlib.crc32(comment))
        part.write_bytes(data[:_PNG_HEAD] + chunk + data[_PNG_HEAD:])
