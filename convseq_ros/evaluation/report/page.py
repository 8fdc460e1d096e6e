# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""One page of results: tables, figures by matplotlib, and pairs of pictures, by jinja2."""

from base64 import b64encode
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from importlib.resources import files
from pathlib import Path
from typing import TypeVar

from convseq_ros.errors import load
from convseq_ros.io.regular_file import write_text
import numpy as np

Item = TypeVar('Item')
MOST_PICTURES = 500  # on a page; with 25 kB each, and a third more in base64, below 20 MB
_FEWEST = 4  # pairs of a kind that are shown at least


@dataclass(frozen=True, slots=True)
class Pair:
    """Pictures side by side, JPEG, empty where there is none, and what is said of them."""

    caption: str
    pictures: tuple[bytes, ...]


@dataclass(frozen=True, slots=True)
class Section:
    """A part of the page: captions with their SVG, and pairs by kind, in the order shown."""

    title: str
    facts: str = ''
    figures: Sequence[tuple[str, str]] = ()
    pairs: Mapping[str, Sequence[Pair]] = field(default_factory=dict)


def write_page(
    output: Path,
    title: str,
    facts: str,
    sections: Sequence[Section],
    made: Mapping[str, str],
    table: str = '',
) -> None:
    """
    Write a page that needs no other file, in one step.

    `table` is HTML that is trusted; all other texts are escaped. `made` says, by name, how each
    result was made. Of many pairs, evenly as many are shown as fit. ConvseqError without jinja2.
    """
    kinds = [pairs for section in sections for pairs in section.pairs.values() if pairs]
    pictures = max((len(pairs[0].pictures) for pairs in kinds), default=1)
    most = max(_FEWEST, MOST_PICTURES // (pictures * max(1, len(kinds))))
    environment = load('jinja2', 'a page').Environment
    jinja = environment(autoescape=True, trim_blocks=True, lstrip_blocks=True)
    jinja.filters['base64'] = as_base64
    jinja.filters['evenly'] = lambda pairs: evenly(pairs, most)
    template = jinja.from_string((files(__package__) / 'template.html').read_text('utf-8'))
    text = template.render(title=title, facts=facts, sections=sections, made=made, table=table)
    write_text(output, text)


def evenly(items: Sequence[Item], most: int) -> list[Item]:
    """Return all items, or at most so many, evenly, with the first and the last."""
    chosen = np.linspace(0, len(items) - 1, min(len(items), most)).astype(int)
    return [items[at] for at in chosen]


def as_base64(content: str | bytes) -> str:
    """Return a file's content as it stands in an address."""
    return b64encode(content.encode() if isinstance(content, str) else content).decode()
