# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""How many frames are matched together (paper III-A, E, F)."""

from collections.abc import Callable, Sequence
from statistics import fmean

from convseq_ros.config import SequenceConfig
from convseq_ros.core.types import Descriptor


def choose_length(
    outward: Sequence[Descriptor],
    similarity: Callable[[Descriptor, Descriptor, float], float],
    config: SequenceConfig,
) -> int | None:
    """
    Return the length k of the sequence of frames outward from the first, the informative anchor.

    It grows while its outermost frame still overlaps the anchor (little information gain), by
    their pair score in [0, 1], then while it holds too little entropy. None is returned if that
    takes more frames than there are. `similarity` is told against what a score is compared.

    Notes
    -----
    With the following departures from the paper: (1) information gain is read as the released
    script does, `similarity >= overlap_threshold` extends; (2) the shortest chosen length is 2;
    (3) online, the anchor is the newest frame and the sequence reads into the past (the paper's
    anchor is the oldest frame and needs up to 24 future ones); (4) uninformative frames are passed
    over.

    """

    def overlaps(length: int) -> bool:
        other, least = outward[length - 1], config.overlap_threshold
        return not other.informative or similarity(outward[0], other, least) >= least

    available, length = len(outward), config.fixed_length or config.min_length
    if not config.fixed_length:
        while length < config.max_overlap_length and length <= available and overlaps(length):
            length += 1
        entropies = [one.entropy for one in outward[:length] if one.informative]
        while length < config.max_length and length <= available:
            if fmean(entropies) > config.entropy_threshold:
                break
            entropies += [one.entropy for one in outward[length : length + 1] if one.informative]
            length += 1
    return length if length <= available else None
