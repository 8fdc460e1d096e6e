# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Measure the first stage on large maps: `python -m bench.index exact|indexed|scans|faiss|...`.

`exact` is the row of coarse scores, as it is used, and `indexed` the one above `index_above`
places; `scans` are other codes whose best are scored exactly, `faiss` and `usearch` lists and a
graph (pip install faiss-cpu usearch); `mapped` is the row, and the index, with
descriptors on a disk, 5 GB at ten million places, which are deleted. There are no cells: what
comes after the first stage is not measured. The descriptors are those of a map of 20,000 places
(bench.material), each varied at random; queries are those of the street in it, driven in the
evening. Prints JSON.
"""

import argparse
from collections.abc import Callable, Iterator, Mapping
from functools import partial
import json
from pathlib import Path
import statistics
import sys
import tempfile
import time
from typing import Any

from convseq_ros.core.encoding.descriptor import describe
from convseq_ros.core.map.reader import open_map
from convseq_ros.core.sequence.centred import Centred, COARSE, sums_of, Usual, usual_of
from convseq_ros.core.sequence.coarse_scores import DriveMean
from convseq_ros.core.sequence.coarse_sums import top
from convseq_ros.core.sequence.indexed import Indexed
from convseq_ros.core.sequence.numpy_kernels import ONE
import numpy as np
import numpy.typing as npt

from bench import material
from bench.fleet import resident_mb, SPREAD

KNOWN, FRAMES = 20_000, 200  # places of the map, images of the drive
MAPPED = 20  # of these, asked of descriptors on a disk
CHUNK = 50_000  # places at once
BEST = 100  # that an index names
SAMPLE = 50_000  # places that train one
LISTS = 1024  # of faiss
SCANS = 'PQ63x4fs', 'PQ126x4fs', 'RaBitQfs', 'SQ8'  # of faiss: codes of 4, 4, 1 and 8 bits
REFINED = 1000, 2000, 5000, 10_000, 20_000  # places whose scores are made exact
PROBES = 8, 32, 64, 128, 256  # lists that are looked at
EXPANSIONS = 512, 2048, 8192, 32768  # of usearch: places that are looked at

Descriptors = npt.NDArray[np.float16]
Best = Callable[[npt.NDArray[np.float32]], npt.NDArray[np.int64]]


def chunks(own: Descriptors, count: int) -> Iterator[Descriptors]:
    """Yield descriptors: those of the map, and varied ones."""
    rng = np.random.default_rng(0)
    for start in range(0, count, CHUNK):
        some = own[np.arange(start, min(start + CHUNK, count)) % len(own)].astype(np.float32)
        if start >= len(own):
            some += np.float32(SPREAD) * rng.standard_normal(some.shape, np.float32)
        yield some.astype(np.float16)


def whitened(some: Descriptors, usual: Usual) -> npt.NDArray[np.float32]:
    """Return descriptors whose products with a query are the row's cosines."""
    away = (some.astype(np.float32) - usual.mean) / usual.variance**COARSE.power
    return away / np.maximum(np.linalg.norm(away, axis=1, keepdims=True), 1e-9)


def asked(folder: Path, usual: Usual) -> list[npt.NDArray[np.float32]]:
    """Return the directions of the drive's frames."""
    drive = DriveMean(len(usual.mean))
    return [drive.update(describe(gray), usual) for gray in material.read_queries(folder)]


def timed(best: Best, queries: list[Any], exact: list[set[int]] | None) -> dict[str, Any]:
    """Return the time of a query, and how much of the exact best is found, and of the places."""
    took_ms, found, right, before_s = [], [], 0, time.process_time()
    for query in queries:
        best(query)
    busy_s = time.process_time() - before_s
    for number, query in enumerate(queries):
        started = time.perf_counter()
        some = best(query)
        took_ms.append(1e3 * (time.perf_counter() - started))
        named = {*some.tolist()}
        true = material.truth(number, KNOWN, FRAMES)
        right += bool(named.intersection(range(true - 2, true + 3)))
        if exact:
            found.append(len(named & exact[number]) / BEST)
    return {
        'median_ms': statistics.median(took_ms),
        'busy_ms': 1e3 * busy_s / len(queries),  # of a processor's time, others or not
        'p95_ms': float(np.percentile(took_ms, 95)),
        'of_exact': statistics.fmean(found) if found else 1.0,
        'places_right': right,
    }


