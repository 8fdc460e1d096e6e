# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""VLAD of local descriptors (Jegou et al. 2010; Arandjelovic and Zisserman 2013)."""

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

CENTRES = 64
_ROUNDS = 20  # of k-means
_MOST = 60_000  # descriptors for k-means, drawn at random
_SEED = 0

Rows = npt.NDArray[np.float32]


def nearest(rows: Rows, centres: Rows) -> npt.NDArray[np.int64]:
    """Return the index of the nearest centre (k, d) for each row (n, d), (n,)."""
    distances = (centres**2).sum(axis=1) - 2 * rows @ centres.T
    return np.asarray(distances.argmin(axis=1), np.int64)


def means(rows: Rows, centres: Rows, rounds: int = _ROUNDS) -> Rows:
    """Return k-means centres (k, d) after rounds of Lloyd; a centre without rows stays."""
    centres = centres.copy()
    for _ in range(rounds):
        assigned = nearest(rows, centres)
        for number in range(len(centres)):
            if (members := rows[assigned == number]).size:
                centres[number] = members.mean(axis=0)
    return centres


def learnt_centres(images: Sequence[Rows], count: int = CENTRES) -> Rows:
    """Return `count` centres of the images' descriptors (n, d), or fewer if there are fewer."""
    rows, random = np.concatenate(images), np.random.default_rng(_SEED)
    rows = rows[random.permutation(len(rows))[:_MOST]]
    return means(rows, rows[:count] if len(rows) else np.zeros((1, rows.shape[1]), np.float32))


def vlad(rows: Rows, centres: Rows) -> Rows:
    """Return one vector (k d,) of unit length, or all 0, for descriptors (n, d) of an image."""
    sums, assigned = np.zeros_like(centres), nearest(rows, centres)
    np.add.at(sums, assigned, rows - centres[assigned])
    sums /= np.maximum(np.linalg.norm(sums, axis=1, keepdims=True), 1e-12)
    rooted = np.sign(sums) * np.sqrt(np.abs(sums))
    return np.asarray((rooted / max(float(np.linalg.norm(rooted)), 1e-12)).ravel(), np.float32)
