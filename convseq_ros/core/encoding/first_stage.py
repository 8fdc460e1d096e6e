# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
The first stage: from an image to the one vector by which places are found.

The global descriptor of the cells is built in. Any callable from an image to a vector may take its
place, such as a network; all that follows goes on as before.
"""

from collections.abc import Sequence
from dataclasses import replace
import time
from typing import Protocol

from convseq_ros.config import Config, EncodingConfig
from convseq_ros.core.encoding.descriptor import cell_shape, seen_cells
from convseq_ros.core.encoding.regions import global_descriptor, global_descriptor_length, unit
from convseq_ros.core.types import Descriptor, Frame
from convseq_ros.errors import ConfigError, ModelError
import cv2
import numpy as np
import numpy.typing as npt

HIDDEN = 128  # grey level, in all colours, of what a mask hides from a model
_SHOWN = 13  # characters of an identity; a SHA-256 has 64
_UNSAID = 'descriptor_model: the map has descriptors of a model; set it to the model, or give its '
_UNSAID += 'function as `describe`'


class Describe(Protocol):
    """
    From an image, uint8 (H, W) or (H, W, 3) in the order blue, green, red, to a vector (n,).

    It may have `identity`, a text that tells it from all others (by default its name), and
    `wants_color`: if that is true, it gets frames in colour where they have it. A function
    `batch`, if it has one, gets several images and returns as many vectors, the same as alone.
    """

    def __call__(self, image: npt.NDArray[np.uint8], /) -> npt.ArrayLike:
        """Return the vector; always as many numbers, all finite."""


def vector_of(descriptor: Descriptor) -> npt.NDArray[np.float16]:
    """Return the vector (n,) by which a frame is looked up: the model's, or that of its cells."""
    own = descriptor.vector
    return global_descriptor(descriptor.cells) if own is None else own


def vector_length(encoding: EncodingConfig) -> int:
    """Return how many numbers vectors have; 0 if a model decides."""
    if encoding.descriptor_model:
        return 0
    return global_descriptor_length(cell_shape(encoding.image_size_px))


def identity_of(describe: Describe) -> str:
    """Return how a map names what made its vectors; empty for what is built in."""
    usual = getattr(describe, '__qualname__', type(describe).__qualname__)
    own = str(getattr(describe, 'identity', usual))
    return own and f'#{own}'


def model_name(identity: str) -> str:
    """Return a model as people are told of it."""
    return f'descriptor_model {identity[:_SHOWN]}' if identity else 'the built-in descriptor'


def wants_color(describe: Describe) -> bool:
    """Return whether it is given images in colour, where there are some."""
    return bool(getattr(describe, 'wants_color', False))


def checked_vector(answer: npt.ArrayLike, numbers: int, whose: object) -> npt.NDArray[np.float32]:
    """
    Return what a model answered as a vector (n,).

    ModelError if it is empty, not finite, or has other than so many numbers; 0 for any.
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
    """
    Return a configuration as maps keep it: with the identity of the model, not its path.

    Images are read in colour if the model wants it, and `matching: descriptor` keeps neither cells
    nor thumbnails.
    """
    keyframes, encoding, reading = config.keyframes, config.encoding, config.reading
    keeps_cells = config.matching.matching != 'descriptor'
    encoding = replace(encoding, keeps_cells=keeps_cells)
    if not keeps_cells:
        keyframes = replace(keyframes, thumbnail_width_px=0)
    if describe:
        encoding = replace(encoding, descriptor_model=identity_of(describe))
        reading = replace(reading, keeps_color=wants_color(describe))
    return replace(config, keyframes=keyframes, encoding=encoding, reading=reading)


class FirstStage:
    """
    Adds a model's vector to what else is known of a frame; nothing if there is no model.

    `numbers` are those of the map's vectors, 0 if there is none yet. `duration_ms` is how long the
    newest vector took, its share if it was made in a batch, 0 before there is one. `batch` makes
    vectors of several images at once, None if the model cannot. ConfigError if the encoding names
    a model, and the one that is there, if any, is another.
    """

    def __init__(
        self, describe: Describe | None, encoding: EncodingConfig, numbers: int = 0
    ) -> None:
        self._describe, self._encoding, self.duration_ms = describe, encoding, 0.0
        self._numbers = numbers  # of a vector, once one is known
        self.batch = getattr(describe, 'batch', None)
        asked, own = encoding.descriptor_model, identity_of(describe) if describe else ''
        if asked and not asked.startswith('#'):
            raise ConfigError(f'descriptor_model: {asked} is a file; open it, and give `describe`')
        if describe and own != asked:
            own, asked = model_name(own), model_name(asked)
            raise ConfigError(f'describe: is {own}, the map is of {asked}; build the map again')

    def add(self, frame: Frame, descriptor: Descriptor) -> Descriptor:
        """Return what `add_all` does, for one frame."""
        return self.add_all([(frame, descriptor)])[0]

    def add_all(self, seen: Sequence[tuple[Frame, Descriptor]]) -> list[Descriptor]:
        """
        Return what frames show, with their vectors; those of several are made in one batch.

        ModelError if a vector of the model is empty, not finite, or of another length than before.
        """
        images: dict[int, npt.NDArray[np.uint8]] = {}
        if self._encoding.descriptor_model:
            for index, (frame, descriptor) in enumerate(seen):
                if frame.gray is not None and descriptor.vector is None:
                    images[index] = self._image(frame)
        done = [descriptor for _, descriptor in seen]
        for index, vector in zip(images, self._vectors([*images.values()]), strict=True):
            done[index] = replace(done[index], vector=unit(vector).astype(np.float16))
        return done

    def _vectors(self, images: list[npt.NDArray[np.uint8]]) -> list[npt.NDArray[np.float32]]:
        if not images:
            return []
        if self._describe is None:
            raise ConfigError(_UNSAID)
        started = time.perf_counter()
        if self.batch and len(images) > 1:
            answers = self.batch(images)
        else:
            answers = [self._describe(image) for image in images]
        self.duration_ms = (time.perf_counter() - started) * 1e3 / len(images)
        vectors = []
        for answer in answers:
            vectors.append(checked_vector(answer, self._numbers, 'descriptor_model'))
            self._numbers = len(vectors[-1])
        return vectors

    def _image(self, frame: Frame) -> npt.NDArray[np.uint8]:
        """Return what the model gets of a frame that has an image; hidden cells are flat."""
        image = frame.gray
        if frame.color is not None and self._describe and wants_color(self._describe):
            image = frame.color
        assert image is not None
        if not (mask := self._encoding.image_mask):
            return image
        seen = seen_cells(mask, cell_shape(self._encoding.image_size_px)[0]).astype(np.uint8)
        size = image.shape[1], image.shape[0]
        hidden = cv2.resize(seen, size, interpolation=cv2.INTER_NEAREST) == 0
        image = image.copy()
        image[hidden] = HIDDEN
        return image
