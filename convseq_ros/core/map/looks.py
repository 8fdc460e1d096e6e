# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Which look of a place tells least."""

import numpy as np
import numpy.typing as npt


def to_go(descriptors: npt.NDArray[np.float16]) -> int:
    """
    Return which of the looks of a place, by their global descriptors (n, m), goes.

    Of the two that are most alike it is the later one, so never the first, which is the anchor.
    """
    rows = descriptors.astype(np.float32)
    rows /= np.maximum(np.linalg.norm(rows, axis=1, keepdims=True), np.finfo(np.float32).tiny)
    alike = np.tril(rows @ rows.T, -1) - 2 * np.triu(np.ones((len(rows), len(rows))))
    return int(alike.argmax() // len(rows))
