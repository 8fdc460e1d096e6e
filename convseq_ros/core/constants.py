# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""One record of constants a stage: each number with its unit and where it comes from."""

from dataclasses import dataclass
from typing import Any


def constants(record: type[Any]) -> Any:
    """Return the one instance, frozen, of a class of annotated defaults: a stage's constants."""
    made: Any = dataclass(frozen=True, slots=True)(record)
    return made()
