# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The parameters that limit the size of input; written once, as in `config`."""

import argparse
from dataclasses import dataclass
import math
from pathlib import Path

from convseq_ros.config.parameter import add_parameters, Checked, given, parameter, parameters
from convseq_ros.errors import ImageError, SourceError

# Cost of a byte of a file, relative to a byte of an array: text takes several bytes in Python,
# and YAML takes long: 0.1 MB a second, with rosbags' reader 0.06 MB.
AS_ARRAY, AS_TEXT, AS_YAML = 1, 8, 1024
_MEGA = 1_000_000
_RATIO = 1000  # inflated to packed; images have 3, drawn ones 50, zeros 30,000


# fmt: off
@dataclass(frozen=True, slots=True)
class ReadingConfig(Checked):
    """Limits above which input is not decoded, whatever its source."""

    max_image_mpx: float = parameter(
        64.0, 'Images that declare more pixels are refused before they are decoded.',
        unit='Mpx', low=0.01, high=1000.0, dynamic=True,
    )
    max_file_mb: float = parameter(
        256.0, 'Files, and chunks of recordings, that declare more data are refused before they '
        'are read; text counts 8 times, YAML 1024 times.',
        unit='MB', low=0.001, high=1_000_000.0, dynamic=True,
    )

    def above(self, name: str, size: float, what: str) -> str:
        """Return a line with the remedy if a size is above parameter `name`; otherwise empty."""
        limit = getattr(self, name)
        if size <= limit:
            return ''
        item = next(item for item in parameters(self) if item.name == name)
        needed = f'{math.ceil(size * 100) / 100:.2f}'.rstrip('0').rstrip('.')
        allowed = item.high is None or float(needed) <= item.high
        remedy = f'set {name} to {needed}' if allowed else f'{name} goes to {item.high:g}'
        return f'{what} is more than {name}, {limit:g}; make it smaller, or {remedy}'

    def refuse_above(self, name: str, size: float, what: str) -> None:
        """Raise a SourceError, with the remedy, if a size is above parameter `name`."""
        if line := self.above(name, size, what):
            raise SourceError(line)

    def refuse_image(self, pixels: int, what: str) -> None:
        """Raise an ImageError if an image has too many pixels to be decoded."""
        if line := self.above('max_image_mpx', pixels / _MEGA, what):
            raise ImageError(line)

    def refuse_file(self, path: Path, size_bytes: int, cost: int = AS_ARRAY) -> None:
        """Raise a SourceError if a file, or the content it declares, is too large to be read."""
        counts = f', which count {cost}-fold,' if cost > 1 else ''
        size_mb = size_bytes / _MEGA
        self.refuse_above('max_file_mb', size_mb * cost, f'{path}: {size_mb:.3g} MB{counts}')


    @property
    def most_bytes(self) -> int:
        """Maximum size in bytes of one chunk, or one message, of a recording."""
        # rosbag2 fills chunks up to 768 KiB, Foxglove's tools up to 4 MiB. The last message of a
        # chunk may exceed that: at most an image of 64 Mpx with four bytes a pixel.
        return round(self.max_file_mb * _MEGA)

    def refuse_bomb(self, where: object, inflated: int, size: int) -> None:
        """Raise a SourceError if inflated bytes are out of proportion to a file's size."""
        if inflated > _RATIO * size:
            what = f'its {size} bytes inflate to {inflated / 1e9:.3g} GB, which no recording does'
            self.refuse_above('max_file_mb', inflated / 4 / _MEGA, f'{where}: {what}; a fourth')


# fmt: on


def add_reading(parser: argparse.ArgumentParser) -> None:
    """Add an option for every limit of input."""
    add_parameters(parser, 'what is too large', parameters(ReadingConfig))


def chosen_reading(chosen: argparse.Namespace) -> ReadingConfig:
    """Return the limits that were given as options."""
    return ReadingConfig(**given(chosen, parameters(ReadingConfig)))  # type: ignore[arg-type]
