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

Bits = npt.NDArray[np.uint8]  # (n, 32), 256 bits a descriptor
Signs = npt.NDArray[np.float32]  # (n, 256), each bit as -1 or 1
Words = npt.NDArray[np.int32]


def signs(descriptors: Bits) -> Signs:
    """Return the bits of descriptors (n, b) as -1 and 1, (n, 8 b)."""
    return np.unpackbits(descriptors, axis=1).astype(np.float32) * 2 - 1


def medians(descriptors: Signs, count: int, rng: np.random.Generator) -> Signs:
    """Return at most `count` bitwise medians (k, 256), by k-medians started as in k-means++."""
    centres = descriptors[[rng.integers(len(descriptors))]]
    nearest = _distances(descriptors, centres)[:, 0]
    while len(centres) < count and nearest.any():
        chances = np.cumsum(nearest.astype(np.float64) ** 2)
        drawn = np.searchsorted(chances / chances[-1], rng.random(), 'right')
        centres = np.append(centres, descriptors[[drawn]], axis=0)
        nearest = np.minimum(nearest, _distances(descriptors, centres[-1:])[:, 0])
    assigned = np.full(len(descriptors), -1)
    for _ in range(_ROUNDS):
        before, assigned = assigned, _distances(descriptors, centres).argmin(axis=1)
        if (assigned == before).all():
            break
        members = assigned == np.arange(len(centres))[:, None]
        sums = members.astype(np.float32) @ descriptors
        is_met = members.any(axis=1)
        centres = np.where(sums[is_met] >= 0, np.float32(1), np.float32(-1))
        assigned = (np.cumsum(is_met) - 1)[assigned]
    return centres


def _distances(descriptors: Signs, centres: Signs) -> npt.NDArray[np.float32]:
    """Return the Hamming distances, (n, k)."""
    return (descriptors.shape[1] - descriptors @ centres.T) / 2


class Vocabulary:
    """Words learnt from descriptors (n, 32) of images, with inverse document frequencies (W,)."""

    def __init__(
        self, images: Sequence[Bits], branches: int = BRANCHES, levels: int = LEVELS
    ) -> None:
        self._branches, self._levels, self._words = branches, levels, 0
        self._random = np.random.default_rng(_SEED)
        every = np.concatenate(images)
        most = min(_MOST, _PER_WORD * branches**levels)
        sample = every[self._random.permutation(len(every))[:most]]
        grown = list[tuple[Bits, Words]]()
        if len(sample):
            self._grow(sample, levels, grown)
        # For each inner node of the tree, the centres of its branches, and their targets: a node,
        # or a word w as -1 - w. A node with fewer branches repeats them.
        centres, leads = [node for node, _ in grown], [node for _, node in grown]
        self._centres = np.array(centres, np.uint8).reshape(-1, branches, 32)
        self._leads = np.array(leads, np.int32).reshape(-1, branches)
        counts = np.zeros(self._words)
        for one in images:
            counts[np.unique(self.words(one))] += 1
        self.idf = np.log(max(1, len(images)) / np.maximum(counts, 1)).astype(np.float32)

    def __len__(self) -> int:
        return self._words

    def _grow(self, descriptors: Bits, levels: int, grown: list[tuple[Bits, Words]]) -> int:
        """Add a node with its subtree; return its number."""
        centres = medians(signs(descriptors[:_OF_NODE]), self._branches, self._random)
        bits, every = np.packbits(centres > 0, axis=1), np.arange(self._branches) % len(centres)
        _, assigned = cv2.batchDistance(
            descriptors, bits, cv2.CV_32S, normType=cv2.NORM_HAMMING, K=1
        )
        node, leads = len(grown), np.zeros(len(centres), np.int32)
        grown.append((bits[every], leads))
        for number in range(len(centres)):
            members = descriptors[assigned[:, 0] == number]
            if levels > 1 and len(members) > self._branches:
                leads[number] = self._grow(members, levels - 1, grown)
            else:
                self._words += 1
                leads[number] = -self._words
        grown[node] = bits[every], leads[every]
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
