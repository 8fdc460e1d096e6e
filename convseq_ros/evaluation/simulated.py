# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A drawn drive in place of a folder of images, named by a few numbers."""

from collections.abc import Iterator, Mapping
from dataclasses import asdict, dataclass, fields
from functools import lru_cache
from pathlib import Path
from typing import Any

from convseq_ros.core.types import Frame
from convseq_ros.errors import ConfigError, ConvseqError
from convseq_ros.parameter import refuse_unknown
from convseq_ros.simulation.drive import draw, Drive
from convseq_ros.simulation.street import Street

_NUMBERS = {item.name: item.type for item in fields(Drive) if item.type in (int, float)}
_KNOWN = ('street', 'light', *_NUMBERS)


@dataclass(frozen=True, slots=True)
class SimulatedDrive:
    """Images that are drawn when they are first read; the same every time."""

    street: int  # seed of the street, which is as long as the drive
    drive: Drive

    def __iter__(self) -> Iterator[Frame]:
        return iter(_drawn(self))

    @property
    def content(self) -> dict[str, Any]:
        """What determines these images."""
        return {'street': self.street, **asdict(self.drive)}


@lru_cache(maxsize=2)
def _drawn(simulated: SimulatedDrive) -> tuple[Frame, ...]:
    """Return all frames: a drive is read for each method, and drawing takes longer than that."""
    drive = simulated.drive
    furthest_m = max(drive.start_m, drive.distance_m(drive.num_frames))
    street = Street(furthest_m + 1.0, simulated.street)
    return tuple(shot.frame for shot in draw(street, drive))


def read_simulated(said: Mapping[str, Any], path: Path) -> SimulatedDrive:
    """Return the drive that `street` and fields of `Drive` describe; ConfigError if none."""
    try:
        refuse_unknown(said, _KNOWN)
        values = {name: _value(name, value) for name, value in said.items()}
        street = int(values.pop('street', 0))
        Street(1.0, street)
        return SimulatedDrive(street, Drive(**values))
    except ConvseqError as error:
        raise ConfigError(f'{path}: simulated: {error}') from None


def _value(name: str, value: Any) -> Any:
    if name == 'light':
        return str(value)
    kind = _NUMBERS.get(name, int)
    fitting = isinstance(value, int | float) and not isinstance(value, bool)
    if not fitting or kind(value) != value:
        raise ConfigError(f'{name}: {value!r} is not a number of the right kind')
    return kind(value)
