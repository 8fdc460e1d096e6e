# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A camera from a file: a calibration of ROS, or KITTI's calib.txt."""

from pathlib import Path
from types import SimpleNamespace
from typing import Any

from convseq_ros.core.types import Camera
from convseq_ros.errors import ConfigError, SourceError
from convseq_ros.files import read_text, read_yaml
from convseq_ros.reading_config import AS_YAML, ReadingConfig
from convseq_ros.sources.camera_info import camera_from_info

_PROJECTION = 12  # numbers of a 3 x 4 matrix


def read_camera_file(
    path: Path, height: int, width: int, reading: ReadingConfig = ReadingConfig()
) -> Camera:
    """
    Return the camera that a file describes.

    It is YAML as `camera_calibration` writes it (image_width, camera_matrix, ...), or lines of
    KITTI's calib.txt, of which the first projection counts; that does not say how many pixels,
    height and width, the images have. SourceError if the file cannot be read, is neither, or its
    camera is not calibrated.
    """
    text = read_text(path, 'a calibration', reading, AS_YAML)
    try:
        camera = camera_from_info(_projection(text, height, width) or _calibration(path, reading))
    except (
        ArithmeticError,
        AttributeError,
        ConfigError,
        LookupError,
        TypeError,
        ValueError,
    ) as error:
        reason = ' '.join(str(error).split())[:80]
        raise SourceError(
            f'{path}: neither a calibration of ROS (YAML) nor a calib.txt of KITTI ({reason})'
        ) from None
    if camera is None:
        raise SourceError(f'{path}: the camera is not calibrated: its matrices are zero')
    return camera


def _projection(text: str, height: int, width: int) -> Any:
    """Return the first line that ends with a 3 x 4 matrix, as a CameraInfo, if there is one."""
    for line in text.splitlines():
        words = line.rpartition(':')[2].split()
        if len(words) == _PROJECTION:
            return _info(width, height, [0.0] * 9, [float(word) for word in words])
    return None


def _calibration(path: Path, reading: ReadingConfig) -> Any:
    said = read_yaml(path, reading)
    matrix = [float(value) for value in said['camera_matrix']['data']]
    projection = said.get('projection_matrix', {}).get('data', [0.0] * _PROJECTION)
    size = int(said['image_width']), int(said['image_height'])
    numbers = said.get('distortion_coefficients', {}).get('data', [])
    distortion = str(said.get('distortion_model', '')), [float(value) for value in numbers]
    return _info(*size, matrix, [float(value) for value in projection], *distortion)


def _info(
    width: int, height: int, k: list[float], p: list[float], model: str = '', d: Any = ()
) -> Any:
    if (len(k), len(p)) != (9, _PROJECTION):
        raise ValueError(f'matrices of {len(k)} and {len(p)} numbers')
    part = SimpleNamespace(width=0, height=0, x_offset=0, y_offset=0)
    return SimpleNamespace(
        width=width, height=height, k=k, p=p, roi=part, binning_x=1, binning_y=1,
        distortion_model=model, d=d,
    )  # fmt: skip
