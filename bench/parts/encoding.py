# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""From a gray image of 640 x 480 to its descriptor."""

from itertools import cycle

from convseq_ros.core.compiled import available
from convseq_ros.core.encoding.descriptor import describe

from bench.finding import at_least, at_most, Finding
from bench.released import encode
from bench.work import Work

_AGAINST = 'released steps'


def measure(work: Work) -> list[Finding]:
    """Compare our encoding, compiled or not, with the released steps."""
    own, theirs = cycle(work.images), cycle(work.images)
    times = work.in_turn(
        {'ours': lambda: describe(next(own)), _AGAINST: lambda: encode(next(theirs))}, 4
    )
    side, least, most_ms = ('compiled', 10, 3) if available() else ('NumPy alone', 3, 10)
    what, ours = 'encode an image', times['ours']
    faster = ours.faster_than(times[_AGAINST])
    return [
        Finding(what=what, side=_AGAINST).timed(times[_AGAINST]),
        Finding(what=what, side=f'ours, {side}')
        .timed(ours)
        .compared(faster, _AGAINST)
        .aiming(at_least(faster, least), at_most(ours.median, most_ms, 'ms')),
    ]
