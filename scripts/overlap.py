# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Print how much frames of a drawn street overlap, by how far apart they are and in which light.

Usage: python scripts/overlap.py, some seconds. The overlap is what
`keyframe_overlap` is compared with: the share of a frame's salient regions that moved together
since an earlier frame. Medians over a street of 60 m.
"""

from convseq_ros.config import EncodingConfig
from convseq_ros.core.encoding.descriptor import describe
from convseq_ros.core.similarity.overlap import Overlap
from convseq_ros.simulation.drive import draw, Drive
from convseq_ros.simulation.street import Street
import numpy as np

STREET, STEP_M = 903, 0.25
APART = 1, 2, 5, 8, 12, 20  # frames
DRIVES = {
    'by day': {'seed': 1810},
    'evening, .7 m to the side': {'seed': 1811, 'light': 'evening', 'lane_offset_m': -0.8},
}


def main() -> None:
    """Measure and print."""
    overlap = Overlap(EncodingConfig().saliency_threshold)
    print('| metres on |', ' | '.join(f'{STEP_M * one:g}' for one in APART), '|')
    print('|---|' + '---|' * len(APART))
    for name, how in DRIVES.items():
        size = {'num_frames': 240, 'width_px': 320, 'height_px': 240}
        drive = Drive(frame_rate_hz=10 / STEP_M, **size, **how)
        shown = [describe(shot.frame.gray) for shot in draw(Street(61.0, STREET), drive)]
        pairs = [[(shown[at], shown[at + one]) for at in range(0, 200, 20)] for one in APART]
        shares = [np.median([overlap(new, old) for old, new in some]) for some in pairs]
        print(f'| {name} |', ' | '.join(f'{one:.2f}' for one in shares), '|')


if __name__ == '__main__':
    main()
