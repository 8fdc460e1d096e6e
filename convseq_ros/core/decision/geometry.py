# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What the decision asks of the newest frame, beyond the scores that it is given."""

from collections.abc import Mapping, Sequence
from typing import Protocol

from convseq_ros.core.geometry.verification import Verification
from convseq_ros.core.types import Indices, Row


class Geometry(Protocol):
    """What can be scored and verified of the newest frame."""

    @property
    def row(self) -> Row | None:
        """Pair scores (R,), NaN where there is none; None if it shows nothing."""

    def score(self, count: int, ends: Indices) -> None:
        """Score what is missing of so many newest frames on diagonals, by their ends (n,)."""

    def verified(self, indices: Sequence[int]) -> Mapping[int, Verification]:
        """Return what geometry says of it and some references, if it is asked."""

    @property
    def verified_step(self) -> Verification | None:
        """What geometry says of it and the frame before, if it is asked."""