def looked_at(centred: Centred, descriptors: Descriptors) -> Best:
    """Return the best of a row of coarse scores, as the first stage makes it."""

    def best(query: npt.NDArray[np.float32]) -> npt.NDArray[np.int64]:
        row = centred.row(descriptors, ONE, query)
        some = top(row, BEST)
        return some[np.argsort(-row[some], kind='stable')[:BEST]]

    return best


def alike_best(centred: Centred, descriptors: Descriptors, query: Any) -> set[int]:
    """Return the best, and those that are as good as the last of them."""
    row = centred.row(descriptors, ONE, query)
    return {*np.flatnonzero(row >= np.partition(row, -BEST)[-BEST]).tolist()}


def scan_bests(descriptors: Descriptors, usual: Usual) -> Iterator[tuple[str, Best]]:
    """Yield what scans of all codes by faiss find, if the best of them are scored exactly."""
    import faiss

    some = np.random.default_rng(0).choice(len(descriptors), min(SAMPLE, len(descriptors)), False)
    for name in SCANS:
        faiss.omp_set_num_threads(2)
        started = time.perf_counter()
        index = faiss.index_factory(descriptors.shape[1], name, faiss.METRIC_INNER_PRODUCT)
        index.train(whitened(descriptors[np.sort(some)], usual))
        for start in range(0, len(descriptors), CHUNK):
            index.add(whitened(descriptors[start : start + CHUNK], usual))
        built_s = time.perf_counter() - started
        faiss.omp_set_num_threads(1)
        for count in REFINED:
            found = partial(refined, index, count, descriptors, usual)
            yield f'{name}, built in {built_s:.0f} s, best {count}', found


def refined(
    index: Any, count: int, descriptors: Descriptors, usual: Usual, query: Any
) -> npt.NDArray[np.int64]:
    """Return the best, by their cosines, of so many that an index names."""
    named = np.sort(index.search(query[None], count)[1][0])
    scores = whitened(descriptors[named], usual) @ query
    return named[np.argpartition(scores, -BEST)[-BEST:]]


def faiss_bests(descriptors: Descriptors, usual: Usual) -> Iterator[tuple[str, Best]]:
    """Yield what an inverted file of faiss finds, in half precision, in so many lists."""
    import faiss

    faiss.omp_set_num_threads(2)
    some = np.random.default_rng(0).choice(len(descriptors), min(SAMPLE, len(descriptors)), False)
    metric = faiss.METRIC_INNER_PRODUCT
    index = faiss.index_factory(descriptors.shape[1], f'IVF{LISTS},SQfp16', metric)
    index.train(whitened(descriptors[np.sort(some)], usual))
    for start in range(0, len(descriptors), CHUNK):
        index.add(whitened(descriptors[start : start + CHUNK], usual))
    faiss.omp_set_num_threads(1)
    for probes in PROBES:
        index.nprobe = probes
        yield f'{probes} lists', lambda query: index.search(query[None], BEST)[1][0]


def usearch_bests(descriptors: Descriptors, usual: Usual) -> Iterator[tuple[str, Best]]:
    """Yield what a graph of usearch finds, in half precision, by so many places."""
    from usearch.index import Index

    index = Index(
        ndim=descriptors.shape[1], metric='cos', dtype='f16', connectivity=16, expansion_add=64
    )
    for start in range(0, len(descriptors), CHUNK):
        some = whitened(descriptors[start : start + CHUNK], usual)
        index.add(np.arange(start, start + len(some)), some.astype(np.float16), threads=2)
    for expansion in EXPANSIONS:
        index.expansion_search = expansion
        yield (
            f'{expansion} places',
            lambda query: index.search(query.astype(np.float16), BEST, threads=1).keys,
        )


