# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The order in which a person would sort numbered files."""

from pathlib import Path
import re


def natural_key(path: Path) -> tuple[list[tuple[int, str]], str]:
    """Return a sort key that puts img2 before img10; equal numbers are settled by spelling."""
    parts = re.findall(r'[0-9]+|[^0-9]+', path.name.casefold())
    keys = [(int(part), '') if part[0] in '0123456789' else (-1, part) for part in parts]
    return keys, path.name
