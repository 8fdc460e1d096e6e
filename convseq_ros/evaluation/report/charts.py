# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Charts as inline SVG, coloured by the page's style sheet so that they follow its scheme."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from html import escape
import math

NUM_COLORS = 10
MOST_POINTS = 600


@dataclass(frozen=True, slots=True)
class Plane:
    """
    Where values land in a chart.

    Parameters
    ----------
    left, top, width, height : float
        The plotted area, in units of the view box.
    x, y : pair of float
        First and last value; y grows upwards unless its pair is given the other way round.

    """

    left: float
    top: float
    width: float
    height: float
    x: tuple[float, float]
    y: tuple[float, float]

    def at(self, x: float, y: float) -> tuple[float, float]:
        """Return the place of a value."""
        return (
            self.left + self.width * (x - self.x[0]) / (self.x[1] - self.x[0] or 1),
            self.top + self.height * (1 - (y - self.y[0]) / (self.y[1] - self.y[0] or 1)),
        )

    def points(self, xs: Iterable[float], ys: Iterable[float]) -> str:
        """Return the `points` of a polyline."""
        places = (self.at(x, y) for x, y in zip(xs, ys, strict=True))
        return ' '.join(f'{x:.1f},{y:.1f}' for x, y in places)


def svg(width: float, height: float, label: str, body: Iterable[str], style: str = '') -> str:
    """Return an SVG picture with a text for those who cannot see it."""
    return (
        f'<svg viewBox="0 0 {width:g} {height:g}" role="img" class="{style}"'
        f' aria-label="{escape(label)}">{"".join(body)}</svg>'
    )


def text(x: float, y: float, words: str, style: str = '', anchor: str = 'start') -> str:
    """Return words at a place."""
    return (
        f'<text x="{x:.1f}" y="{y:.1f}" class="{style}" text-anchor="{anchor}">'
        f'{escape(words)}</text>'
    )


def line(plane: Plane, start: tuple[float, float], end: tuple[float, float], style: str) -> str:
    """Return a straight line between two values."""
    (x1, y1), (x2, y2) = plane.at(*start), plane.at(*end)
    return f'<line x1="{x1:.1f}" y1="{y1:.1f}" x2="{x2:.1f}" y2="{y2:.1f}" class="{style}"/>'


def axes(
    plane: Plane, x_label: str, y_label: str, digits: tuple[int | None, int] = (1, 1)
) -> list[str]:
    """Return grid, ticks and labels; `digits` after the point on x (None: no ticks) and y."""
    body = []
    for value in ticks(*plane.x, whole=digits[0] == 0):
        body.append(line(plane, (value, plane.y[0]), (value, plane.y[1]), 'grid'))
        x, _ = plane.at(value, plane.y[0])
        foot = plane.top + plane.height + 15
        if digits[0] is not None:
            body.append(text(x, foot, f'{value:.{digits[0]}f}', 'tick', 'middle'))
    for value in ticks(*plane.y, whole=digits[1] == 0):
        body.append(line(plane, (plane.x[0], value), (plane.x[1], value), 'grid'))
        _, y = plane.at(plane.x[0], value)
        body.append(text(plane.left - 7, y + 4, f'{value:.{digits[1]}f}', 'tick', 'end'))
    middle, foot = plane.left + plane.width / 2, plane.top + plane.height + 33
    if x_label:
        body.append(text(middle, foot, x_label, 'axis', 'middle'))
    if y_label:
        body.append(text(plane.left, plane.top - 9, y_label, 'axis'))
    return body


def ticks(first: float, last: float, whole: bool = False) -> list[float]:
    """Return about five round values between two, whole ones if asked for."""
    low, high = sorted((first, last))
    rough = (high - low) / 5 or 1.0
    power = 10.0 ** math.floor(math.log10(rough))
    step = min((1, 2, 5, 10), key=lambda factor: abs(factor * power - rough)) * power
    step = max(step, 1.0) if whole else step
    start, end = math.ceil(low / step - 1e-9), math.floor(high / step + 1e-9)
    return [index * step for index in range(start, end + 1)]


def thinned(values: Sequence[float], most: int = MOST_POINTS) -> list[float]:
    """Return at most about `most` of the values, evenly spaced, with the first and the last."""
    if len(values) <= most:
        return list(values)
    last = len(values) - 1
    return [values[round(index * last / (most - 1))] for index in range(most)]


def method_style(index: int) -> str:
    """Return the classes of the n-th method; after ten the colours come again, dashed."""
    return f'c{index % NUM_COLORS}' + (' dashed' if index >= NUM_COLORS else '')
