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
    return hashlib.sha256(text.encode()).hexdigest()[:32]


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
    """Return a name for the content of a file, or of the files in a folder and their names."""
    found = hashlib.blake2b(digest_size=16)
    files = [path] if path.is_file() else sorted(item for item in path.iterdir() if item.is_file())
    for item in files:
        found.update(f'{item.name}\0{item.stat().st_size}\0'.encode())
        with item.open('rb') as file:
            while chunk := file.read(1 << 20):
                found.update(chunk)
    return found.hexdigest()


class Cache:
    """
    A folder of .npz files, without pickle; a damaged one counts as absent.

    Parameters
    ----------
    folder : Path or None
        None keeps nothing.

    """

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
