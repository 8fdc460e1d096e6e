# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A threshold for a set that was chosen on other sets only."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
import math
from typing import Any

from convseq_ros.evaluation.metrics import highest_wrong, share
from convseq_ros.evaluation.scorecard import Verdicts


@dataclass(frozen=True, slots=True)
class Measured:
    """What one method did on one set; sets of one `place` are never "other sets"."""

    set: str
    place: str
    verdicts: Verdicts


def transferred(own: Measured, all_sets: Sequence[Measured], criterion: str) -> Mapping[str, Any]:
    """
    Return what the strictest threshold that the other sets need does on this one.

    Parameters
    ----------
    own : Measured
        The set that is reported.
    all_sets : sequence of Measured
        The same method and protocol on all sets, this one included.
    criterion : str
        One of `CRITERIA`.

    Returns
    -------
    dict
        `threshold`: the highest value of a wrong answer on the other sets, slips left out; higher
        values are taken. `recall`: right answers taken, among the matched queries that have an
        answer. `false_closures`, `slips`: wrong ones taken. `others`: the sets it comes from.
        Empty if there is no other place.

    """
    others = [one for one in all_sets if one.place != own.place]
    if not others:
        return {}
    threshold = max(
        highest_wrong(
            (one.verdicts.correct | one.verdicts.slip)[one.verdicts.matched],
            one.verdicts.sure(criterion)[one.verdicts.matched],
        )
        for one in others
    )
    verdicts = own.verdicts
    taken = verdicts.taken(criterion, threshold)
    answerable = int((verdicts.matched & verdicts.known).sum())
    return {
        'threshold': threshold if math.isfinite(threshold) else None,
        'recall': share(int((taken & verdicts.correct).sum()), answerable),
        'false_closures': int((taken & ~verdicts.correct & ~verdicts.slip).sum()),
        'slips': int((taken & verdicts.slip).sum()),
        'others': [one.set for one in others],
    }
