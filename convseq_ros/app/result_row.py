# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A match as a row of the result table."""

from convseq_ros.core.types import Match, Reason, RelativePose


def row(match: Match, duration_ms: float, source: str = '') -> dict[str, object]:
    """
    Return the row of a match; None, an empty field, for a value that is missing.

    `source` is the name of the image's file, or its topic, which is not written.
    """
    accepted, best, localization = match.accepted, match.best, match.localization
    shift = best.shift if best and best.shift else (None, None)
    rows_px, cols_px = match.shift_px or (None, None)
    return {
        'query_index': match.query_index,
        'query_stamp_ns': match.query_stamp_ns,
        'status': match.status.value,
        'reason': match.reason.value,
        'reference_index': accepted.reference_index if accepted else None,
        'reference_stamp_ns': accepted.reference_stamp_ns if accepted else None,
        'score': f'{accepted.score:.7f}' if accepted else None,
        'confidence': _decimals(match.confidence, 4),
        'sequence_length': match.sequence_length,
        'best_index': best.reference_index if best else None,
        'best_score': f'{best.score:.7f}' if best else None,
        'shift_rows': shift[0],
        'shift_cols': shift[1],
        'pairs_scored': match.pairs_scored,
        'duration_ms': f'{duration_ms:.3f}',
        'shift_rows_px': _decimals(rows_px, 1),
        'shift_cols_px': _decimals(cols_px, 1),
        'relative_yaw_rad': _decimals(match.relative_yaw_rad, 5),
        'inliers': best.inliers if best else None,
        'localization': localization.state.value if localization else None,
        'localization_quality': _decimals(localization.quality, 4) if localization else None,
        **_relative(match.relative_pose),
        'implausible_m': _decimals(match.implausible_m, 2),
        'session': best.session if best else None,
        'camera': match.camera or None,
        'anchor_session': match.anchor.session_id if match.anchor else None,
        'anchor_stamp_ns': match.anchor.stamp_ns if match.anchor else None,
        'image': None if '/' in source else source or None,
        'overlap': _decimals(match.overlap, 3),
    }


def _relative(pose: RelativePose | None) -> dict[str, str | None]:
    position: tuple[float | None, ...] = (pose and pose.position_m) or (None,) * 3
    turn: tuple[float | None, ...] = pose.orientation if pose else (None,) * 4
    values = [_decimals(x, 4) for x in position] + [_decimals(x, 6) for x in turn]
    names = [f'{axis}_m' for axis in 'xyz'] + [f'q{axis}' for axis in 'xyzw']
    return {
        **{f'relative_{name}': value for name, value in zip(names, values, strict=True)},
        'position_sigma_m': _decimals(pose.position_sigma_m, 4) if pose else None,
        'heading_sigma_rad': _decimals(pose.heading_sigma_rad, 5) if pose else None,
    }


def _decimals(value: float | None, count: int) -> str | None:
    return None if value is None else f'{value:.{count}f}'


COLUMNS = tuple(row(Match(0, 0, Reason.WEAK), 0.0))
