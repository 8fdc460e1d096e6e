# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The parameters of localisation, a group of `config.Config`."""

from dataclasses import dataclass

from convseq_ros.parameter import Checked, parameter


# A table of parameters reads better in few lines.
# fmt: off
@dataclass(frozen=True, slots=True)
class LocalizationConfig(Checked):
    """When it is known where in a map the robot is, and when no longer."""

    localize_keyframes: int = parameter(
        2, 'The robot is localised when so many matches, one after another, agree on where it is: '
        'accepted ones, or nearly.', unit='keyframes', low=1, high=100,
    )
    lost_keyframes: int = parameter(
        4, 'The robot is lost when so many keyframes show another place than where it was '
        'localised, and no good match of that comes between them.',
        unit='keyframes', low=1, high=100,
    )
