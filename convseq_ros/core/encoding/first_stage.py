# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
The first stage: from an image to the vector by which likely places are looked up.

The built-in vector is the global descriptor of the cells. A descriptor model, any callable from an
image to a vector, may replace it, for example a network; all later stages stay the same, and
cells decide.
"""

from dataclasses import replace
import time
from typing import Protocol

from convseq_ros.config import Config, EncodingConfig
from convseq_ros.core.encoding.descriptor import cell_shape, visible_cells
from convseq_ros.core.encoding.regions import global_descriptor, global_descriptor_length, unit
from convseq_ros.core.types import Descriptor, Frame
from convseq_ros.errors import ConfigError, ModelError
import cv2
import numpy as np
import numpy.typing as npt

HIDDEN = 128  # grey level of pixels that a mask hides from a model
_SHOWN = 13  # characters of an identity that are printed; a SHA-256 has 64
_UNSAID = 'descriptor_model: the map has descriptors of a model; set it to the model, or give its '
_UNSAID += 'function as `describe`'


class Describe(Protocol):
    """
    A descriptor model: from a grey image, uint8 (H, W), to a vector (n,).

    It may have `identity`, a text that distinguishes it from other models (by default its name).
    """

    def __call__(self, image: npt.NDArray[np.uint8], /) -> npt.ArrayLike:
        """Return the vector, always of the same length, with finite numbers."""


def vector_of(descriptor: Descriptor) -> npt.NDArray[np.float16]:
    """Return the vector (n,) by which a frame is looked up: the model's, or that of its cells."""
    vector = descriptor.vector
    return global_descriptor(descriptor.cells) if vector is None else vector


def vector_length(encoding: EncodingConfig) -> int:
    """Return the length of vectors; 0 if a model decides it."""
    if encoding.descriptor_model:
        return 0
    return global_descriptor_length(cell_shape(encoding.image_size_px))


def identity_of(describe: Describe) -> str:
    """Return a model's identity as maps store it; empty for the built-in descriptor."""
    name = getattr(describe, '__qualname__', type(describe).__qualname__)
    identity = str(getattr(describe, 'identity', name))
    return identity and f'#{identity}'


def model_name(identity: str) -> str:
    """Return a model's name for messages."""
    return f'descriptor_model {identity[:_SHOWN]}' if identity else 'the built-in descriptor'


def checked_vector(answer: npt.ArrayLike, numbers: int, whose: object) -> npt.NDArray[np.float32]:
    """
    Return a model's answer as a vector (n,).

    ModelError if it is empty, not finite, or not of length `numbers`; 0 accepts any length.
    """
    vector = np.asarray(answer, np.float32).ravel()
    if not len(vector) or not np.isfinite(vector).all():
        raise ModelError(f'{whose}: its vector holds NaN, or nothing; check its scale')
    if numbers and len(vector) != numbers:
        raise ModelError(
            f'{whose}: its vector has {len(vector)} numbers, expected {numbers}, as '
            'others; make it of one size'
        )
    return vector


def with_first_stage(config: Config, describe: Describe | None) -> Config:
    """Return a configuration as maps store it: with the identity of the model, not its path."""
    if not describe:
        return config
    encoding = replace(config.encoding, descriptor_model=identity_of(describe))
    return replace(config, encoding=encoding)


class FirstStage:
    """
    Adds a model's vector to the descriptors of frames; without a model it adds nothing.

    `numbers` is the length of the map's vectors, 0 for an empty map. `duration_ms` is the time of
    the newest vector, 0 before the first. Raises ConfigError if `describe` is not the model that
    the encoding names.
    """

    def __init__(
        self, describe: Describe | None, encoding: EncodingConfig, numbers: int = 0
    ) -> None:
        self._describe, self._encoding, self.duration_ms = describe, encoding, 0.0
        self._numbers = numbers  # length of vectors, once it is known
        named, given = encoding.descriptor_model, identity_of(describe) if describe else ''
        if named and not named.startswith('#'):
            raise ConfigError(f'descriptor_model: {named} is a file; open it, and give `describe`')
        if describe and given != named:
            names = f'{model_name(given)}, the map is of {model_name(named)}'
            raise ConfigError(f'describe: is {names}; build the map again')

    def add(self, frame: Frame, descriptor: Descriptor) -> Descriptor:
        """
        Return a frame's descriptor with its vector.

        ModelError if the vector is empty, not finite, of a different length than before, or all
        zeros although the image shows something.
        """
        if not self._encoding.descriptor_model or frame.gray is None:
            return descriptor
        if descriptor.vector is not None:
            return descriptor
        if self._describe is None:
            raise ConfigError(_UNSAID)
        image, started = self._image(frame), time.perf_counter()
        answer = self._describe(image)
        self.duration_ms = (time.perf_counter() - started) * 1e3
        vector = checked_vector(answer, self._numbers, 'descriptor_model')
        if not vector.any() and image.min() < image.max():
            raise ModelError('descriptor_model: its vector is all zeros; check its output')
        self._numbers = len(vector)
        vector = unit(vector.astype(np.float64))  # squares of float32 are no float32
        return replace(descriptor, vector=vector.astype(np.float16))

    def _image(self, frame: Frame) -> npt.NDArray[np.uint8]:
        """Return the frame's image for the model; masked cells are grey."""
        image = frame.gray
        assert image is not None
        if not (mask := self._encoding.image_mask):
            return image
        visible = visible_cells(mask, cell_shape(self._encoding.image_size_px)[0]).astype(np.uint8)
        size = image.shape[1], image.shape[0]
        hidden = cv2.resize(visible, size, interpolation=cv2.INTER_NEAREST) == 0
        image = image.copy()
        image[hidden] = HIDDEN
        return image
