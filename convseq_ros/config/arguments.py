# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What all command lines share: whole names of options, and how a file is named."""

import argparse
import os
from pathlib import Path
from typing import Any
from urllib.parse import unquote


class Parser(argparse.ArgumentParser):
    """A parser that knows no abbreviations, and reads paths by `local`."""

    def __init__(self, **more: Any) -> None:
        super().__init__(allow_abbrev=False, **more)
        self.register('type', Path, lambda text: Path(local(text)))


def local(text: str) -> str:
    """Return a file's name: `~` is the home folder, and `file://` the start of an address."""
    if text.startswith('file://'):
        text = unquote(text.removeprefix('file://').removeprefix('localhost'))
    return os.path.expanduser(text)
