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
        'camera sees; lifelong adds what the map does not know yet, 32 places later, and counts '
        'which of its places are answers. What is added is in the file half a second later: a '
        'crash loses that, and in lifelong mode up to 32 places that wait, however long.',
        choices=('preloaded', 'online', 'lifelong'),
    )
    exclusion_s: float = parameter(
        30.0, 'Online mode: places of this session younger than this are not matched.',
        unit='s', low=0.0, high=86400.0,
    )
    exclusion_m: float = parameter(
        0.0, 'Online mode with odometry: places of this session that were passed less than this '
        'way ago are not matched.', unit='m', low=0.0, high=100000.0,
    )
    max_places_per_m: float = parameter(
        0.0, 'Lifelong mode, when the map is opened: of more places a metre of way than this, '
        'looks of known places that were no answer for longest are left out; 0 has no limit.',
        unit='places/m', low=0.0, high=10000.0,
    )
    max_map_mb: float = parameter(
        0.0, 'Lifelong mode: at this size of its file the map grows no more, and when it is '
        'opened, looks of known places that were no answer for longest are left out of it, down '
        'to nine tenths; 0 has no limit.', unit='MB', low=0.0, high=1e9,
    )

    @property
    def grows(self) -> bool:
        """Whether the map grows."""
        return self.mode != 'preloaded'
