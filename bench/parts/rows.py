# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The paper's row: one query against every reference of a map."""

from functools import partial

from convseq_ros.config import MatchingConfig
from convseq_ros.core.encoding.regions import paper_regions
from convseq_ros.core.map.reader import open_map
from convseq_ros.core.matcher import Matcher
import numpy as np

from bench.finding import at_least, Finding
from bench.parts.pairs import SALIENT, Sides
from bench.query import with_salient
from bench.released import ReleasedLoop
from bench.work import Work

_WANTED = {'int8 kernel': 12.0, 'float32 kernel': 3.5}
_SMALLEST, _LARGEST = 200, 10_000
_MOST_OF_NUMPY = 1000
_AGAINST = 'released loop'


def measure(work: Work) -> list[Finding]:
    """Compare every kernel with the released loop, over maps of three sizes."""
    sizes = [size for size in work.sizes if size <= _LARGEST]
    findings = []
    for size in sorted({min(_SMALLEST, sizes[0]), *sizes}):
        findings += _row(work, size)
    return findings


def _row(work: Work, size: int) -> list[Finding]:
    what = f'row of regional pairs, R = {size:,}'
    query, threshold = with_salient(work.queries[0], 'regional', SALIENT)
    references = open_map(work.map_path(next(one for one in work.sizes if one >= size)))
    indices = np.arange(size)
    prepared = [paper_regions(references.cells(index)) for index in indices.tolist()]
    loop, rows = ReleasedLoop(), paper_regions(query.cells)
    weights = query.salient.astype(np.float32)
    sides: Sides = {_AGAINST: lambda: loop.row(rows, weights, prepared)}
    for kernel in work.kernels:
        if kernel == 'numpy' and size > _MOST_OF_NUMPY:
            continue
        chosen = MatchingConfig(matching='regional', kernel=kernel, threads=work.threads)
        matcher = Matcher(references, chosen, threshold)
        sides[f'{kernel} kernel'] = partial(matcher.scores, matcher.extract(query), indices)
    times = work.in_turn(sides, 6)
    findings = []
    for name in sides:
        finding = Finding(what=what, side=name, threads=work.threads).timed(times[name])
        if name != _AGAINST:
            faster = times[name].faster_than(times[_AGAINST])
            finding = finding.compared(faster, _AGAINST)
            if name in _WANTED:
                finding = finding.aiming(at_least(faster, _WANTED[name]))
        findings.append(finding)
    return findings + work.absent_kernels(what)
