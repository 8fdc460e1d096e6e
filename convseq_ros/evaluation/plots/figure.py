# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Figures and their files."""

from pathlib import Path
from typing import Any

from convseq_ros.errors import ConvseqError, pip_install
from convseq_ros.results import complete_or_absent

_DATES = {'svg': 'Date', 'pdf': 'CreationDate'}


def new_figure(width: float, height: float, face: str = 'white') -> Any:
    """Return an empty matplotlib figure, inches; ConvseqError if matplotlib is not installed."""
    try:
        from matplotlib.backends.backend_agg import FigureCanvasAgg
        from matplotlib.figure import Figure
    except ImportError:
        raise ConvseqError(f'figures need matplotlib: {pip_install("matplotlib")}') from None
    figure = Figure(figsize=(width, height), dpi=100, facecolor=face)
    FigureCanvasAgg(figure)
    return figure


def take_texts_literally(figure: Any) -> None:
    """Draw a dollar sign in a name as one; matplotlib would take two for a formula."""
    for text in figure.findobj(lambda artist: hasattr(artist, 'set_parse_math')):
        text.set_parse_math(False)


def save(figure: Any, *paths: Path, **options: Any) -> None:
    """
    Write a figure in the format that each name ends with: png, svg or pdf.

    A file is complete or absent. It has no date, so the same figure gives the same file.
    `options` are those of `savefig`.
    """
    from matplotlib import rc_context

    take_texts_literally(figure)
    for path in paths:
        kind = path.suffix[1:]
        undated = {_DATES[kind]: None} if kind in _DATES else None
        with complete_or_absent(path) as part:
            with rc_context({'svg.hashsalt': 'convseq_ros', 'pdf.fonttype': 42}):
                figure.savefig(part, format=kind, metadata=undated, **options)
