# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A whole frame with the kernels of processors that have AVX2 and no more."""

from convseq_ros.core.compiled import library

from bench.clock import Times
from bench.finding import at_most, Finding
from bench.parts.frames import Drive, LENGTH
from bench.work import Work

_SIZE = 10_000
_ROUNDS = 60
_MOST_MS = 30


def measure(work: Work) -> list[Finding]:
    """Measure frames with a shortlist; the part's process has CONVSEQ_KERNELS=avx2."""
    size = max(size for size in work.sizes if size <= _SIZE)
    finding = Finding(what=f'frame, k = {LENGTH}, R = {size:,}', side='AVX2 alone')
    if library().variant != 'avx2':
        return [finding.noted(library().problem)]
    drive = Drive(work, size, 'shortlist')
    drive.warm_up()
    times = Times(tuple(drive.frame_ms() for _ in range(3 if work.quick else _ROUNDS)))
    finding = finding.noted(drive.note()).timed(times)
    return [finding.aiming(at_most(times.median, _MOST_MS, 'ms'))]
