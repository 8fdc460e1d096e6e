# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The time of one image pair, and the peak rate of the machine."""

from collections.abc import Callable
from dataclasses import replace
from functools import partial
import os
import time

from convseq_ros.core.compiled import library
from convseq_ros.core.encoding.descriptor import describe, ENTROPY
from convseq_ros.core.encoding.regions import projected_regions
from convseq_ros.core.map.reader import open_map
from convseq_ros.core.similarity.coherent import extract
from convseq_ros.core.similarity.kernels import coherent_kernel
from convseq_ros.core.similarity.kernels.numpy_coherent import coherent_score
from convseq_ros.core.types import Descriptor
import numpy as np

from bench.finding import Finding
from bench.machine import float32_peak, int8_peak
from bench.material import Work

REGIONS = 900  # of a reference
OPERATIONS = 2 * 32  # per pair of regions: 32 products and sums
_PAIRS, _ROUNDS = 32, 40
_LEAST_SHARE = 0.55  # of the peak
_SALIENCY = 0.5  # of the highest entropy; the default of `saliency_threshold`


def salient(query: Descriptor) -> int:
    """Return the number of compared regions of a query."""
    features = extract(query, _SALIENCY * ENTROPY.max_bits)
    return len(features.index) if features else 0


def measure(work: Work) -> list[Finding]:
    """Time every kernel and the peaks."""
    if (wanted := os.environ.get('CONVSEQ_KERNELS', '')) and library().problem:
        return [Finding(what=f'pair, {wanted}', note=library().problem)]
    query = describe(work.images[0])
    references = open_map(work.map_path(work.sizes[0]))
    indices = (work.sizes[0] // 2 + np.arange(_PAIRS)) % work.sizes[0]
    features = extract(query, _SALIENCY * ENTROPY.max_bits)
    assert features
    expected = [
        coherent_score(features, projected_regions(references.cells(index)))[0]
        for index in indices.tolist()
    ]
    peak, variant = int8_peak(), library().variant or 'no compiled kernels'
    what = f'pair of images, {len(features.index)} regions with {REGIONS}'
    findings = [
        Finding(what='peak of a core, float32', value=float32_peak(), unit='GFLOP/s'),
        Finding(what='peak of a core, int8', value=peak, unit='GOP/s', note=variant),
    ]
    kernel = coherent_kernel()
    prepared = [kernel.prepare(references.cells(index), None) for index in indices.tolist()]
    extracted = kernel.extract(query, _SALIENCY * ENTROPY.max_bits)
    run = partial(kernel.compare, extracted, prepared)
    off = float(np.abs(run()[0] - expected).max())
    took_ms = _pair_ms(run, 1 if work.quick else _ROUNDS)
    low, value, high = (float(one) for one in np.percentile(took_ms, (25, 50, 75)))
    finding = Finding(what=what, side='int8 kernel')
    timed = replace(finding, value=value, low=low, high=high, runs=len(took_ms))
    findings.append(replace(timed, note=f'error {off:.0e}'))
    if peak:
        share = len(features.index) * REGIONS * OPERATIONS / value / 1e6 / peak
        finding = replace(finding, value=share, unit='of the peak', least=_LEAST_SHARE)
        findings.append(finding)
    return findings


def _pair_ms(run: Callable[[], object], rounds: int) -> list[float]:
    took_ms = []
    for _ in range(rounds):
        start_ns = time.thread_time_ns()
        run()
        took_ms.append((time.thread_time_ns() - start_ns) / 1e6 / _PAIRS)
    return took_ms
