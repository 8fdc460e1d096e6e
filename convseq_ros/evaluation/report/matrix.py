# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The similarity matrix of a run as a small picture, with truth and found path drawn over it."""

import base64
from collections.abc import Iterator, Sequence
from html import escape
from urllib.parse import quote

from convseq_ros.evaluation.plots import NIGHT
from convseq_ros.evaluation.report.charts import axes, Plane, svg
from convseq_ros.evaluation.report.verdict import right_spans, Seen
from convseq_ros.evaluation.run_folder import Run
import cv2
import numpy as np
import numpy.typing as npt

MOST_PIXELS = 320
MOST_BAND_ROWS = 400
MOST_DOTS = 1500
SIDE = 320.0


def matrix_figure(
    run: Run,
    scores: npt.NDArray[np.float32],
    truth: npt.NDArray[np.bool_] | None,
    seen: Sequence[Seen],
) -> str:
    """
    Return the matrix, its overlay and its caption.

    Parameters
    ----------
    run : Run
        Whose scores they are.
    scores : ndarray of float32, shape (Q, R)
        Pair scores, NaN where a pair was not scored.
    truth : ndarray of bool, shape (Q, R), or None
        Which references are right.
    seen : sequence of Seen
        What became of each query.

    """
    num_queries, num_references = scores.shape
    height = min(max(SIDE * num_queries / max(num_references, 1), 0.4 * SIDE), 1.5 * SIDE)
    plane = Plane(44, 26, SIDE, height, (-0.5, num_references - 0.5), (num_queries - 0.5, -0.5))
    total = (plane.left + SIDE + 10, plane.top + height + 40)
    body = axes(plane, 'reference', 'query', (0, 0))
    if truth is not None:
        body.append(f'<path class="truth" d="{"".join(_band(plane, truth))}"/>')
    step = -(-len(seen) // MOST_DOTS)
    body += [_dot(plane, one) for one in seen[:: max(step, 1)] if one.best is not None]
    label = f'Pair scores of {run.method} on {run.set}, {num_queries} x {num_references}'
    place = (
        f'left:{100 * plane.left / total[0]:.3f}%;top:{100 * plane.top / total[1]:.3f}%;'
        f'width:{100 * SIDE / total[0]:.3f}%;height:{100 * height / total[1]:.3f}%'
    )
    link = f'{quote(run.set)}/{quote(run.method)}'
    return (
        '<figure class="matrix">'
        f'<div class="plate" data-run="{link}" data-queries="{num_queries}">'
        f'<img src="{data_uri(matrix_picture(scores), "png")}" alt="{escape(label)}"'
        f' style="{place}">{svg(*total, label + ": truth and found path", body, "over")}</div>'
        f'<figcaption>{escape(run.method)}</figcaption></figure>'
    )


def matrix_picture(scores: npt.NDArray[np.float32]) -> bytes:
    """Return scores (Q, R) as a PNG: brighter is more similar, clear where nothing was scored."""
    small = _reduced(scores)
    known = np.isfinite(small)
    low, high = np.percentile(small[known], (1, 99.8)) if known.any() else (0.0, 1.0)
    share = np.clip((np.where(known, small, low) - low) / (high - low or 1), 0, 1)
    steps = np.round(share * 63) / 63 * (len(NIGHT) - 1)
    stops = np.array([[int(color[at : at + 2], 16) for at in (5, 3, 1)] for color in NIGHT])
    image = np.empty((*small.shape, 4), np.uint8)
    for channel in range(3):
        image[..., channel] = np.interp(steps, range(len(NIGHT)), stops[:, channel])
    image[..., 3] = np.where(known, 255, 0)
    return cv2.imencode('.png', image, [cv2.IMWRITE_PNG_COMPRESSION, 9])[1].tobytes()


def data_uri(content: bytes, kind: str) -> str:
    """Return a picture as an address that holds it."""
    return f'data:image/{kind};base64,{base64.b64encode(content).decode()}'


def _reduced(scores: npt.NDArray[np.float32]) -> npt.NDArray[np.float32]:
    """Keep the highest score of each block, so that a thin path survives."""
    for axis in (0, 1):
        block = -(-scores.shape[axis] // MOST_PIXELS)
        if block > 1:
            starts = np.arange(0, scores.shape[axis], block)
            scores = np.fmax.reduceat(scores, starts, axis=axis)
    return scores


def _band(plane: Plane, truth: npt.NDArray[np.bool_]) -> Iterator[str]:
    """Yield lines along both edges of the right references, from row to row where they go on."""
    step = max(1, -(-len(truth) // MOST_BAND_ROWS))
    before: list[tuple[int, int]] = []
    for query in range(0, len(truth), step):
        spans = right_spans(truth[query])
        for start, end in spans:
            goes_on = [one for one in before if one[0] <= end + 1 and start <= one[1] + 1]
            first, last = goes_on[0] if goes_on else (start, end)
            above = query - step if goes_on else query - 0.5
            below = query if goes_on else query + 0.5
            for old, new in ((first - 0.5, start - 0.5), (last + 0.5, end + 0.5)):
                x1, y1 = plane.at(old, above)
                x2, y2 = plane.at(new, below)
                yield f'M{x1:.1f} {y1:.1f}L{x2:.1f} {y2:.1f}'
        before = spans


def _dot(plane: Plane, one: Seen) -> str:
    x, y = plane.at(one.best or 0, one.query)
    return f'<circle cx="{x:.1f}" cy="{y:.1f}" r="2.1" class="dot {one.verdict}"/>'
