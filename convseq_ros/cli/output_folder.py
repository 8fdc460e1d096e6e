# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The folder that a demo makes anew every time."""

from pathlib import Path
import shutil

from convseq_ros.errors import ConvseqError


def make_empty(folder: Path, marker: str) -> None:
    """
    Make a folder anew if a demo, which knows its own by a file of that name, made it before.

    ConvseqError if somebody else made it, and it is not empty.
    """
    mark = folder / marker
    if folder.exists() and any(folder.iterdir()) and not mark.is_file():
        raise ConvseqError(f'{folder}: exists and is not of an earlier demo; choose another')
    shutil.rmtree(folder, ignore_errors=True)
    folder.mkdir(parents=True)
    mark.touch()
