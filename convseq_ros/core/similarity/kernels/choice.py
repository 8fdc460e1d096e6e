# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Which kernels score pairs on this machine."""

from convseq_ros.config import MatchingConfig
from convseq_ros.core.compiled import available
from convseq_ros.core.similarity.kernels.instructions import float_tile, int8_tile
from convseq_ros.core.similarity.kernels.numpy_coherent import COHERENT_PAIR
from convseq_ros.core.similarity.kernels.numpy_regional import REGIONAL
from convseq_ros.core.similarity.pair_score import PairScore
from convseq_ros.errors import ConfigError

_DEFINITIONS = {'coherent': COHERENT_PAIR, 'regional': REGIONAL}


def chosen_kernels(matching: MatchingConfig) -> tuple[PairScore, PairScore]:
    """
    Return the kernel for a way of matching, and one whose scores are those of the definition.

    ConfigError if the machine cannot run the kernel that is asked for.
    """
    definition = _DEFINITIONS[matching.matching]
    wanted = matching.kernel
    if wanted in ('int8', 'float32') and not available():
        raise ConfigError(f'kernel: {wanted} needs numba 0.61 or later; install it or choose auto')
    if wanted == 'int8' and not int8_tile():
        raise ConfigError('kernel: int8 needs a processor with AVX2 or later; choose auto')
    if wanted == 'float32' and not float_tile():
        raise ConfigError('kernel: float32 needs a processor with AVX, or ARM; choose auto')
    if wanted == 'numpy' or not float_tile():
        return definition, definition
    # Importing these imports numba, which not everybody has.
    from convseq_ros.core.similarity.kernels import coherent, regional

    kernels = {'coherent': coherent, 'regional': regional}[matching.matching]
    exact = kernels.float32()
    if wanted == 'float32' or not int8_tile():
        return exact, exact
    return kernels.int8(), exact
