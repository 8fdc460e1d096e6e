# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Pair scores of one global descriptor per image."""

import numpy as np
import numpy.typing as npt


def cosine_scores(
    queries: npt.NDArray[np.float32], references: npt.NDArray[np.float32]
) -> npt.NDArray[np.float32]:
    """
    Return the cosine of every query (Q, D) with every reference (R, D), in [-1, 1]: (Q, R).

    Descriptors need not have unit length; a zero vector scores 0.

    """
    return _unit(queries) @ _unit(references).T


def _unit(rows: npt.NDArray[np.float32]) -> npt.NDArray[np.float32]:
    length = np.linalg.norm(rows, axis=1, keepdims=True)
    return np.divide(rows, length, out=np.zeros_like(rows), where=length > 0)
