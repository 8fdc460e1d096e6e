# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What robots run today, on a data set: bags of words or VLAD, with DLoopDetector's decision."""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from functools import cache, partial
from itertools import pairwise
from pathlib import Path
import time
from typing import Any

from convseq_ros.baselines import local_features, vlad
from convseq_ros.baselines.local_features import Extract, inliers, Keypoints
from convseq_ros.baselines.loop_detector import detect, Detection
from convseq_ros.baselines.vocabulary import bag_scores, Vocabulary
from convseq_ros.core.map.reference_map import ReferenceMap
from convseq_ros.core.types import Candidate, Frame, Match, Reason, Status
from convseq_ros.evaluation.given_scores import PairScores
from convseq_ros.evaluation.material import described, Drive, Material
from convseq_ros.reading_config import ReadingConfig
from convseq_ros.sources import open_source
import numpy as np
import numpy.typing as npt

Vector = npt.NDArray[np.float32]
OPTIONS = 'alpha', 'vocabulary'
_WORD_BYTES = 8  # of a bag, for each word that an image has: its number and its weight


@dataclass(frozen=True, slots=True)
class _Peer:
    """How images become vectors, and vectors scores."""

    extract: Extract
    learn: Callable[[Sequence[Any]], Callable[[Any], Vector]]  # of some images, what describes one
    scores: Callable[[Vector, Vector], Vector]  # of one with some
    vector_bytes: Callable[[Vector], float]  # of all of a map, what is kept of one


_PEERS = {
    'orb-bow': _Peer(
        local_features.orb,
        lambda images: Vocabulary(images).bag,
        bag_scores,
        lambda rows: _WORD_BYTES * np.count_nonzero(rows) / len(rows),
    ),
    'sift-vlad': _Peer(
        local_features.root_sift,
        lambda images: partial(vlad.vlad, centres=vlad.learnt_centres(images)),
        lambda one, rows: rows @ one,
        lambda rows: rows[0].nbytes,
    ),
}


def peer_scores(
    material: Material, kind: str, alpha: float, vocabulary: str, reading: ReadingConfig
) -> PairScores:
    """Return what DBoW2 with ORB, `orb-bow`, or `sift-vlad` says, decided as by DLoopDetector."""
    peer = _PEERS[kind]
    query, extract_ms = _extracted(material.query, peer.extract)
    reference = query
    if not material.data_set.online:
        reference, _ = _extracted(material.reference, peer.extract)
    learnt_of = reference
    if vocabulary:
        learnt_of, _ = _extracted(open_source(Path(vocabulary), '', reading), peer.extract)
    describe = peer.learn([one.descriptors for one in learnt_of])
    started = time.perf_counter()
    vectors = np.array([describe(one.descriptors) for one in query])
    encode_ms = extract_ms + (time.perf_counter() - started) * 1e3 / len(query)
    known = np.array([describe(one.descriptors) for one in reference])
    usual = [float(peer.scores(new, old[None])[0]) for old, new in pairwise(vectors)]

    @cache
    def verify(frame: int, place: int) -> int:
        return inliers(query[frame], reference[place])

    def decide(
        rows: npt.NDArray[np.float32], first: int = 0, alpha: float = alpha
    ) -> list[Detection]:
        return detect(rows, [0.0, *usual], lambda frame, at: verify(frame, first + at), alpha)

    started = time.perf_counter()
    rows = np.array([peer.scores(one, known) for one in vectors])
    decide(rows)
    row_ms = (time.perf_counter() - started) * 1e3 / len(query)
    kept = np.mean([one.size_bytes for one in reference]) + peer.vector_bytes(known)
    return PairScores(rows, encode_ms, row_ms, detect=decide, place_bytes=float(kept))


def matches_of(found: Iterable[Detection], query: Drive, part: ReferenceMap) -> list[Match]:
    """Return detections as answers; the score is the share of keypoints that agree."""
    made = []
    for index, (one, stamp_ns) in enumerate(zip(found, query.stamps_ns, strict=True)):
        if one.reference is None:
            made.append(Match(index, stamp_ns, Status.SKIPPED, Reason.WEAK))
            continue
        place, score = part.places[one.reference], one.inliers / local_features.COUNT
        best = Candidate(one.reference, place.stamp_ns, score, inliers=one.inliers)
        status, reason = Status.REJECTED, Reason.WEAK
        if one.inliers:
            status, reason = Status.ACCEPTED, Reason.ACCEPTED
        made.append(Match(index, stamp_ns, status, reason, (best,), 1))
    return made


def _extracted(frames: Iterable[Frame], extract: Extract) -> tuple[list[Keypoints], float]:
    """Return the keypoints of each frame, none of an unreadable one, and the median time."""
    found, median_ms = described(frames, extract)
    nothing = extract(np.zeros((1, 1), np.uint8))
    return [nothing if one is None else one for one in found], median_ms
