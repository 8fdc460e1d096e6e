# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What all command lines share: whole names of options, and how a file is named."""

import argparse
from collections.abc import Iterable
import os
from pathlib import Path
from typing import Any
from urllib.parse import unquote

from convseq_ros.errors import ConfigError, printable


class Parser(argparse.ArgumentParser):
    """A parser that knows no abbreviations, and reads paths by `local`."""

    def __init__(self, **more: Any) -> None:
        super().__init__(allow_abbrev=False, **more)
        self.register('type', Path, _path)


def _path(text: str) -> Path:
    if not text:  # a variable of the shell that is not set; Path('') is the working folder
        raise argparse.ArgumentTypeError("'' names no file")
    return Path(local(text))


def refuse_foreign(words: Iterable[str]) -> None:
    """Raise a ConfigError for a word that is not UTF-8, unless it names a file."""
    for word in words:
        if word.encode('utf-8', 'ignore').decode() != word and not Path(word).exists():
            raise ConfigError(f"'{printable(word)}' is not UTF-8; write it in UTF-8")


def sentence(text: str) -> str:
    """Return a text with a capital letter and a full stop; ROS stays as it is."""
    return f'{text[0].upper()}{text[1:]}.'


def local(text: str) -> str:
    """Return a file's name: `~` is the home folder, and `file://` the start of an address."""
    if text.startswith('file://'):
        text = unquote(text.removeprefix('file://').removeprefix('localhost'))
    return os.path.expanduser(text)
