# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A whole frame, from its gray image to the answer, with maps of all sizes."""

from collections.abc import Callable, Iterator
from itertools import count
from pathlib import Path
import time

from convseq_ros.config import Config, MatchingConfig, SequenceConfig
from convseq_ros.core.compiled import available
from convseq_ros.core.decision.observation import OBSERVED
from convseq_ros.core.map.reader import open_map
from convseq_ros.core.recognizer import PlaceRecognizer
from convseq_ros.core.types import Frame, Match
import numpy as np

from bench.clock import Times
from bench.finding import at_least, at_most, Finding
from bench.material import read_into_file_cache, truth
from bench.released import encode, frame_ms, ReleasedLoop
from bench.work import Work

LENGTH = 10
_WARM_FRAMES = max(LENGTH + 5, OBSERVED.first_frames)  # those after look at fewer places
_ROUNDS = 60
_RELEASED_PAIRS = 10
_TOLERANCE = 2
_MOST_UNCOMPILED = 1000
_MOST_UNCOMPILED_MS = 35
_INT8_KB, _FLOAT32_KB = 30, 120
_WANTED = {1000: (10, 400), 10_000: (12, 4000), 100_000: (16, 20_000)}
_WANTED_GROWTH = 2
_PERIOD_NS = 100_000_000


def measure(work: Work) -> list[Finding]:
    """Measure frames with the shortlist and with the whole map, and the script's steps between."""
    if not available():
        return [_uncompiled(work, work.sizes[0])]
    findings: list[Finding] = []
    medians: list[float] = []
    for size in work.sizes:
        found = _frames(work, size)
        findings += found
        medians += [one.value for one in found[:1] if one.value]
    growth = medians[-1] / medians[0]
    largest, smallest = work.sizes[-1], work.sizes[0]
    what = f'frame at R = {largest:,} over frame at R = {smallest:,}'
    finding = Finding(what=what, side='coherent, shortlist', value=growth, unit='x')
    return [*findings, finding.aiming(at_most(growth, _WANTED_GROWTH, 'x'))]


class Drive:
    """Gives a recogniser one frame after another."""

    def __init__(self, work: Work, size: int, search: str) -> None:
        chosen = MatchingConfig(matching='coherent', search=search, threads=work.threads)
        config = Config(matching=chosen, sequence=SequenceConfig(fixed_length=LENGTH))
        read_into_file_cache(work.map_path(size))
        self._recognizer = PlaceRecognizer(open_map(work.map_path(size)), config)
        self._recognizer.matcher.warm_up()
        self._images, self._size = work.images, size
        self._numbers = count()
        self._matches: list[Match] = []
        self._right = 0
        self.kernel = self._recognizer.matcher.kernel

    def warm_up(self) -> None:
        """Process the first frames of a drive; what was right so far does not count."""
        for _ in range(_WARM_FRAMES):
            self.frame_ms()
        self._matches.clear()
        self._right = 0

    def note(self) -> str:
        """Return what computed pairs, how many, and how many frames were right."""
        scored = int(np.median([match.pairs_scored for match in self._matches]))
        return f'{self.kernel}; {scored} pairs; {self._right} of {len(self._matches)} right'

    def frame_ms(self) -> float:
        """Return how long the next frame took."""
        index = next(self._numbers)
        frame = Frame(index * _PERIOD_NS, self._images[index % len(self._images)])
        start_ns = time.perf_counter_ns()
        match = self._recognizer.process(frame)
        took_ms = (time.perf_counter_ns() - start_ns) / 1e6
        wanted = truth(index, self._size, len(self._images))
        best = match.best
        self._right += best is not None and abs(best.reference_index - wanted) <= _TOLERANCE
        self._matches.append(match)
        return took_ms


