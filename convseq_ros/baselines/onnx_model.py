# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""One global descriptor per image from an ONNX model, run by the optional onnxruntime."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from convseq_ros.errors import pip_install, SourceError
import cv2
import numpy as np
import numpy.typing as npt

IMAGENET_MEAN = (0.485, 0.456, 0.406)
IMAGENET_STD = (0.229, 0.224, 0.225)
_CHANNELS = (1, 3)


class OnnxModel:
    """
    A network that turns an image into a descriptor.

    Parameters
    ----------
    path : Path
        The model; one float32 input (1, C, H, W) with 1 or 3 channels, and its first output, of
        any shape, is the descriptor.
    size : tuple of 2 ints, optional
        Height and width to resize to, for a model that takes any.
    mean, std : sequence of 1 or 3 floats
        Of its training images, in [0, 1]; ImageNet's by default.

    Raises
    ------
    SourceError
        If onnxruntime is missing, the model cannot be read, or takes something else.

    Notes
    -----
    Images are grey here, as everywhere in this package; a model for colour images is given the
    grey one in all three channels.

    """

    def __init__(
        self,
        path: Path,
        size: tuple[int, int] | None = None,
        mean: Sequence[float] = IMAGENET_MEAN,
        std: Sequence[float] = IMAGENET_STD,
    ) -> None:
        try:
            import onnxruntime
        except ImportError:
            raise SourceError(f'{path}: needs onnxruntime; {pip_install("onnxruntime")}') from None
        if not path.is_file():
            raise SourceError(f'{path}: no such file; check the path of the model')
        options = onnxruntime.SessionOptions()
        options.log_severity_level = 4
        try:
            self._session: Any = onnxruntime.InferenceSession(
                str(path), options, providers=['CPUExecutionProvider']
            )
        except Exception as error:
            raise SourceError(f'{path}: not a readable ONNX model ({_one_line(error)})') from None
        self._path = path
        inputs = self._session.get_inputs()
        shape = inputs[0].shape if inputs else []
        fitting = len(inputs) == 1 and len(shape) == 4 and inputs[0].type == 'tensor(float)'
        if not fitting or (isinstance(shape[1], int) and shape[1] not in _CHANNELS):
            found = '; '.join(f'{item.name} {item.type} {item.shape}' for item in inputs)
            raise SourceError(
                f'{path}: its input is {found or "missing"}; expected one float tensor of '
                'shape (1, 1 or 3, height, width)'
            )
        self._input = inputs[0].name
        self._channels = shape[1] if isinstance(shape[1], int) else 3
        self._size = self._fitting_size(shape[2:], size)
        self._mean, self._std = self._per_channel(mean), self._per_channel(std)

    def describe(self, gray: npt.NDArray[np.uint8]) -> npt.NDArray[np.float32]:
        """
        Return the descriptor of a grey image (H, W), float32 of shape (D,).

        Raises
        ------
        SourceError
            If the model fails on it or its answer is not finite.

        """
        height, width = self._size
        small = cv2.resize(gray, (width, height), interpolation=cv2.INTER_AREA) / 255.0
        image = (small[None] - self._mean) / self._std
        try:
            answer = self._session.run(None, {self._input: image[None].astype(np.float32)})[0]
        except Exception as error:
            raise SourceError(
                f'{self._path}: the model fails on an image of {height} x {width} '
                f'({_one_line(error)}); give it another size'
            ) from None
        descriptor = np.asarray(answer, np.float32).ravel()
        if not np.isfinite(descriptor).all():
            raise SourceError(f'{self._path}: its answer holds NaN; check mean and std')
        return descriptor

    def _fitting_size(
        self, wanted: Sequence[Any], size: tuple[int, int] | None
    ) -> tuple[int, int]:
        fixed = [side if isinstance(side, int) and side > 0 else None for side in wanted]
        if size is None and None in fixed:
            raise SourceError(f'{self._path}: takes images of any size; add size=HEIGHTxWIDTH')
        chosen = size or (fixed[0] or 0, fixed[1] or 0)
        if any(side and side != own for side, own in zip(fixed, chosen, strict=True)):
            raise SourceError(
                f'{self._path}: takes images of {fixed[0]} x {fixed[1]}, not of '
                f'{chosen[0]} x {chosen[1]}; leave the size out'
            )
        return chosen

    def _per_channel(self, values: Sequence[float]) -> npt.NDArray[np.float64]:
        if len(values) not in (1, self._channels):
            if self._channels == 1:
                return np.array([np.mean(values)]).reshape(1, 1, 1)
            raise SourceError(
                f'{self._path}: {len(values)} values of mean or std for {self._channels} '
                'channels; give one for each'
            )
        return np.broadcast_to(np.array(values, np.float64), self._channels).reshape(-1, 1, 1)


def _one_line(error: Exception) -> str:
    return ' '.join(str(error).split())[:200]
