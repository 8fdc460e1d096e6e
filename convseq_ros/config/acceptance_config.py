# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The parameters of acceptance; written once, as in `config`."""

from dataclasses import dataclass

from convseq_ros.config.parameter import Checked, parameter


# fmt: off
@dataclass(frozen=True, slots=True)
class AcceptanceConfig(Checked):
    """When the best candidate is published as a match."""

    acceptance_rule: str = parameter(
        'auto', 'belief asks for a probability after all frames so far, margin for a lead over '
        'the best rival, always accepts the best candidate, as in the paper; auto is belief with '
        'coherent matching, else margin.',
        choices=('auto', 'belief', 'margin', 'always'),
    )
    min_confidence: float = parameter(
        0.9, 'Least probability of a match, by the belief rule.', low=0.0, high=1.0, dynamic=True,
    )
    min_margin: float = parameter(
        0.003, 'Least lead of a score over that of the best rival, by the margin rule.',
        low=0.0, high=1.0, dynamic=True,
    )
    rival_distance: int = parameter(
        10, 'The candidates of an answer are further apart than this; by the margin rule, the '
        'second is the rival.',
        unit='places', low=0, high=10000, dynamic=True,
    )
    num_candidates: int = 5  # per result; no two are closer than rival_distance
    closure_interval_s: float = parameter(
        0.0, 'Least time between two accepted matches.',
        unit='s', low=0.0, high=3600.0, dynamic=True,
    )
