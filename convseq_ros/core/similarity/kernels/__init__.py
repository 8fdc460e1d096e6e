# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The kernel that scores pairs; README.md explains the compiled code."""

from convseq_ros.core.compiled import available
from convseq_ros.core.similarity.coherent import CoherentPair
from convseq_ros.core.similarity.kernels.numpy_coherent import NumpyCoherent


def coherent_kernel() -> CoherentPair:
    """Return the compiled kernel; without it, its definition, which has the same scores."""
    if not available():
        return NumpyCoherent()
    # Imported here: where the library is missing, this import fails.
    from convseq_ros.core.similarity.kernels.coherent import CompiledCoherent

    return CompiledCoherent()
