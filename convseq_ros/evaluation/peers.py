# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What robots run today, on a data set: bags of words, VLAD, and trees of descriptors."""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from functools import cache, lru_cache, partial
from itertools import chain, pairwise
from pathlib import Path
import time
from typing import Any

from convseq_ros.baselines import local_features, vlad
from convseq_ros.baselines.hamming_tree import HammingTree
from convseq_ros.baselines.local_features import Extract, inliers, LocalFeatures, ROWS
from convseq_ros.baselines.loop_detector import CONSISTENT, detect, Detection
from convseq_ros.baselines.vocabulary import bag_scores, LEVELS, Vocabulary
from convseq_ros.config.reading_config import ReadingConfig
from convseq_ros.core.map.reference_map import ReferenceMap
from convseq_ros.core.types import Candidate, Frame, Match, Reason
from convseq_ros.evaluation.cache import Made
from convseq_ros.evaluation.drive import DescribedDrive
from convseq_ros.evaluation.given_scores import PairScores
from convseq_ros.evaluation.images import described, Images
from convseq_ros.evaluation.material import Material
from convseq_ros.sources import open_source
import numpy as np
import numpy.typing as npt

Vector = npt.NDArray[np.float32]
Keypoints = tuple[list[LocalFeatures], float]  # of each frame, and the median time in ms
OPTIONS = 'alpha', 'vocabulary', 'rows'
TREE_OPTIONS = 'levels', 'direct'  # of `orb-bow`
_CANDIDATES = 5  # best images of a tree that geometry verifies
_WORD_BYTES = 8  # of a bag, per word of the image: its number and its weight


@dataclass(frozen=True, slots=True)
class _Peer:
    """How images become vectors, and vectors become scores."""

    extract: Extract
    learn: Callable[[Sequence[Any], int], Any]  # words of images, in a tree of so many levels
    describe: Callable[[Any, Any], Vector]  # with words, descriptors (n, d)
    scores: Callable[[Vector, Vector], Vector]  # of a vector (D,) with others (R, D), (R,)
    vector_bytes: Callable[[Vector], float]  # mean size of a map's vectors (R, D)


PEERS = {
    'orb-bow': _Peer(
        local_features.orb,
        lambda images, levels: Vocabulary(images, levels=levels),
        Vocabulary.bag,
        bag_scores,
        lambda rows: _WORD_BYTES * np.count_nonzero(rows) / len(rows),
    ),
    'sift-vlad': _Peer(
        local_features.root_sift,
        lambda images, _: vlad.learnt_centres(images),
        lambda centres, rows: vlad.vlad(rows, centres),
        lambda vector, rows: rows @ vector,
        lambda rows: rows[0].nbytes,
    ),
}


def peer_scores(
    material: Material,
    kind: str,
    alpha: float,
    vocabulary: str,
    reading: ReadingConfig,
    image_rows: int = ROWS,
    levels: int = LEVELS,
    direct: int | None = None,
) -> PairScores:
    """
    Return the scores of `orb-bow` (DBoW2) or `sift-vlad`, with DLoopDetector's decision.

    Words are learnt of the map, or of the images in the folders of `vocabulary`, separated by
    commas. Smaller images are enlarged to `image_rows` rows. `levels` is the depth of the tree of
    words. If `direct` is given, only keypoints match that share the node so many levels above.
    """
    peer = PEERS[kind]
    (query, extract_ms), (reference, _) = _keypoints(material, peer.extract, image_rows)
    training = reference
    if vocabulary:
        each = (_in_folder(one, peer, image_rows, reading) for one in vocabulary.split(','))
        training = [*chain.from_iterable(each)]
    words = peer.learn([keypoints.descriptors for keypoints in training], levels)
    started = time.perf_counter()
    vectors = np.array([peer.describe(words, keypoints.descriptors) for keypoints in query])
    encode_ms = extract_ms + (time.perf_counter() - started) * 1e3 / len(query)
    places = np.array([peer.describe(words, keypoints.descriptors) for keypoints in reference])
    if direct is not None:  # its time does not count: it is met on the way to the words
        for drive in (query, reference):
            for at, one in enumerate(drive):
                drive[at] = replace(one, nodes=words.nodes(one.descriptors, direct))
    previous = [0.0, *(float(peer.scores(new, old[None])[0]) for old, new in pairwise(vectors))]

    @cache
    def verify(frame: int, place: int) -> int:
        return inliers(query[frame], reference[place])

    def decide(
        rows: npt.NDArray[np.float32],
        first: int = 0,
        alpha: float = alpha,
        consistent: int = CONSISTENT,
    ) -> list[Detection]:
        return detect(
            rows, previous, lambda frame, at: verify(frame, first + at), alpha, consistent
        )

    started = time.perf_counter()
    rows = np.array([peer.scores(vector, places) for vector in vectors])
    decide(rows)
    row_ms = (time.perf_counter() - started) * 1e3 / len(query)
    place_bytes = np.mean([item.size_bytes for item in reference]) + peer.vector_bytes(places)
    return PairScores(rows, encode_ms, row_ms, detect=decide, place_bytes=float(place_bytes))


