# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Kernels that score pairs; README.md explains the compiled code."""

from convseq_ros.config import MatchingConfig
from convseq_ros.core.compiled import available, library
from convseq_ros.core.similarity.kernels.numpy_kernels import DEFINITIONS
from convseq_ros.core.similarity.pair_score import PairScore
from convseq_ros.errors import ConfigError


def chosen_kernels(matching: MatchingConfig) -> tuple[PairScore, PairScore]:
    """Return the configured kernel, and an exact one; ConfigError if it cannot run here."""
    definition = DEFINITIONS[matching.matching]
    wanted = matching.kernel
    if wanted == 'numpy' or (wanted == 'auto' and not available()):
        return definition, definition
    if not available():
        raise ConfigError(f'kernel: no {wanted}: {library().problem}; or choose auto')
    # Imported here: where the library is missing, this import fails.
    from convseq_ros.core.similarity.kernels.kernels import compiled_pair

    exact = compiled_pair(matching.matching, 'float32')
    return (exact if wanted == 'float32' else compiled_pair(matching.matching, 'int8')), exact
