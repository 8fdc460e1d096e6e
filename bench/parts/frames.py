# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
The time of a frame, from its gray image to the answer, for all map sizes, and by stage.

Times are CPU times, which other load does not affect. The time of the kernels of pair scores
scales with the integer peak of the processor, all other time is assumed to scale with its clock.
The page computes the times on other processors from these two.
"""

from collections import defaultdict
from collections.abc import Callable, Iterator
from contextlib import contextmanager, ExitStack
from itertools import count
import os
import time
from typing import Any
from unittest.mock import patch

from convseq_ros.config import Config, MatchingConfig
from convseq_ros.core import recognizer
from convseq_ros.core.compiled import available, library
from convseq_ros.core.decision.belief import Belief
from convseq_ros.core.decision.belief_decider import BeliefDecider
from convseq_ros.core.decision.budget import BUDGET
from convseq_ros.core.decision.covisibility import Covisibility
from convseq_ros.core.decision.expected_lead import Light
from convseq_ros.core.decision.motion import MotionModel
from convseq_ros.core.decision.observation import Observer
from convseq_ros.core.decision.odometry import OdometryPrior
from convseq_ros.core.encoding.descriptor import describe
from convseq_ros.core.gate.gate import FrameGate
from convseq_ros.core.map.reader import open_map
from convseq_ros.core.map.reference_map import ReferenceMap
from convseq_ros.core.recognizer import PlaceRecognizer
from convseq_ros.core.retrieval.coarse_scores import CoarseScores, Track
from convseq_ros.core.similarity.coherent import COHERENT
from convseq_ros.core.similarity.feature_cache import FeatureCache
from convseq_ros.core.similarity.matcher import Matcher
from convseq_ros.core.types import Frame, Match
import numpy as np

from bench.finding import Finding
from bench.machine import float32_peak, int8_peak
from bench.material import read_into_file_cache, truth, Work
from bench.parts.kernels import OPERATIONS, REGIONS, salient

# The functions of each stage: their owners and names.
STAGES: dict[str, tuple[tuple[Any, str], ...]] = {
    'encoding': ((recognizer, 'describe'),),
    'frame gate': ((FrameGate, 'check'),),
    'query': ((Matcher, 'extract'),),
    'coarse scores': ((CoarseScores, 'update'), (CoarseScores, 'best')),
    'track': ((Track, 'update'),),
    'reading places': ((ReferenceMap, 'packed_of'),),
    'preparing places': ((FeatureCache, '_made'),),
    'pair scores': ((FeatureCache, 'scores_of'),),
    'verification': ((Matcher, 'verified'),),
    'keypoints': ((Observer, '_asked'), (Light, 'observe')),
    'covisibility': ((Covisibility, 'share'), (Covisibility, 'is_in_view')),
    'observation ratios': ((Observer, 'observe'),),
    'belief': (
        (MotionModel, 'move'),
        (OdometryPrior, 'move'),
        (Belief, 'predict'),
        (Belief, 'likeliest'),
        (OdometryPrior, 'entry_prior'),
        (Belief, 'update'),
    ),
    'report': ((BeliefDecider, '_answer'), (PlaceRecognizer, '_measured')),
}
BY_PEAK = ('pair scores',)  # the stages whose time scales with the integer peak
REST = 'the rest'
_WARM_FRAMES = BUDGET.first_frames  # after these, fewer places are scored
_ROUNDS = 60
_TOLERANCE = 2
_PERIOD_NS = 100_000_000
# The target of issue 37: so long on a core that does so many GFLOP/s, and so many operations.
_ALL_BUT_KERNELS_MS, _GFLOPS, _GOP = 5.0, 125.0, 1.0
_WANTED = {1_000: 0.9, 10_000: 1.0, 100_000: 1.2}  # times that, by places


class Drive:
    """Feeds a recogniser frame by frame."""

    def __init__(self, work: Work, size: int, search: str = 'shortlist') -> None:
        config = Config(matching=MatchingConfig(search=search, threads=work.threads))
        read_into_file_cache(work.map_path(size))
        self._recognizer = PlaceRecognizer(open_map(work.map_path(size)), config)
        self._recognizer.matcher.warm_up()
        self._images, self._size = work.images, size
        self._numbers = count()
        self.matches: list[Match] = []
        self.right = self.rough_pairs = 0
        self.kernel = self._recognizer.matcher.kernel
        matcher = self._recognizer.matcher
        matcher.rough_scores = self._counted(matcher.rough_scores)  # type: ignore[method-assign]

    def _counted(self, scored: Callable[..., Any]) -> Callable[..., Any]:
        def score(query: Any, indices: Any) -> Any:
            self.rough_pairs += len(indices)
            return scored(query, indices)

        return score

    def warm_up(self) -> None:
        """Process the first frames of a drive, without counting them."""
        for _ in range(_WARM_FRAMES):
            self.frame_ms()
        self.matches.clear()
        self.right = self.rough_pairs = 0

    def frame_ms(self) -> float:
        """Process the next frame and return its CPU time."""
        index = next(self._numbers)
        frame = Frame(index * _PERIOD_NS, self._images[index % len(self._images)])
        start_ns = time.process_time_ns()
        match = self._recognizer.process(frame)
        took_ms = (time.process_time_ns() - start_ns) / 1e6
        wanted = truth(index, self._size, len(self._images))
        best = match.best
        self.right += best is not None and abs(best.reference_index - wanted) <= _TOLERANCE
        self.matches.append(match)
        return took_ms


def measure(work: Work) -> list[Finding]:
    """Measure frames; with other than the best kernels, only for one map size."""
    kernels = os.environ.get('CONVSEQ_KERNELS', '')
    if kernels not in ('', 'numpy') and library().variant != kernels:
        return [Finding(what='frame', side=kernels, note=library().problem)]
    sizes = {'': work.sizes, 'numpy': work.sizes[:1]}.get(kernels, (work.largest(10_000),))
    ideal_ms = None
    if peak := int8_peak():
        ideal_ms = _ALL_BUT_KERNELS_MS * _GFLOPS / float32_peak() + 1e3 * _GOP / peak
    return [finding for size in sizes for finding in _frames(work, size, ideal_ms)]


def _frames(work: Work, size: int, ideal_ms: float | None) -> list[Finding]:
    what, rounds = f'frame, R = {size:,}', 3 if work.quick else _ROUNDS
    drive = Drive(work, size)
    drive.warm_up()
    took_ms = [drive.frame_ms() for _ in range(rounds)]
    low, median, high = (float(one) for one in np.percentile(took_ms, (25, 50, 75)))
    matches, right, rough = [*drive.matches], drive.right, drive.rough_pairs / rounds
    with _watched() as spent_s:
        total_ms = float(np.mean([drive.frame_ms() for _ in range(rounds)]))
    stages_ms = {stage: 1e3 * spent_s[stage] / rounds for stage in STAGES}
    stages_ms[REST] = total_ms - sum(stages_ms.values())
    wanted_ms = ideal_ms and ideal_ms * _WANTED[size] if size in _WANTED else None
    if not available():
        wanted_ms = None
    pairs = float(np.median([match.pairs_scored for match in matches]))
    regions = np.mean([salient(describe(image)) for image in work.images[::8]])
    whole_pairs = pairs + rough / COHERENT.rough_step**4
    operations = whole_pairs * float(regions) * REGIONS * OPERATIONS / 1e9
    by_peak_ms = sum(stages_ms[stage] for stage in BY_PEAK) if available() else 0.0
    total = Finding(
        what=what, side='whole', value=median, low=low, high=high, runs=rounds,
        threads=work.threads, most=wanted_ms,
        note=f'{drive.kernel}; {right} of {len(matches)} right',
    )  # fmt: skip
    split = {
        'operations': (operations, 'GOP'),
        'pairs in full': (pairs, 'pairs'),
        'rough pairs': (rough, 'pairs'),
        'scales with the integer peak': (by_peak_ms, 'ms'),
        'scales with the clock': (median - by_peak_ms, 'ms'),
    }
    return [
        total,
        *(Finding(what=what, side=side, value=one[0], unit=one[1]) for side, one in split.items()),
        *(
            Finding(what=f'{what}, by stage', side=stage, value=stage_ms)
            for stage, stage_ms in stages_ms.items()
        ),
    ]


@contextmanager
def _watched() -> Iterator[dict[str, float]]:
    """Measure the time of all stages; nested calls count for the inner stage."""
    spent_s: dict[str, float] = defaultdict(float)
    inside_s = [0.0]

    def watched(stage: str, work: Callable[..., Any]) -> Callable[..., Any]:
        def run(*given: Any, **named: Any) -> Any:
            start_s = time.process_time()
            inside_s.append(0.0)
            try:
                return work(*given, **named)
            finally:
                took_s = time.process_time() - start_s
                spent_s[stage] += took_s - inside_s.pop()
                inside_s[-1] += took_s

        return run

    with ExitStack() as patches:
        for stage, calls in STAGES.items():
            for owner, name in calls:
                timed = watched(stage, getattr(owner, name))
                patches.enter_context(patch.object(owner, name, timed))
        yield spent_s
