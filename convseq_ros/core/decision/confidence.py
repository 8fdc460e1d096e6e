# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What is said of the best candidate, and how likely it is right."""

from dataclasses import dataclass
import math

from convseq_ros.core.constants import constants
from convseq_ros.core.types import Reason


@constants
class CONFIDENCE:
    """Of a logistic function; fitted by scripts/fit_acceptance.py, on dark images, too."""

    offset: float = -0.4  # log odds at an evidence of 1, off any track
    slope: float = 1.4  # log odds per e-fold
    least_evidence: float = 0.1  # added, so that none has a logarithm
    # Log odds of a track that all of the last frames lie on, times the square of their share:
    # chance leads here and there, and what is dark says little, but the same again and again.
    track: float = 5.9


def confidence(evidence: float, share: float) -> float:
    """
    Return the probability that a candidate is right, in [0, 1].

    Given its evidence, and the share of the last frames that lie on its track, in [0, 1].
    """
    strength = math.log(max(evidence, 0.0) + CONFIDENCE.least_evidence)
    odds = CONFIDENCE.offset + CONFIDENCE.slope * strength + CONFIDENCE.track * share**2
    return 1.0 / (1.0 + math.exp(-odds))


@dataclass(frozen=True)
class Judgement:
    """What is said of the best candidate."""

    reason: Reason
    evidence: float | None = None  # for it, as `min_evidence` counts it, if anything is known
    share: float = 0.0  # of the last frames that lie on its track, in [0, 1]

    @property
    def confidence(self) -> float | None:
        """The probability that it is right, if anything is known."""
        return None if self.evidence is None else confidence(self.evidence, self.share)
