# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""One line of the table."""

from dataclasses import dataclass, replace
from typing import Self

import numpy as np

from bench.clock import Times


@dataclass(frozen=True, slots=True)
class Target:
    """
    What is wanted.

    Parameters
    ----------
    text : str
        For the table.
    met : bool
        Whether it was reached.

    """

    text: str
    met: bool


@dataclass(frozen=True, slots=True, kw_only=True)
class Finding:
    """
    What was measured of one side.

    Parameters
    ----------
    what : str
        What was done.
    side : str
        Who did it.
    value : float, optional
        The median; None if it could not be measured, and `note` says why.
    unit : str
        Of `value`, `low` and `high`.
    threads : int
        That it was allowed; so many cores, too.
    low, high : float, optional
        Quartiles over the runs.
    runs : int
        How many there were.
    times : float, optional
        How many times faster than `against`, taken in turn with it.
    against : str
        The other side.
    target : str
        What is wanted.
    met : bool, optional
        Whether it was reached.
    note : str
        What else should be known.

    """

    what: str
    side: str
    value: float | None = None
    unit: str = 'ms'
    threads: int = 1
    low: float | None = None
    high: float | None = None
    runs: int = 1
    times: float | None = None
    against: str = ''
    target: str = ''
    met: bool | None = None
    note: str = ''

    def timed(self, times: Times, part: float = 1.0) -> Self:
        """Return it with median and quartiles of some times, of a part of the work."""
        low, value, high = np.percentile(times.samples_ms, (25, 50, 75)) * part
        return replace(
            self, value=float(value), low=float(low), high=float(high), runs=len(times.samples_ms)
        )

    def noted(self, note: str) -> Self:
        """Return it with what else should be known."""
        return replace(self, note=note)

    def compared(self, times: float, against: str) -> Self:
        """Return it with how many times faster than another side it was."""
        return replace(self, times=times, against=against)

    def aiming(self, *targets: Target) -> Self:
        """Return it with what is wanted of it, all together."""
        return replace(
            self,
            target=', '.join(one.text for one in targets),
            met=all(one.met for one in targets) if targets else None,
        )


def at_least(found: float, wanted: float, unit: str = 'x') -> Target:
    """Return the target of something that should not be smaller."""
    return Target(f'at least {wanted:,g} {unit}', found >= wanted)


def at_most(found: float, wanted: float, unit: str) -> Target:
    """Return the target of something that should not be larger."""
    return Target(f'at most {wanted:,g} {unit}', found <= wanted)
