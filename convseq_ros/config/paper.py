# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The paper's method as its authors released it, as values of parameters: `config/paper.yaml`."""

from collections.abc import Mapping
from dataclasses import replace

from convseq_ros.config.config import core_parameters
from convseq_ros.config.parameter import Parameter, Value

# What differs from the default.
PAPER: Mapping[str, Value] = {
    'resize': 'linear',
    'matching': 'regional',
    'search': 'exhaustive',
    'sequence_regions': 'newest',
    'acceptance_rule': 'always',
    'stationary_m': 0.0,
    'keyframe_overlap': 1.0,
}
# What the paper varies, at its values.
_VARIED = (
    'image_size_px', 'saliency_threshold', 'fixed_length', 'overlap_threshold',
    'entropy_threshold', 'min_length', 'max_overlap_length', 'max_length',
)  # fmt: skip


def paper_parameters() -> list[Parameter]:
    """Return the parameters that make the paper's method, with its values as defaults."""
    return [
        replace(item, default=PAPER.get(item.name, item.default))
        for item in core_parameters()
        if item.name in (*PAPER, *_VARIED)
    ]
