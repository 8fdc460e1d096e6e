# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Stamps of broken drivers: one for all messages, or whole seconds for several messages each."""

from collections.abc import Sequence

FIRST = 20  # messages of a topic that are looked at
_FEWEST = 3
_SECOND_NS = 1_000_000_000


def useless(stamps_ns: Sequence[int], log_times_ns: Sequence[int]) -> str:
    """
    Return how the stamps of a topic's first messages fail to tell their times; '' if they do not.

    The times of recording must be better, and stamps of 0, which means none to ROS, do not count.
    """
    count = len(set(stamps_ns))
    if len(stamps_ns) < _FEWEST or not any(stamps_ns) or len(set(log_times_ns)) <= count:
        return ''
    if count == 1:
        return 'one stamp'
    if count < len(stamps_ns) and not any(stamp_ns % _SECOND_NS for stamp_ns in stamps_ns):
        return f'{count} stamps of whole seconds'
    return ''
