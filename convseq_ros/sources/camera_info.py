# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A camera from a sensor_msgs/CameraInfo, or a file: YAML of ROS, KITTI's calib.txt, a matrix."""

from dataclasses import replace
import math
from pathlib import Path
import re
from types import SimpleNamespace
from typing import Any

from convseq_ros.config.reading_config import AS_YAML, ReadingConfig
from convseq_ros.core.types import are_proportional, Camera, COEFFICIENTS
from convseq_ros.errors import ConfigError, one_line, SourceError
from convseq_ros.io.files import read_text, read_yaml
from convseq_ros.sources.source import Lines

_PROJECTION = 12  # numbers of a 3 x 4 matrix
_COLUMNS = {9: 3, 12: 4, 16: 4}  # by the numbers of a matrix
_BETWEEN = re.compile(r'[][,;]')  # its numbers, but for blanks
# Focal lengths, and distances of the centre, in sides of the image: no lens is beyond.
_SHORTEST, _LONGEST = 1e-3, 1e6
_RIM = 0.1  # share of an image's side; the centre of a lens is not there, but for cut images
# A K of another size moves it from the middle in both directions alike; who cuts, hardly.
_ASIDE, _ALIKE = 0.12, 0.05


def read_camera_file(
    path: Path,
    height: int,
    width: int,
    reading: ReadingConfig = ReadingConfig(),
    warnings: Lines | None = None,
) -> Camera:
    """
    Return the camera that a file describes, for images of a height and width; or SourceError.

    The file is YAML as `camera_calibration` writes it, KITTI's calib.txt, of which the first
    projection is used, or nothing but a matrix of 3 x 3, 3 x 4 or 4 x 4 numbers. `warnings` gets
    the line of `correction`, if there is one.
    """
    text = read_text(path, 'a calibration', reading, AS_YAML)
    try:
        info = _projection(text, height, width) or _matrix(text, height, width)
        info = info or _calibration(path, reading)
        camera = camera_from_info(info)
    except (
        ArithmeticError,
        AttributeError,
        ConfigError,
        LookupError,
        TypeError,
        ValueError,
    ) as why:
        raise SourceError(
            f'{path}: neither a calibration of ROS (YAML), nor a calib.txt of KITTI, nor a 3 x 3 '
            f'matrix ({one_line(why, 80)})'
        ) from None
    if camera is None:
        raise SourceError(f'{path}: the camera is not calibrated: its matrices are zero')
    if warnings is not None and (line := correction(info, camera)):
        warnings.add(f'{path}: {line}')
    return camera


def _projection(text: str, height: int, width: int) -> Any:
    """Return the first line that ends with a 3 x 4 matrix, as a CameraInfo, if there is one."""
    for line in text.splitlines():
        numbers = _numbers(line.rpartition(':')[2])
        if len(numbers) == _PROJECTION:
            return _info(width, height, [0.0] * 9, numbers)
    return None


def _matrix(text: str, height: int, width: int) -> Any:
    """Return the matrix that is all of a text, as a CameraInfo, if it is that of a camera."""
    numbers = _numbers(_BETWEEN.sub(' ', text))
    if len(numbers) not in _COLUMNS:
        return None
    columns = _COLUMNS[len(numbers)]
    k = [numbers[row * columns + column] for row in range(3) for column in range(3)]
    return _info(width, height, k, [0.0] * _PROJECTION) if k[6:] == [0, 0, 1] else None


def _numbers(text: str) -> list[float]:
    """Return the numbers between blanks; none if there is anything else."""
    try:
        return [float(word) for word in text.split()]
    except ValueError:
        return []


def _calibration(path: Path, reading: ReadingConfig) -> Any:
    content = read_yaml(path, reading)
    matrix = [float(value) for value in content['camera_matrix']['data']]
    projection = content.get('projection_matrix', {}).get('data', [0.0] * _PROJECTION)
    size = int(content['image_width']), int(content['image_height'])
    numbers = content.get('distortion_coefficients', {}).get('data', [])
    distortion = str(content.get('distortion_model', '')), [float(value) for value in numbers]
    return _info(*size, matrix, [float(value) for value in projection], *distortion)


def _info(
    width: int, height: int, k: list[float], p: list[float], model: str = '', d: Any = ()
) -> Any:
    if (len(k), len(p)) != (9, _PROJECTION):
        raise ValueError(f'matrices K and P of {len(k)} and {len(p)} numbers; expected 9 and 12')
    part = SimpleNamespace(width=0, height=0, x_offset=0, y_offset=0)
    return SimpleNamespace(
        width=width, height=height, k=k, p=p, roi=part, binning_x=1, binning_y=1,
        distortion_model=model, d=d,
    )  # fmt: skip


