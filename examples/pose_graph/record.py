# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What a pose graph was told, as a file from which it can be made again."""

from collections.abc import Sequence
import json
import os
from pathlib import Path

from graph import Closure, Odometry, Pose


def micro(stamp_ns: int) -> int:
    """Return microseconds, as exactly as seconds in a float64 keep them."""
    return round(stamp_ns / 1000)


def write_record(
    path: Path, odometry: Odometry, closures: Sequence[Closure], kept: Sequence[bool]
) -> None:
    """Write all odometry, all closures and what became of them; complete or not at all."""
    part = path.with_name(path.name + '.part')
    part.write_text(
        json.dumps(
            {
                'odometry': [[stamp_ns, *pose] for stamp_ns, pose in odometry.measured],
                'closures': [list(closure) for closure in closures],
                'kept': list(kept),
            }
        )
    )
    os.replace(part, path)


def read_record(path: Path) -> tuple[list[tuple[int, Pose]], list[Closure], list[bool]]:
    """Return stamped odometry, closures, and whether each closure was kept."""
    told = json.loads(path.read_text())
    odometry = [(stamp_ns, Pose(*pose)) for stamp_ns, *pose in told['odometry']]
    return odometry, [_closure(*closure) for closure in told['closures']], told['kept']


def _closure(
    query_ns: int,
    reference_ns: int,
    turn_rad: float | None = None,
    measured: Sequence[float] | None = None,
    covariance: Sequence[float] | None = None,
) -> Closure:
    pose = Pose(*measured) if measured else None
    return Closure(query_ns, reference_ns, turn_rad, pose, covariance and tuple(covariance))
