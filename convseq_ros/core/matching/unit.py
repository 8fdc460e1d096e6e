# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Vectors of unit length."""

import numpy as np
import numpy.typing as npt


def unit(rows: npt.NDArray[np.floating]) -> npt.NDArray[np.float32]:
    """Return vectors, along the last axis, at unit length; zero ones stay zero."""
    length = np.linalg.norm(rows, axis=-1, keepdims=True)
    return np.divide(rows, length, out=np.zeros_like(rows), where=length > 0)
