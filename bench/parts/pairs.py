# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Pair scores: a query against one reference after another."""

from collections.abc import Callable
from functools import partial

from convseq_ros.config import MatchingConfig
from convseq_ros.core.encoding.entropy import ENTROPY
from convseq_ros.core.encoding.regions import paper_regions, projected_regions
from convseq_ros.core.map.place import pack_cells, unpack_cells
from convseq_ros.core.map.reader import open_map
from convseq_ros.core.matcher import Matcher
from convseq_ros.core.similarity.coherent import extract
from convseq_ros.core.similarity.kernels.numpy_coherent import coherent_score
from convseq_ros.core.similarity.kernels.numpy_regional import pair_scores
from convseq_ros.core.types import Descriptor
import numpy as np
import numpy.typing as npt

from bench.clock import Times
from bench.finding import at_least, Finding
from bench.peaks import int8_work, sgemm_work
from bench.query import with_salient
from bench.released import REGIONS, ReleasedLoop
from bench.tuned_pair import TunedPair
from bench.work import Work

SALIENT = 650
_PAIRS = 32
_COHERENT_REGIONS = 900
_OPERATIONS = 2 * 32
_INT8, _FLOAT32 = 'peak, int8', 'peak, float32'
_KERNEL = 'int8 kernel'

Scores = npt.NDArray[np.floating]
Sides = dict[str, Callable[[], object]]


def measure(work: Work) -> list[Finding]:
    """Compare every kernel with NumPy, and with the most that the machine can multiply."""
    findings = _coherent(work)
    findings += _regional(work, SALIENT)
    findings += _regional(work, REGIONS)
    return findings + _stored(work)


def _coherent(work: Work) -> list[Finding]:
    what, against = f'coherent pair, G = {SALIENT}', 'tuned NumPy'
    query, threshold = with_salient(work.queries[0], 'coherent', SALIENT)
    references = open_map(work.map_path(work.sizes[0]))
    indices = _indices(len(references))
    seen = extract(query, threshold * ENTROPY.max_bits)
    assert seen
    tuned = TunedPair(seen)
    prepared = [projected_regions(references.cells(index)) for index in indices.tolist()]
    exact = np.array([coherent_score(seen, one)[0] for one in prepared])
    sides: Sides = {against: lambda: [tuned.score(one) for one in prepared]}
    errors = {against: _error([tuned.score(one) for one in prepared], exact)}
    _add_kernels(work, sides, errors, query, 'coherent', threshold, exact)
    operations = len(seen.index) * _COHERENT_REGIONS * _OPERATIONS
    wanted = {_KERNEL: 9.0, 'float32 kernel': 2.0}
    return _compared(work, what, against, sides, errors, operations, wanted, 0.55)


def _regional(work: Work, salient: int) -> list[Finding]:
    what, against = f'regional pair, G = {salient}', 'released loop'
    query, threshold = with_salient(work.queries[0], 'regional', salient)
    references = open_map(work.map_path(work.sizes[0]))
    indices = _indices(len(references))
    prepared = [paper_regions(references.cells(index)) for index in indices.tolist()]
    exact = pair_scores(query, prepared)
    loop, rows = ReleasedLoop(), paper_regions(query.cells)
    weights = query.salient.astype(np.float32)
    sides: Sides = {against: lambda: loop.row(rows, weights, prepared)}
    errors = {against: _error(loop.row(rows, weights, prepared), exact)}
    _add_kernels(work, sides, errors, query, 'regional', threshold, exact)
    operations = salient * REGIONS * _OPERATIONS
    share = 0.8 if salient == REGIONS else None
    return _compared(work, what, against, sides, errors, operations, {}, share)


def _compared(
    work: Work,
    what: str,
    against: str,
    sides: Sides,
    errors: dict[str, float],
    operations: int,
    wanted: dict[str, float],
    wanted_share: float | None,
) -> list[Finding]:
    """Take the sides in turn, the peaks among them; targets are those of one core."""
    peaks = {_FLOAT32: sgemm_work()}
    if dots := int8_work(work.threads):
        peaks[_INT8] = dots
    times = work.in_turn(sides | {name: run for name, (run, _) in peaks.items()}, 5)
    speeds = {name: 1e3 * peak[1] / times[name].median for name, peak in peaks.items()}
    findings = []
    for name in sides:
        note = f'error {errors[name]:.0e}'
        finding = Finding(what=what, side=name, threads=work.threads, note=note)
        finding = finding.timed(times[name], 1 / _PAIRS)
        if name != against:
            faster = times[name].faster_than(times[against])
            finding = finding.compared(faster, against)
            if name in wanted and work.threads == 1:
                finding = finding.aiming(at_least(faster, wanted[name]))
        findings.append(finding)
    findings += work.absent_kernels(what)
    findings += [
        Finding(what=what, side=name, value=speed, unit='GOP/s', threads=work.threads)
        for name, speed in speeds.items()
    ]
    share = _share(times.get(_KERNEL), operations, speeds.get(_INT8))
    finding = Finding(
        what=what,
        side=_KERNEL,
        value=share,
        unit='of peak',
        threads=work.threads,
        note='' if share else 'there is no int8 peak to compare with',
    )
    if share and wanted_share and work.threads == 1:
        finding = finding.aiming(at_least(share, wanted_share, 'of peak'))
    return [*findings, finding]


def _share(kernel: Times | None, operations: int, peak_gops: float | None) -> float | None:
    if kernel is None or peak_gops is None:
        return None
    return operations * _PAIRS / kernel.median / 1e6 / peak_gops


def _stored(work: Work) -> list[Finding]:
    """Compare scores with references as maps store them with those of unrounded ones."""
    queries = work.queries
    rounded = [unpack_cells(pack_cells(one.cells)) for one in queries]
    largest = dict.fromkeys(('coherent', 'regional'), 0.0)
    for query in queries:
        seen = extract(query, ENTROPY.max_bits / 2)
        for one, cells in zip(queries, rounded, strict=True):
            pair = projected_regions(one.cells), projected_regions(cells)
            scores = [coherent_score(seen, each)[0] for each in pair] if seen else [0.0]
            largest['coherent'] = max(largest['coherent'], max(scores) - min(scores))
            pair = paper_regions(one.cells), paper_regions(cells)
            scores = pair_scores(query, pair).tolist()
            largest['regional'] = max(largest['regional'], max(scores) - min(scores))
    return [
        Finding(
            what='cells as stored, in half precision',
            side=f'{matching} scores',
            value=error,
            unit='largest difference',
            runs=len(queries) ** 2,
        )
        for matching, error in largest.items()
    ]


def _add_kernels(
    work: Work,
    sides: Sides,
    errors: dict[str, float],
    query: Descriptor,
    matching: str,
    threshold: float,
    exact: Scores,
) -> None:
    """Add every kernel that runs here, with its error."""
    references = open_map(work.map_path(work.sizes[0]))
    indices = _indices(len(references))
    for kernel in work.kernels:
        chosen = MatchingConfig(
            matching=matching, kernel=kernel, threads=work.threads, subtract_background=False
        )
        matcher = Matcher(references, chosen, threshold)
        run = partial(matcher.scores, matcher.extract(query), indices)
        sides[f'{kernel} kernel'] = run
        errors[f'{kernel} kernel'] = _error(run(), exact)


def _indices(size: int) -> npt.NDArray[np.int64]:
    """Return references from the middle of a map, repeated if it is a small one."""
    return (size // 2 + np.arange(_PAIRS)) % size


def _error(scores: npt.ArrayLike, exact: Scores) -> float:
    return float(np.abs(np.asarray(scores) - exact).max())
