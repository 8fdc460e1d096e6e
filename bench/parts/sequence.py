# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The sequence stage: sums of pair scores along diagonals."""

from convseq_ros.core.sequence.diagonals import sequence_scores
import numpy as np

from bench.finding import at_most, Finding
from bench.work import Work

_LENGTH, _REFERENCES, _ENDS = 25, 1000, 50


def measure(work: Work) -> list[Finding]:
    """Measure sequences of 25 frames that may end anywhere, and those of a shortlist."""
    rng = np.random.default_rng(0)
    rows = list(rng.random((_LENGTH, _REFERENCES), np.float32))
    ends = np.sort(rng.choice(_REFERENCES, _ENDS, replace=False))
    times = work.in_turn(
        {
            f'all {_REFERENCES} ends': lambda: sequence_scores(rows),
            f'{_ENDS} ends': lambda: sequence_scores(rows, ends=ends),
        },
        2,
    )
    what = f'sequence stage, k = {_LENGTH}, R = {_REFERENCES:,}'
    return [
        Finding(what=what, side=name).timed(found).aiming(at_most(found.median, 0.2, 'ms'))
        for name, found in times.items()
    ]
