# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Arrays kept on disk by what made them, so that a second run takes seconds."""

from collections.abc import Mapping
from functools import cache
import hashlib
import json
import os
from pathlib import Path
from typing import Any
import zipfile

from convseq_ros.results import complete_or_absent
from convseq_ros.sources.folder import pictures_in
import numpy as np
import numpy.typing as npt

Arrays = dict[str, npt.NDArray[Any]]
PACKAGE = Path(__file__).resolve().parents[1]


def default_folder() -> Path:
    """Return the folder that a desktop keeps for caches."""
    base = os.environ.get('XDG_CACHE_HOME') or Path.home() / '.cache'
    return Path(base, 'convseq_ros')


def digest(facts: Any) -> str:
    """Return a name for anything that JSON can say."""
    text = json.dumps(facts, sort_keys=True, default=str)
    return hashlib.sha256(text.encode()).hexdigest()


@cache
def program_digest() -> str:
    """Return a name for the program that computes what is kept: another version starts anew."""
    found = hashlib.sha256()
    for folder in ('core', 'baselines', 'simulation'):
        for path in sorted((PACKAGE / folder).rglob('*')):
            if path.suffix in ('.py', '.npy', '.so'):
                found.update(path.read_bytes())
    return found.hexdigest()[:16]


def content_digest(path: Path) -> str:
    """
    Return the SHA-256 of the list of images of a folder, or of the only file that there is.

    The list has a line for each, in the order of the frames, as `sha256sum` prints it: the SHA-256
    of its content, two spaces, its name. In a folder without images all files count.
    """
    found = [path] if path.is_file() else pictures_in(path)
    files = found or sorted(item for item in path.iterdir() if item.is_file())
    lines = hashlib.sha256()
    for item in files:
        with item.open('rb') as file:
            content = hashlib.file_digest(file, 'sha256').hexdigest()
        lines.update(f'{content}  {item.name}\n'.encode())
    return lines.hexdigest()


class Cache:
    """A folder of .npz files, without pickle; None keeps nothing, a damaged one is absent."""

    def __init__(self, folder: Path | None) -> None:
        self._folder = folder

    def get(self, kind: str, facts: Any) -> Arrays | None:
        """Return what was kept under a kind and the facts that determine it."""
        path = self._path(kind, facts)
        if path is None:
            return None
        try:
            with path.open('rb') as file, np.load(file, allow_pickle=False) as stored:
                return dict(stored)
        except (OSError, ValueError, KeyError, EOFError, zipfile.BadZipFile):
            return None

    def put(self, kind: str, facts: Any, arrays: Mapping[str, npt.NDArray[Any]]) -> None:
        """Keep arrays, in one step."""
        path = self._path(kind, facts)
        if path is None:
            return
        path.parent.mkdir(parents=True, exist_ok=True)
        with complete_or_absent(path) as part:
            np.savez(part, **arrays)  # type: ignore[arg-type]

    def _path(self, kind: str, facts: Any) -> Path | None:
        name = f'{digest([facts, program_digest()])}.npz'
        return self._folder and self._folder / kind / name
