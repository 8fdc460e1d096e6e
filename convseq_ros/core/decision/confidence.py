# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""How likely a match is right, given the evidence for it."""

import math

from convseq_ros.core.constants import constants


@constants
class CONFIDENCE:
    """Between what fits drawn streets that repeat, and dark images (scripts/fit_acceptance.py)."""

    offset: float = -0.2  # of a logistic function: log odds at an evidence of 1
    slope: float = 2.1  # log odds per e-fold
    least_evidence: float = 0.1  # added, so that none has a logarithm


def confidence(evidence: float) -> float:
    """Return the probability that a candidate is right, in [0, 1], given its track evidence."""
    strength = math.log(max(evidence, 0.0) + CONFIDENCE.least_evidence)
    return 1.0 / (1.0 + math.exp(-CONFIDENCE.offset - CONFIDENCE.slope * strength))
