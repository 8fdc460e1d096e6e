# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Figures of one method on one set that need the other methods, or the other sets."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from convseq_ros.evaluation.calibration import calibration
from convseq_ros.evaluation.metrics import performance_per_compute_unit
from convseq_ros.evaluation.protocols import CLOSED
from convseq_ros.evaluation.transfer import Measured, transferred

Summary = dict[str, Any]


@dataclass(frozen=True, slots=True)
class Result:
    """What one method did on one set: its folder, its figures and its verdicts."""

    folder: Path
    summary: Summary
    measured: Measured


def compare_times(summaries: Sequence[Summary]) -> None:
    """Add PCU to the summaries of one set."""
    times = [one['encode_ms'] for one in summaries if one['encode_ms']]
    for one in summaries:
        if one['encode_ms'] and one['accuracy_matched'] is not None:
            one['pcu'] = performance_per_compute_unit(
                one['accuracy_matched'], one['encode_ms'], max(times)
            )


def transfer(own: Result, results: Sequence[Result], criterion: str) -> None:
    """Add what a threshold from the other places does."""
    alike = [one.measured for one in results if _alike(one, own, 'method', 'protocol')]
    own.summary['transferred'] = dict(transferred(own.measured, alike, criterion)) or None


def calibrate(own: Result, results: Sequence[Result]) -> None:
    """
    Add how reliable the confidence is.

    Fits take the sets where a place may be missing from the map: with the whole map nearly every
    answer is right.
    """
    alike = [
        one.measured
        for one in results
        if _alike(one, own, 'method') and one.summary['protocol'] != CLOSED
    ]
    own.summary['calibration'] = dict(calibration(own.measured, alike)) or None


def _alike(one: Result, other: Result, *names: str) -> bool:
    return all(one.summary[name] == other.summary[name] for name in names)
