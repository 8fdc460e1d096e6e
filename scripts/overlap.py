# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Print the overlap of frames of a drawn street, by distance and light.

Usage: python scripts/overlap.py, a few seconds. The parameter `keyframe_overlap` is a limit for
this overlap: the share of a frame's salient regions that moved together since an earlier frame.
The figures are medians over a street of 60 m.
"""

from typing import Any

from convseq_ros.config import EncodingConfig
from convseq_ros.core.encoding.descriptor import describe
from convseq_ros.core.gate.near_duplicate import Overlap
from convseq_ros.simulation.street import Street
from drives import head, row, shots
import numpy as np

STREET, STEP_M = 903, 0.25
APART = 1, 2, 5, 8, 12, 20  # frames
DRIVES: dict[str, dict[str, Any]] = {
    'by day': {'seed': 1810},
    'evening, 0.7 m to the side': {'seed': 1811, 'light': 'evening', 'lane_offset_m': -0.8},
}


def main() -> None:
    """Measure and print."""
    overlap = Overlap(EncodingConfig().saliency_threshold)
    head('metres on', *(f'{STEP_M * steps:g}' for steps in APART))
    for name, how in DRIVES.items():
        drawn = shots(Street(61.0, STREET), num_frames=240, frame_rate_hz=10 / STEP_M, **how)
        shown = [describe(frame.gray) for _, frame in drawn if frame.gray is not None]
        pairs = [[(shown[at], shown[at + gap]) for at in range(0, 200, 20)] for gap in APART]
        shares = [np.median([overlap(new, old) for old, new in samples]) for samples in pairs]
        row(name, *(f'{share:.2f}' for share in shares))


if __name__ == '__main__':
    main()
