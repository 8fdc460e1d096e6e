# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""How soon a node that is started answers."""

from pathlib import Path
import time

import numpy as np

from bench.finding import at_most, Finding
from bench.parts.node import largest_map, running_node, without_ros
from bench.work import Work

_RATE_HZ = 30
_STARTS = 7
_MOST_S = 1.5


def measure(work: Work) -> list[Finding]:
    """Start the node again and again, before a camera that is on."""
    size = largest_map(work)
    what = f'node, map of R = {size:,}, 640 x 480 raw, {_RATE_HZ} Hz'
    if no_ros := without_ros(work, what):
        return no_ros
    from bench.probe import isolate, Probe

    isolate(Path(work.folder))
    probe = Probe(work.images)
    found_s = []
    try:
        for _ in range(1 if work.quick else _STARTS):
            start_s = time.perf_counter()
            with running_node(work, work.map_path(size)):
                found_s.append(probe.first_answer_s(_RATE_HZ, start_s))
    finally:
        probe.close()
    least, median, most = (float(one) for one in np.percentile(found_s, (0, 50, 100)))
    finding = Finding(
        what=what,
        side='start to first answer',
        threads=work.threads,
        value=median,
        unit='s',
        low=least,
        high=most,
        runs=len(found_s),
        note=f'{least:.2f} to {most:.2f} s, {len(found_s)} starts',
    )
    return [finding.aiming(at_most(median, _MOST_S, 's'))]