def indexed_bests(descriptors: Descriptors, usual: Usual) -> Iterator[tuple[str, Best]]:
    """Yield what the index finds that is used."""
    yield 'indexed', looked_at(Indexed(usual, descriptors, ONE), descriptors)


SIDES = {
    'indexed': indexed_bests,
    'scans': scan_bests,
    'faiss': faiss_bests,
    'usearch': usearch_bests,
}


def mapped(own: Descriptors, count: int, folder: Path) -> Mapping[str, Any]:
    """Measure rows of descriptors that are on a disk, as far as the memory does not hold them."""
    path, told = folder / 'descriptors.f16', dict[str, Any]()
    try:
        with path.open('wb') as file:
            for some in chunks(own, count):
                file.write(some.tobytes())
        there = np.memmap(path, np.float16, 'r', shape=(count, own.shape[1]))
        usual = usual_of(sums_of(own), len(own))
        queries = asked(folder, usual)[:MAPPED]
        for name, kind in {'exact': Centred, 'indexed': Indexed}.items():
            started = time.perf_counter()
            centred = kind(usual, there, ONE)
            opened_s = time.perf_counter() - started
            best, truths = looked_at(centred, there), told.pop('truths', None)
            if truths is None:
                told['truths'] = [alike_best(centred, there, one) for one in queries]
            told[name] = {'opened_s': opened_s, **timed(best, queries, truths)}
            print(name, told[name], file=sys.stderr, flush=True)
        return told
    finally:
        path.unlink(missing_ok=True)


def main() -> int:
    """Measure one of them and print it."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument('what', choices=[*SIDES, 'exact', 'mapped'])
    parser.add_argument('--places', type=int, default=1_000_000)
    parser.add_argument('--folder', type=Path, help='for the map, which is kept then')
    chosen = parser.parse_args()
    with tempfile.TemporaryDirectory(prefix='convseq_index_') as made:
        folder = chosen.folder or Path(made)
        folder.mkdir(parents=True, exist_ok=True)
        material.prepare(folder, (KNOWN,), FRAMES)
        own = open_map(material.map_path(folder, KNOWN)).global_descriptors
        told: dict[str, Any] = {'what': chosen.what, 'places': chosen.places, 'cells': 'none'}
        if chosen.what == 'mapped':
            print(json.dumps(told | mapped(own, chosen.places, folder)))
            return 0
        descriptors = np.concatenate([*chunks(own, chosen.places)])
        usual = usual_of(sums_of(descriptors), len(descriptors))
        directions = asked(folder, usual)
        whole = Centred(usual, descriptors, ONE)
        exact = looked_at(whole, descriptors)
        before_mb = resident_mb()
        if chosen.what == 'exact':
            told |= timed(exact, directions, None) | {'resident_mb': before_mb}
            print(json.dumps(told))
            return 0
        truths = [alike_best(whole, descriptors, one) for one in directions]
        told['exact'] = timed(exact, directions, None)
        del exact, whole
        # `Indexed` is asked as the row is, the others in whitened numbers.
        spread = 1 if chosen.what == 'indexed' else usual.variance**COARSE.power
        queries = [one * spread for one in directions]
        before_mb, started = resident_mb(), time.perf_counter()
        for name, best in SIDES[chosen.what](descriptors, usual):
            told.setdefault('built_s', time.perf_counter() - started)
            told.setdefault('index_mb', resident_mb() - before_mb)
            told[name] = timed(best, queries, truths)
            print(name, told[name], file=sys.stderr, flush=True)
        print(json.dumps(told))
    return 0


if __name__ == '__main__':
    sys.exit(main())
