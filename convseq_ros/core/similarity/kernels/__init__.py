# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Kernels that score pairs; README.md explains the compiled code."""

from convseq_ros.config import MatchingConfig
from convseq_ros.core.compiled import available, library
from convseq_ros.core.similarity.kernels.numpy_coherent import NumpyCoherent
from convseq_ros.core.similarity.kernels.numpy_regional import NumpyRegional
from convseq_ros.core.similarity.pair_score import PairScore
from convseq_ros.errors import ConfigError

_DEFINITIONS = {'coherent': NumpyCoherent('numpy', True), 'regional': NumpyRegional()}


def chosen_kernels(matching: MatchingConfig) -> tuple[PairScore, PairScore]:
    """Return the configured kernel, and an exact one; ConfigError if it cannot run here."""
    definition = _DEFINITIONS[matching.matching]
    wanted = matching.kernel
    if wanted == 'numpy' or (wanted == 'auto' and not available()):
        return definition, definition
    if not available():
        raise ConfigError(f'kernel: no {wanted}: {library().problem}; or choose auto')
    # Imported here: where the library is missing, these imports fail.
    from convseq_ros.core.similarity.kernels.coherent import CompiledCoherent
    from convseq_ros.core.similarity.kernels.regional import CompiledRegional

    pair = CompiledCoherent if matching.matching == 'coherent' else CompiledRegional
    exact = pair('float32')
    return (exact if wanted == 'float32' else pair('int8')), exact