_MODELS = {'fisheye': 'equidistant'}  # other names of the same model
_BROWN = 'plumb_bob', 'rational_polynomial'  # the second has the first's numbers and more


def camera_from_info(message: Any) -> Camera | None:
    """Return the camera of a CameraInfo, by P if K is zero; None if it is not calibrated."""
    k, p = [float(value) for value in message.k], [float(value) for value in message.p]
    fx, fy, cx, cy = (k[0], k[4], k[2], k[5]) if any(k) else (p[0], p[5], p[2], p[6])
    width, height = int(message.width), int(message.height)
    if not any((fx, fy, cx, cy)):
        return None
    impossible = SourceError(
        f'camera_info: focal lengths {fx:g}, {fy:g} and size {width} x {height} px are not '
        'those of a camera; calibrate it, or set K to zero'
    )
    if min(width, height) <= 0:
        raise impossible
    model, distortion = ('', ()) if not any(k) else _distortion(message)
    part = message.roi
    if part.width and part.height:
        width, height = int(part.width), int(part.height)
        cx, cy = cx - part.x_offset, cy - part.y_offset
    across, down = message.binning_x or 1, message.binning_y or 1
    width, height = max(1, width // across), max(1, height // down)
    fx, fy, cx, cy = fx / across, fy / down, cx / across, cy / down
    focal, centre = (fx / width, fy / height), (cx / width, cy / height)
    # Also false for NaN.
    if not all(
        [*(_SHORTEST <= f <= _LONGEST for f in focal), *(abs(c) <= _LONGEST for c in centre)]
    ):
        raise impossible
    is_cut = part.width and part.height
    aside = [share - 0.5 for share in centre]
    is_scaled = min(map(abs, aside)) > _ASIDE and abs(aside[0] - aside[1]) < _ALIKE
    if not is_cut and (is_scaled or max(map(abs, aside)) > 0.5 - _RIM):
        raise SourceError(
            f'camera_info: the centre of the lens is at {cx:g}, {cy:g} px of {width} x {height}, '
            'far from the middle: K is of another size, or part of the image is cut off; scale '
            'K, or set roi'
        )
    return Camera(width, height, fx, fy, cx, cy, model, distortion)


def _distortion(message: Any) -> tuple[str, tuple[float, ...]]:
    """Return the model and its coefficients; SourceError if OpenCV could not invert them."""
    model = given = str(getattr(message, 'distortion_model', ''))
    numbers = tuple(float(value) for value in getattr(message, 'd', ()))
    if not any(numbers):
        return '', ()
    model = _MODELS.get(model, model)
    if model in _BROWN:  # some drivers give one's name with the other's numbers
        model = next((name for name in _BROWN if len(numbers) in COEFFICIENTS[name]), model)
    lengths = COEFFICIENTS.get(model, ())
    if len(numbers) not in lengths or not all(map(math.isfinite, numbers)):
        names = ', '.join([*COEFFICIENTS, *_MODELS])
        raise SourceError(
            f'camera_info: distortion {given!r} of {len(numbers)} numbers cannot be taken out; '
            f'give finite numbers of one of {names}, or none'
        )
    return model, numbers


def correction(message: Any, camera: Camera | None) -> str:
    """Return a line if a camera's distortion is not of the model that its message names."""
    named = str(message.distortion_model)
    if not camera or not camera.distortion:
        return ''
    if _MODELS.get(named, named) == camera.distortion_model:
        return ''
    return (
        f'distortion {named!r} of {len(camera.distortion)} numbers is read as '
        f'{camera.distortion_model!r}; mend the name in the calibration'
    )


def misfit(camera: Camera, height: int, width: int) -> str:
    """Return a line if a camera is not of images of a size, in pixels; else nothing."""
    if are_proportional((camera.height_px, camera.width_px), (height, width)):
        return ''
    return (
        f'camera_info is of {camera.width_px} x {camera.height_px} px, and images of {width} x '
        f'{height} px have other proportions: it is left out; give the one of these images'
    )


def fitted(camera: Camera, height: int, width: int) -> Camera | None:
    """
    Return the camera for images of another size: drivers describe the unscaled images.

    None for images of other proportions: a part is cut off, nobody knows which.
    """
    if misfit(camera, height, width):
        return None
    if (camera.height_px, camera.width_px) == (height, width):
        return camera
    across, down = width / camera.width_px, height / camera.height_px
    return replace(
        camera,
        width_px=width,
        height_px=height,
        fx_px=camera.fx_px * across,
        fy_px=camera.fy_px * down,
        cx_px=camera.cx_px * across,
        cy_px=camera.cy_px * down,
    )