def _frames(work: Work, size: int) -> list[Finding]:
    what = f'frame, k = {LENGTH}, R = {size:,}'
    shortlist = Drive(work, size, 'shortlist')
    obstacle = _obstacle(shortlist.kernel, size)
    exhaustive = None if obstacle else Drive(work, size, 'exhaustive')
    shortlist.warm_up()
    rounds = 3 if work.quick else _ROUNDS
    every = min(rounds, max(1, size // 500))
    # Frames that compare the whole map take seconds; those before the sequence is long enough
    # take the same time, but the first, which prepares all references.
    if exhaustive and size <= 1000:
        exhaustive.warm_up()
    elif exhaustive:
        exhaustive.frame_ms()
    script = _Script(work)
    own, full, encodes, pairs = [], [], [], []
    for number in range(rounds):
        own.append(shortlist.frame_ms())
        if exhaustive and number % every == every // 2:
            full.append(exhaustive.frame_ms())
        encodes.append(script.encode_ms())
        pairs.append(script.pair_ms())
    released = frame_ms(float(np.median(encodes)), float(np.median(pairs)), size, LENGTH)
    return list(_told(work, what, size, shortlist, own, full, released, obstacle))


def _uncompiled(work: Work, size: int) -> Finding:
    """Measure frames by NumPy alone."""
    drive = Drive(work, size, 'shortlist')
    drive.warm_up()
    times = Times(tuple(drive.frame_ms() for _ in range(3 if work.quick else _ROUNDS)))
    finding = Finding(
        what=f'frame, k = {LENGTH}, R = {size:,}',
        side='coherent, shortlist, NumPy alone',
        threads=work.threads,
        note=drive.note(),
    )
    return finding.timed(times).aiming(at_most(times.median, _MOST_UNCOMPILED_MS, 'ms'))


def _obstacle(kernel: str, size: int) -> str:
    """Return why a map of a size cannot be compared as a whole; empty if it can."""
    if kernel == 'numpy' and size > _MOST_UNCOMPILED:
        return 'takes too long by NumPy'
    told = Path('/proc/meminfo').read_text(encoding='ascii')
    free_kb = int(told.partition('MemAvailable:')[2].split()[0])
    needed_kb = size * (_INT8_KB if kernel.startswith('int8') else _FLOAT32_KB)
    return '' if 2 * needed_kb < free_kb else f'needs {needed_kb / 1e6:.0f} GB of memory'


def _told(
    work: Work,
    what: str,
    size: int,
    shortlist: Drive,
    own: list[float],
    full: list[float],
    released: float,
    obstacle: str,
) -> Iterator[Finding]:
    against, threads = 'released script, computed', work.threads
    times = Times(tuple(own))
    faster = released / times.median
    finding = Finding(
        what=what, side='coherent, shortlist', threads=threads, note=shortlist.note()
    )
    finding = finding.timed(times).compared(faster, against)
    if size in _WANTED:
        most_ms, least = _WANTED[size]
        finding = finding.aiming(at_most(times.median, most_ms, 'ms'), at_least(faster, least))
    yield finding
    note = obstacle or f'{shortlist.kernel}; {len(full)} frames'
    finding = Finding(what=what, side='coherent, exhaustive', threads=threads, note=note)
    if full:
        times = Times(tuple(full))
        finding = finding.timed(times).compared(released / times.median, against)
    yield finding
    yield Finding(
        what=what,
        side=against,
        value=released,
        threads=threads,
        runs=len(own),
        note=f'{LENGTH} encodings and {LENGTH} rows, from the cost of steps taken in turn',
    )


class _Script:
    """The steps of the released script, a few at a time."""

    def __init__(self, work: Work) -> None:
        self._image, self._loop = work.images[0], ReleasedLoop()
        described = [encode(image) for image in work.images[:_RELEASED_PAIRS]]
        self._query, self._salient = described[0]
        self._references = [rows for rows, _ in described]
        self.pair_ms()

    def encode_ms(self) -> float:
        return _took_ms(lambda: encode(self._image))

    def pair_ms(self) -> float:
        row = _took_ms(lambda: self._loop.row(self._query, self._salient, self._references))
        return row / len(self._references)


def _took_ms(work: Callable[[], object]) -> float:
    start_ns = time.perf_counter_ns()
    work()
    return (time.perf_counter_ns() - start_ns) / 1e6
