# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The parameters of the sequence length; written once, as in `config`."""

from dataclasses import dataclass

from convseq_ros.config.parameter import Checked, parameter
from convseq_ros.errors import ConfigError


# fmt: off
@dataclass(frozen=True, slots=True)
class SequenceConfig(Checked):
    """How many frames are matched together (paper III-A, E, F)."""

    fixed_length: int = parameter(
        0, 'Frames of every sequence; 0 chooses the length for each frame, as in the paper.',
        unit='frames', low=0, high=100, dynamic=True,
    )
    overlap_threshold: float = parameter(
        0.9, 'A sequence grows while its oldest and newest frame are at least this similar; IT in '
        'the paper.', low=0.0, high=1.0, dynamic=True,
    )
    entropy_threshold: float = parameter(
        0.5, 'A sequence grows up to this mean entropy, a fraction of 8 bits (ET in the paper); '
        'belief gives frames below it less weight.',
        low=0.0, high=1.0, dynamic=True,
    )
    min_length: int = parameter(
        2, 'Frames of the shortest sequence that is chosen; 1 in the paper.',
        unit='frames', low=1, high=100, dynamic=True,
    )
    max_overlap_length: int = parameter(
        15, 'Frames up to which similarity alone makes a sequence grow.',
        unit='frames', low=2, high=100, dynamic=True,
    )
    max_length: int = parameter(
        25, 'Frames of the longest sequence that is chosen.',
        unit='frames', low=2, high=100, dynamic=True,
    )
    sequence_regions: str = parameter(
        'own', 'Salient regions of a sequence: own are those of each frame, as the paper says, '
        'newest those of the newest, as its authors released it.',
        choices=('own', 'newest'),
    )

    def __post_init__(self) -> None:
        Checked.__post_init__(self)
        if self.min_length > self.max_length:
            raise ConfigError(
                f'min_length: {self.min_length} is above max_length, {self.max_length}'
            )

    @property
    def window(self) -> int:
        """How many frames are kept: those of the longest sequence, and the one before any."""
        return max(2, self.fixed_length or self.max_length)
