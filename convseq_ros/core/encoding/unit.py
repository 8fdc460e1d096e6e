# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Vectors of unit length."""

import numpy as np
import numpy.typing as npt


def unit(rows: npt.NDArray[np.floating]) -> npt.NDArray[np.float32]:
    """Return vectors, along the last axis, at unit length; zero ones stay zero."""
    length = np.sqrt(np.einsum('...i,...i->...', rows, rows))[..., None]
    return rows / np.where(length > 0, length, length.dtype.type(1))
