# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Figures by matplotlib, which is imported only to draw one."""

from io import StringIO
from pathlib import Path
from typing import Any

from convseq_ros.errors import load
from convseq_ros.io.regular_file import complete_or_absent, MARK

_METADATA = {
    'png': {'Comment': MARK},
    'svg': {'Description': MARK, 'Date': None},
    'pdf': {'Subject': MARK, 'CreationDate': None},
}


def new_figure(width: float, height: float) -> Any:
    """Return an empty matplotlib figure, inches; ConvseqError if matplotlib is not installed."""
    return load('matplotlib.figure', 'a figure').Figure(figsize=(width, height), dpi=100)


def save(figure: Any, path: Path) -> None:
    """Write a figure as png, svg or pdf, by the suffix of the path; bytes are reproducible."""
    with complete_or_absent(path) as part:
        _draw(figure, part, path.suffix[1:])


def svg(figure: Any) -> str:
    """Return a figure as SVG, the same each time."""
    _draw(figure, buffer := StringIO(), 'svg', bbox_inches='tight')
    return buffer.getvalue()


def _draw(figure: Any, file: Path | StringIO, kind: str, **options: Any) -> None:
    from matplotlib import rc_context

    # Dollar signs are drawn as they are; the text between two would be parsed as a formula.
    for text in figure.findobj(lambda artist: hasattr(artist, 'set_parse_math')):
        text.set_parse_math(False)
    with rc_context({'svg.hashsalt': 'convseq_ros', 'pdf.fonttype': 42}):
        figure.savefig(file, format=kind, metadata=_METADATA[kind], **options)
