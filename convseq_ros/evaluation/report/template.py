# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Fills the template of a page."""

from collections.abc import Mapping
from importlib.resources import files
import json
from pathlib import Path
from string import Template
from typing import Any

from convseq_ros.io.regular_file import complete_or_absent


def write_page(output: Path, parts: Mapping[str, str], data: Mapping[str, Any]) -> None:
    """Write a page in one step, from HTML by placeholder and the data of its script."""
    template = Template((files(__package__) / 'template.html').read_text(encoding='utf-8'))
    text = json.dumps(data, separators=(',', ':')).replace('<', '\\u003c')
    with complete_or_absent(output) as part:
        part.write_text(template.substitute(parts, data=text), encoding='utf-8')


def photos(*names: str) -> str:
    """Return the HTML of the pictures of a pair."""
    return ''.join(
        f'<figure><div class="photo">no picture<img hidden alt="{name}"><svg></svg></div>'
        '<figcaption></figcaption></figure>'
        for name in names
    )
