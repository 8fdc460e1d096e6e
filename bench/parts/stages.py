# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Where the time of a whole frame goes, stage by stage, with maps of all sizes."""

from collections import defaultdict
from collections.abc import Callable, Iterator
from contextlib import contextmanager, ExitStack
import time
from typing import Any
from unittest.mock import patch

from convseq_ros.core import recognizer
from convseq_ros.core.closures import Closures
from convseq_ros.core.decision.belief import Belief
from convseq_ros.core.decision.belief_decider import BeliefDecider
from convseq_ros.core.decision.motion import MotionModel
from convseq_ros.core.decision.observation import Observer
from convseq_ros.core.decision.odometry_prior import OdometryPrior
from convseq_ros.core.feature_cache import FeatureCache
from convseq_ros.core.frame_gate import FrameGate
from convseq_ros.core.map.reference_map import ReferenceMap
from convseq_ros.core.matcher import Matcher
from convseq_ros.core.sequence import query_buffer
from convseq_ros.core.sequence.coarse_scores import CoarseScores, Track
import numpy as np

from bench.finding import Finding
from bench.parts.frames import Drive
from bench.work import Work

# What is called in each stage: by what has it, and its name there.
STAGES: dict[str, tuple[tuple[Any, str], ...]] = {
    'encoding': ((recognizer, 'describe'),),
    'frame gate': ((FrameGate, 'update'),),
    'query': ((Matcher, 'extract'),),
    'coarse scores': ((CoarseScores, 'update'), (CoarseScores, 'best')),
    'track': ((Track, 'update'),),
    'reading places': ((ReferenceMap, 'packed_of'),),
    'preparing places': ((FeatureCache, '_made'),),
    'pair scores': ((FeatureCache, 'scores_of'),),
    'verification': ((Matcher, 'verified'), (query_buffer, 'verify')),
    'observation ratios': ((Observer, 'observe'),),
    'belief': (
        (MotionModel, 'move'),
        (OdometryPrior, 'move'),
        (Belief, 'predict'),
        (Belief, 'likeliest'),
        (OdometryPrior, 'shares'),
        (Belief, 'update'),
    ),
    'report': ((BeliefDecider, '_answer'), (Closures, 'complete')),
}
REST = 'the rest'
_FRAMES = 60


def measure(work: Work) -> list[Finding]:
    """Return the mean time of each stage, what it calls of other stages left out."""
    findings = []
    for size in work.sizes:
        drive = Drive(work, size, 'shortlist')
        drive.warm_up()
        frames = 3 if work.quick else _FRAMES
        with _watched() as spent_s:
            total_ms = float(np.sum([drive.frame_ms() for _ in range(frames)]))
        spent_ms = {stage: 1e3 * spent_s[stage] for stage in STAGES}
        spent_ms[REST] = total_ms - sum(spent_ms.values())
        what = f'frame by stage, R = {size:,}'
        findings += [
            Finding(what=what, side=stage, value=took_ms / frames, threads=work.threads)
            for stage, took_ms in spent_ms.items()
        ]
    return findings


@contextmanager
def _watched() -> Iterator[dict[str, float]]:
    """Take the time of all stages: what one calls of another counts there."""
    spent_s: dict[str, float] = defaultdict(float)
    inside_s = [0.0]

    def watched(stage: str, work: Callable[..., Any]) -> Callable[..., Any]:
        def run(*given: Any, **named: Any) -> Any:
            start_s = time.perf_counter()
            inside_s.append(0.0)
            try:
                return work(*given, **named)
            finally:
                took_s = time.perf_counter() - start_s
                spent_s[stage] += took_s - inside_s.pop()
                inside_s[-1] += took_s

        return run

    with ExitStack() as patches:
        for stage, calls in STAGES.items():
            for owner, name in calls:
                own = watched(stage, getattr(owner, name))
                patches.enter_context(patch.object(owner, name, own))
        yield spent_s
