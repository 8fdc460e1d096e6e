# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Reads regular files only, and writes files that survive a power failure."""

from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
import os
from pathlib import Path
import stat
import tempfile

from convseq_ros.errors import SourceError

MARK = 'written by convseq_ros'  # is in files of this program, which may replace them
PART = '.part'  # ends the name of the folder in which a file is written before it is renamed
_KINDS = {
    stat.S_IFIFO: 'a pipe',
    stat.S_IFCHR: 'a device',
    stat.S_IFBLK: 'a device',
    stat.S_IFSOCK: 'a socket',
}


def refuse_irregular(path: Path) -> None:
    """Raise a SourceError for a pipe, a device or a socket: opening it may wait for ever."""
    try:
        kind = _KINDS.get(stat.S_IFMT(path.stat().st_mode))
    except (FileNotFoundError, NotADirectoryError):
        return
    except (OSError, ValueError) as error:
        reason = getattr(error, 'strerror', None) or error
        raise SourceError(f'{path}: {reason}; check the path') from None
    if kind:
        raise SourceError(f'{path}: is {kind}, not a file; give a file or a folder')


def read_bytes(path: Path, what: str, refuse: Callable[[Path, int], None]) -> bytes:
    """Return the content of a file; SourceError if it is missing, unreadable or refused."""
    refuse_irregular(path)
    try:
        if not path.is_file():
            raise SourceError(f'{path}: no such file; give {what}')
        with path.open('rb') as file:
            size = os.fstat(file.fileno()).st_size
            refuse(path, size)
            return file.read(size)
    except OSError as error:
        raise SourceError(f'{path}: {error.strerror}; check its permissions') from None


def sync(path: Path) -> None:
    """Wait until the content of a file, or the names in a folder, survive a power failure."""
    handle = os.open(path, os.O_RDONLY)
    try:
        os.fsync(handle)
    finally:
        os.close(handle)


def target_of(path: Path) -> Path:
    """Return the file that a symbolic link names, so that not the link is replaced."""
    return path.resolve() if path.is_symlink() else path


def replace_safely(part: Path, path: Path) -> None:
    """Rename `part` to `path`, which has its old or its new content whatever happens."""
    sync(part)
    os.replace(part, path)
    sync(path.parent)


@contextmanager
def complete_or_absent(path: Path) -> Iterator[Path]:
    """Yield an unused path to write a file to; rename it to `path`, which an OSError names."""
    target = target_of(path)
    try:
        with tempfile.TemporaryDirectory(PART, f'{target.name}.', target.parent) as folder:
            yield (part := Path(folder, target.name))
            replace_safely(part, target)
    except OSError as error:
        if error.filename is None or f'{target.name}.' in str(error.filename):
            error.filename = str(path)
        raise


def write_text(path: Path, text: str) -> None:
    """Write a text file in one step."""
    with complete_or_absent(path) as part:
        part.write_text(text, encoding='utf-8')


def write_lines(path: Path, lines: Iterable[str]) -> None:
    """Write a text file, in one step, after a comment that says by whom."""
    write_text(path, ''.join(f'{line}\n' for line in (f'# {MARK}', *lines)))
