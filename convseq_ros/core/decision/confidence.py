# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What is said of the best candidate, and how likely it is right."""

from dataclasses import dataclass
import math

from convseq_ros.core.constants import constants
from convseq_ros.core.decision.verified_evidence import VERIFIED
from convseq_ros.core.geometry.verification import Verification
from convseq_ros.core.types import Reason


@constants
class CONFIDENCE:
    """Of a logistic function; fitted by scripts/reliability.py, on dark images, too."""

    offset: float = -0.21  # log odds at an evidence of 1, off any track
    slope: float = 1.54  # log odds per e-fold
    least_evidence: float = 0.1  # added, so that none has a logarithm
    # Log odds of a track that all of the last frames lie on, times the square of their share:
    # chance leads here and there, and what is dark says little, but the same again and again.
    track: float = 6.39
    # Of the balance, by which evidence and that share count: where one side of a street repeats,
    # the other tells.
    power: int = 2


def confidence(evidence: float, share: float, balance: float = 1.0) -> float:
    """
    Return the probability that a candidate is right, in [0, 1].

    Given its evidence, the share of the last frames that lie on its track, in [0, 1], and how
    evenly both sides of the image verify it, in (0, 1].
    """
    even = balance**CONFIDENCE.power
    strength = math.log(max(evidence, 0.0) * even + CONFIDENCE.least_evidence)
    odds = CONFIDENCE.offset + CONFIDENCE.slope * strength + CONFIDENCE.track * share**2 * even
    return 1.0 / (1.0 + math.exp(-odds))


def balance(shown: Verification) -> float:
    """
    Return how evenly both sides of the image verify a place, in (0, 1]; 1 if nothing is verified.

    The weaker side over the stronger. What unrelated images have is added to both, so dark ones,
    in which little is verified, are even.
    """
    sides = shown.left, shown.strength - shown.left
    weaker, stronger = (VERIFIED.least_strength + one(sides) for one in (min, max))
    return weaker / stronger


@dataclass(frozen=True)
class Judgement:
    """What is said of the best candidate."""

    reason: Reason
    evidence: float | None = None  # for it, as `min_evidence` counts it, if anything is known
    share: float = 0.0  # of the last frames that lie on its track, in [0, 1]
    balance: float = 1.0  # of the sides of the image that verify it, in (0, 1]

    @property
    def confidence(self) -> float | None:
        """The probability that it is right, if anything is known."""
        if self.evidence is None:
            return None
        return confidence(self.evidence, self.share, self.balance)
