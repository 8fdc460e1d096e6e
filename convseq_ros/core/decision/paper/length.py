# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The choice of the sequence length k, by information gain and entropy (III-E, III-F)."""

from collections.abc import Callable, Sequence
from statistics import fmean

from convseq_ros.config import SequenceConfig
from convseq_ros.core.types import Descriptor


def choose_length(
    outward: Sequence[Descriptor],
    similarity: Callable[[Descriptor, Descriptor], float],
    config: SequenceConfig,
) -> int | None:
    """
    Return the sequence length k; None if that takes more frames than there are.

    `outward` starts with the anchor, which is informative. The sequence grows while its outermost
    frame overlaps the anchor (little information gain), by their pair score in [0, 1]; then while
    its mean entropy is too small.

    Notes
    -----
    Departures from the paper: (1) information gain is as in the released script:
    `similarity >= overlap_threshold` extends the sequence; (2) the shortest chosen length is 2,
    as there, and the paper's 1 only with `min_length` 1, where the next frame decides;
    (3) online, the anchor is the newest frame and the sequence extends into the past (the paper's
    anchor is the oldest frame and needs up to 24 future ones); (4) uninformative frames are
    ignored.

    """

    def overlaps(length: int) -> bool:
        other, least = outward[: max(2, length)][-1], config.overlap_threshold
        return not other.informative or similarity(outward[0], other) >= least

    available, length = len(outward), config.fixed_length or config.min_length
    if not config.fixed_length:
        most = min(config.max_overlap_length, config.max_length)
        while length < most and length <= available and overlaps(length):
            length += 1
        entropies = [frame.entropy for frame in outward[:length] if frame.informative]
        while length < config.max_length and length <= available:
            if fmean(entropies) > config.entropy_threshold:
                break
            entropies += [new.entropy for new in outward[length : length + 1] if new.informative]
            length += 1
    return length if length <= available else None
