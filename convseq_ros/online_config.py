# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Parameters of a map that grows as it is used."""

from dataclasses import dataclass

from convseq_ros.parameter import Checked, parameter


# A table of parameters reads better in few lines.
# fmt: off
@dataclass(frozen=True, slots=True)
class OnlineConfig(Checked):
    """Whether the map grows from the robot's own past, and how much of that is too fresh."""

    mode: str = parameter(
        'preloaded', 'preloaded recognises the places of a map; online also adds to it what the '
        'camera sees. A crash loses the last half second.',
        choices=('preloaded', 'online'),
    )
    exclusion_s: float = parameter(
        30.0, 'Places of this drive that are younger than this are not matched.',
        unit='s', low=0.0, high=86400.0,
    )
    exclusion_m: float = parameter(
        0.0, 'With odometry, places of this drive that were passed less than this way ago are '
        'not matched.', unit='m', low=0.0, high=100000.0,
    )
    max_looks: int = parameter(
        8, 'Online mode: how many looks of a place the map keeps. Of more, the one that is most '
        'like another goes; 0 keeps all.', unit='looks', low=0, high=100,
    )

    @property
    def grows(self) -> bool:
        """Whether the map grows."""
        return self.mode != 'preloaded'