def tree_scores(material: Material, image_rows: int = ROWS) -> PairScores:
    """
    Return the scores of `hbst`, with the decision on each frame by itself.

    A score is the share of the frame's ORB descriptors that a place has. Images are as for
    `peer_scores`.
    """
    (query, encode_ms), (reference, _) = _keypoints(material, local_features.orb, image_rows)
    tree = HammingTree()
    if not material.data_set.online:
        for keypoints in reference:
            tree.add(keypoints)

    @cache
    def verify(frame: int, place: int) -> int:
        return inliers(query[frame], reference[place])

    def decide(rows: npt.NDArray[np.float32], first: int = 0) -> list[Detection]:
        return verified_best(rows, lambda frame, at: verify(frame, first + at))

    scores = np.full((len(query), len(reference)), np.nan, np.float32)
    started = time.perf_counter()
    for row, keypoints in zip(scores, query, strict=True):
        row[: len(tree)] = tree.shares(keypoints)
        if material.data_set.online:
            tree.add(keypoints)
    decide(scores)
    row_ms = (time.perf_counter() - started) * 1e3 / len(query)
    place_bytes = float(np.mean([item.size_bytes for item in reference]))
    return PairScores(scores, encode_ms, row_ms, detect=decide, place_bytes=place_bytes)


def verified_best(
    rows: npt.NDArray[np.float32], verify: Callable[[int, int], int]
) -> list[Detection]:
    """
    Return for each frame which of its 5 best references has most inliers.

    `rows` (Q, R) are scores, NaN for a pair that must not match; 0 is no candidate. `verify`
    returns the inliers of a frame and a reference. Of equally many, the better score counts.
    """
    detections = []
    for frame, row in enumerate(rows):
        allowed = np.flatnonzero(row > 0)
        best = allowed[np.argsort(-row[allowed], kind='stable')][:_CANDIDATES].tolist()
        found = [Detection(at, verify(frame, at)) for at in best]
        detections.append(max(found, key=lambda item: item.inliers, default=Detection()))
    return detections


def matches_of(
    detections: Iterable[Detection], query: DescribedDrive, part: ReferenceMap
) -> list[Match]:
    """Return detections as matches; the score is the share of keypoints that are inliers."""
    matches = []
    for index, (detection, stamp_ns) in enumerate(zip(detections, query.stamps_ns, strict=True)):
        if detection.reference is None:
            matches.append(Match(index, stamp_ns, Reason.WEAK))
            continue
        place, score = part.places[detection.reference], detection.inliers / local_features.COUNT
        best = Candidate(detection.reference, place.stamp_ns, score, inliers=detection.inliers)
        reason = Reason.ACCEPTED if detection.inliers else Reason.WEAK
        matches.append(Match(index, stamp_ns, reason, (best,), 1))
    return matches


def _keypoints(material: Material, extract: Extract, rows: int) -> tuple[Keypoints, Keypoints]:
    """Return the keypoints of query and reference, whose images are enlarged to some rows."""

    def make(images: Images) -> Made:
        found, median_ms = _extracted(images, partial(extract, rows=rows))
        names = 'points_px', 'descriptors'
        return Made({'ms': median_ms}, {of: [getattr(one, of) for one in found] for of in names})

    def of(images: Images) -> Keypoints:
        made = images.once((extract.__name__, rows), lambda: make(images))
        return [*map(LocalFeatures, *made.rows.values())], made.facts['ms']

    return material.each(of)


@lru_cache(maxsize=32)
def _in_folder(folder: str, peer: _Peer, rows: int, reading: ReadingConfig) -> list[LocalFeatures]:
    """Return the keypoints of a folder's images; they are cached, as many data sets share them."""
    source = open_source(Path(folder), '', reading)
    return _extracted(source, partial(peer.extract, rows=rows))[0]


def _extracted(
    frames: Iterable[Frame], extract: Callable[[npt.NDArray[np.uint8]], LocalFeatures]
) -> Keypoints:
    """Return the keypoints per frame, empty if unreadable, and the median time in ms."""
    keypoints, median_ms = described(frames, extract)
    empty = extract(np.zeros((1, 1), np.uint8))
    return [empty if item is None else item for item in keypoints], median_ms
