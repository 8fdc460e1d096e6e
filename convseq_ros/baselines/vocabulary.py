# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A vocabulary tree of binary descriptors, and bags of words weighted by tf-idf, as in DBoW2."""

from collections.abc import Sequence

import cv2
import numpy as np
import numpy.typing as npt

BRANCHES, LEVELS = 10, 4  # at most 10,000 words; DLoopDetector's and ORB-SLAM's have 6 levels
_ROUNDS = 10  # of k-medians; later, few descriptors change
_PER_WORD, _MOST = 6, 1_000_000  # descriptors for training, drawn at random
_OF_NODE = 60_000  # descriptors for the medians of a node; all are then assigned
_SEED = 0

_ONES = np.unpackbits(np.arange(256, dtype=np.uint8)[:, None], axis=1).sum(axis=1, dtype=np.uint8)

Bits = npt.NDArray[np.uint8]  # (n, b), 8 b bits a descriptor; ORB's b is 32
Words = npt.NDArray[np.int32]


def medians(descriptors: Bits, count: int, rng: np.random.Generator) -> Bits:
    """Return at most `count` bitwise medians (k, b), by k-medians started as in k-means++."""
    centres = descriptors[[rng.integers(len(descriptors))]]
    away, _ = _nearest(descriptors, centres)
    while len(centres) < count and away.any():
        chances = np.square(away, dtype=np.float64).cumsum()
        drawn = (chances / chances[-1]).searchsorted(rng.random(), 'right')
        centres = np.concatenate((centres, descriptors[[drawn]]))
        away = np.minimum(away, _nearest(descriptors, centres[-1:])[0])
    assigned = np.full(len(descriptors), -1)
    ones, sizes = np.zeros((len(centres), 8 * descriptors.shape[1])), np.zeros(len(centres))
    for _ in range(_ROUNDS):
        before, (_, assigned) = assigned, _nearest(descriptors, centres)
        moved = (assigned != before).nonzero()[0]
        if not len(moved):
            break
        numbers = np.arange(len(centres))[:, None]
        joined, left = assigned[moved] == numbers, before[moved] == numbers
        change = joined.astype(np.float32) - left
        ones += change @ np.unpackbits(descriptors[moved], axis=1).astype(np.float32)
        sizes += change.sum(axis=1)
        is_met = sizes > 0
        ones, sizes = ones[is_met], sizes[is_met]
        centres = np.packbits(2 * ones >= sizes[:, None], axis=1)
        assigned = (is_met.cumsum() - 1)[assigned]
    return centres


def _nearest(
    descriptors: Bits, centres: Bits
) -> tuple[npt.NDArray[np.int32], npt.NDArray[np.int32]]:
    """Return the Hamming distance (n,) of each descriptor to its nearest centre, and which."""
    distances, nearest = cv2.batchDistance(
        descriptors, centres, cv2.CV_32S, normType=cv2.NORM_HAMMING, K=1
    )
    return distances[:, 0], nearest[:, 0]


class Vocabulary:
    """Words learnt from descriptors (n, 32) of images, with inverse document frequencies (W,)."""

    def __init__(
        self, images: Sequence[Bits], branches: int = BRANCHES, levels: int = LEVELS
    ) -> None:
        self._branches, self._levels, self._words = branches, levels, 0
        self._random = np.random.default_rng(_SEED)
        every = np.concatenate(images)
        order, found = self._random.permutation(len(every)), np.zeros(len(every), np.int32)
        grown = list[tuple[Bits, Words]]()
        if len(every):
            most = min(len(every), _MOST, _PER_WORD * branches**levels)
            self._grow(every, order, most, levels, grown, found)
        # For each inner node of the tree, the centres of its branches, and their targets: a node,
        # or a word w as -1 - w. A node with fewer branches repeats them.
        centres, leads = [node for node, _ in grown], [node for _, node in grown]
        self._centres = np.array(centres, np.uint8).reshape(-1, branches, 32)
        self._leads = np.array(leads, np.int32).reshape(-1, branches)
        counts, last = np.zeros(self._words), np.cumsum([len(one) for one in images])
        for one in np.split(found, last[:-1]):
            counts[np.unique(one)] += 1
        self.idf = np.log(max(1, len(images)) / np.maximum(counts, 1)).astype(np.float32)

    def __len__(self) -> int:
        return self._words

    def _grow(
        self,
        every: Bits,
        at: npt.NDArray[np.int64],
        trained: int,
        levels: int,
        grown: list[tuple[Bits, Words]],
        found: Words,
    ) -> int:
        """
        Add a node with its subtree; return its number.

        It has the descriptors `at` some rows, and learns of the first `trained` of them. The word
        of each goes to `found`.
        """
        descriptors = every[at]
        centres = medians(descriptors[: min(trained, _OF_NODE)], self._branches, self._random)
        count, (_, assigned) = len(centres), _nearest(descriptors, centres)
        by_branch = at[assigned.argsort(kind='stable')]
        ends = np.bincount(assigned, minlength=count).cumsum()
        learnt_of = np.bincount(assigned[:trained], minlength=count)
        node, leads = len(grown), np.zeros(count, np.int32)
        repeated = np.arange(self._branches) % count
        grown.append((centres[repeated], leads))
        for number, members in enumerate(np.split(by_branch, ends[:-1])):
            if levels > 1 and learnt_of[number] > self._branches:
                arguments = int(learnt_of[number]), levels - 1, grown, found
                leads[number] = self._grow(every, members, *arguments)
            else:
                found[members] = self._words
                self._words += 1
                leads[number] = -self._words
        grown[node] = centres[repeated], leads[repeated]
        return node

    def words(self, descriptors: Bits) -> Words:
        """Return the word of each descriptor (n, 32), along the nearest branches: (n,)."""
        return -1 - self.nodes(descriptors, 0)

    def nodes(self, descriptors: Bits, above: int) -> Words:
        """
        Return the node of each descriptor (n, 32) so many levels above the deepest words: (n,).

        It is -1 - w where a word w is not as deep.
        """
        at = np.full(len(descriptors), 0 if self._words else -1, np.int32)
        for _ in range(self._levels - above):
            inside = np.flatnonzero(at >= 0)
            nodes = at[inside]
            differ = descriptors[inside, None] ^ self._centres[nodes]
            nearest = _ONES[differ].sum(axis=2, dtype=np.int16).argmin(axis=1)
            at[inside] = self._leads[nodes, nearest]
        return at

    def bag(self, descriptors: Bits) -> npt.NDArray[np.float32]:
        """Return the tf-idf weights of an image's words, (W,), with sum 1, or all 0."""
        counts = np.bincount(self.words(descriptors), minlength=self._words)[: self._words]
        weights = counts * self.idf if len(descriptors) else np.zeros(self._words)
        return (weights / max(float(weights.sum()), 1e-12)).astype(np.float32)


def bag_scores(
    query: npt.NDArray[np.float32], references: npt.NDArray[np.float32]
) -> npt.NDArray[np.float32]:
    """Return DBoW2's L1 scores of a bag (W,) with others (R, W), in 0..1, (R,)."""
    there = np.flatnonzero(query)
    return np.asarray(np.minimum(query[there], references[:, there]).sum(axis=1), np.float32)
