# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A chart: one figure for the page, whose style sheet colours it, and for files."""

from html import escape
from importlib.resources import files
from io import StringIO
from pathlib import Path
import re
from typing import Any

from convseq_ros.evaluation.plots.figure import new_figure, save, take_texts_literally
import numpy as np
import numpy.typing as npt

NUM_COLORS = 10
MOST_POINTS = 2000
STYLE_SHEET = (files(__package__) / 'style.css').read_text(encoding='utf-8')
# What is drawn has the light colours of the page; on the page they become its variables again.
COLORS = dict(re.findall(r'--(\w+): light-dark\((#\w{6}),', STYLE_SHEET))
_NAMES = {COLORS[name]: name for name in COLORS if name not in ('accent', 'card', 'page', 'tint')}
_FOR_PAGE: Any = {
    'svg.fonttype': 'none',
    'svg.hashsalt': 'convseq_ros',
    'path.simplify_threshold': 0.3,
}


class Chart:
    """
    A figure, what it shows in words, and what its parts tell.

    Parameters
    ----------
    width, height : float
        Size on the page, points.
    label : str
        For those who cannot see it.
    title : str
        Stands above it in a file, where no page says what it is.

    """

    def __init__(self, width: float, height: float, label: str, title: str) -> None:
        self.figure = new_figure(width / 72, height / 72)
        self.label = label
        self._size = width, height
        self._parts: dict[str, tuple[str, str]] = {}
        # Above and beside the page's frame: only files, which are cut where drawing ends, show it.
        self._beside = [self.figure.text(0.5, 1, title, size=13, ha='center', va='bottom')]

    def plane(
        self, place: tuple[float, float, float, float], y_label: str, x_label: str, **settings: Any
    ) -> Any:
        """
        Return axes with a grid.

        Parameters
        ----------
        place : tuple of float
            Left, top, width and height in points, from the upper left corner.
        y_label, x_label : str
            What stands above the axes, for y, and below them.
        **settings
            Those of matplotlib's axes.

        """
        left, top, width, height = place
        full_width, full_height = self._size
        axes = self.figure.add_axes(
            (
                left / full_width,
                1 - (top + height) / full_height,
                width / full_width,
                height / full_height,
            ),
            facecolor='none',
            **settings,
        )
        axes.set_title(y_label, loc='left', color=COLORS['soft'], size=12, pad=8)
        axes.set_xlabel(x_label, color=COLORS['soft'], size=12)
        axes.spines[:].set_visible(False)
        axes.tick_params(length=0, width=0, pad=6, labelsize=11, labelcolor=COLORS['soft'])
        axes.grid(color=COLORS['rule'], linewidth=1)
        axes.set_axisbelow(True)
        return axes

    def mark(self, artist: Any, series: str, told: str) -> None:
        """Let the page light up an artist with its series, and tell something about it."""
        name = f'part{len(self._parts)}'
        artist.set_gid(name)
        self._parts[name] = series, told

    def add_legend(self, axes: Any) -> None:
        """Tell what the labels mean, beside the chart in a file; the page has its own legend."""
        handles, labels = axes.get_legend_handles_labels()
        if handles:
            legend = self.figure.legend(
                handles, labels, loc='upper left', bbox_to_anchor=(1, 1), frameon=False
            )
            self._beside.append(legend)

    def save(self, *paths: Path) -> None:
        """Write the chart as files: png, svg or pdf."""
        save(self.figure, *paths, bbox_inches='tight', dpi=150)

    def svg(self) -> str:
        """Return the chart as SVG for the page: its colours and its type are those of the page."""
        from matplotlib import rc_context

        take_texts_literally(self.figure)
        drawn = StringIO()
        for artist in self._beside:
            artist.set_visible(False)
        with rc_context(_FOR_PAGE):
            self.figure.savefig(drawn, format='svg', facecolor='none')
        for artist in self._beside:
            artist.set_visible(True)
        body = drawn.getvalue()
        body = body[body.index('<g id="figure_1">') : body.rindex('</svg>')]
        for pattern, new in (
            (r'\s*\n\s*', ' '),
            (r'<!--.*?-->', ''),
            (r'base64, ', 'base64,'),
            (r'(?<=>) (?=<)', ''),
            (r' (?:d|x|y)="[^"]*"', _short),
            (r' transform="rotate\(-?0 [^"]*"', ''),
            (r'font(-size)?: ([\d.]+px)[^";]*(; font-family: [^";]*)?', r'font-size: \2'),
            (r'#[0-9a-f]{6}\b', _variable),
            (r'<g id="(\w[^"]*)">', self._group),
            (r'xlink:href', 'href'),
        ):
            body = re.sub(pattern, new, body)
        width, height = self._size
        return (
            f'<svg viewBox="0 0 {width:g} {height:g}" role="img" class="chart"'
            f' aria-label="{escape(self.label)}">{body}</svg>'
        )

    def _group(self, found: re.Match[str]) -> str:
        if found[1] not in self._parts:
            return '<g>'
        series, told = map(escape, self._parts[found[1]])
        return f'<g data-series="{series}"><title>{told}</title>'


def _short(attribute: re.Match[str]) -> str:
    return re.sub(r'(\.\d\d)\d+', r'\1', attribute[0])


def _variable(color: re.Match[str]) -> str:
    return f'var(--{_NAMES[color[0]]})' if color[0] in _NAMES else color[0]


def method_color(index: int) -> str:
    """Return the colour of the n-th method; after ten they come again, see `method_dash`."""
    return COLORS[f'c{index % NUM_COLORS}']


def method_dash(index: int) -> str:
    """Return the line style of the n-th method."""
    return '--' if index >= NUM_COLORS else '-'


def thinned(values: npt.ArrayLike, most: int = MOST_POINTS) -> npt.NDArray[np.float64]:
    """Return at most `most` of the values (N,), evenly spaced, with the first and the last."""
    array = np.asarray(values, np.float64)
    if len(array) <= most:
        return array
    return array[np.linspace(0, len(array) - 1, most).round().astype(int)]
