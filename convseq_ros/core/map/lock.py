# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Who may write a map: one program at a time, for as long as it lives."""

from contextlib import suppress
import fcntl
import os
from pathlib import Path
import re
import stat
from typing import Self

from convseq_ros.errors import MapError

PART = '.part'  # the end of a folder beside a map, in which one is made that replaces it
BESIDE = '-journal', '-wal', '-shm'  # SQLite's files
_MADE = re.compile(r'[a-z0-9_]{8}')  # what `tempfile` puts between a map's name and the end


class MapLock:
    """
    A lock on a map by its name, `<map>-lock` beside it; MapError if another owner holds it.

    The system releases it when the program ends, however it does; what a crash leaves of the file
    holds nobody up, and parts of maps are deleted. It is not a lock on the map itself: one that is
    closed would take SQLite's with it. Readers need none.
    """

    def __init__(self, path: Path) -> None:
        _refuse_read_only(path)
        self._path = path.resolve()
        self._path = self._path.with_name(self._path.name + '-lock')
        while True:
            try:
                self._file = os.open(self._path, os.O_CREAT | os.O_NOFOLLOW, 0o666)
            except OSError as error:
                raise MapError(f'{path}: cannot be written ({error.strerror})') from None
            try:
                fcntl.flock(self._file, fcntl.LOCK_EX | fcntl.LOCK_NB)
                if self._is_of_this_name():
                    _delete_parts(path)
                    return
            except BlockingIOError:
                os.close(self._file)
                raise MapError(
                    f'{path}: another program adds to this map; end it, or name another map'
                ) from None
            os.close(self._file)  # its owner deleted it meanwhile

    def _is_of_this_name(self) -> bool:
        try:
            return os.path.samestat(os.fstat(self._file), os.stat(self._path))
        except FileNotFoundError:
            return False

    def release(self) -> None:
        """Let others write the map."""
        with suppress(OSError):
            self._path.unlink()
        os.close(self._file)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.release()


def _refuse_read_only(path: Path) -> None:
    """Say at the start what would else go wrong later; SQLite needs the folder for its journal."""
    folder = path.absolute().parent
    if not folder.is_dir():
        raise MapError(f'{path}: there is no folder {folder}; make it')
    if not os.access(folder, os.W_OK) or (path.exists() and not os.access(path, os.W_OK)):
        raise MapError(
            f'{path}: cannot be written; make it and its folder writable, or copy it elsewhere'
        )


def _delete_parts(path: Path) -> None:
    """
    Delete what programs left beside a map that were killed while they replaced it.

    None is made without the lock. What others may have made stays: only this user's closed folders
    are looked at, of such a name, with nothing but a map in them.
    """
    target = path.resolve()
    start, own = f'{target.name}.', {target.name + end for end in ('', *BESIDE)}
    with suppress(OSError):
        for one in os.scandir(target.parent):
            middle = one.name.removeprefix(start).removesuffix(PART)
            if one.name != start + middle + PART or not _MADE.fullmatch(middle):
                continue
            with suppress(OSError):
                about = one.stat(follow_symlinks=False)
                if about.st_mode != stat.S_IFDIR | 0o700 or about.st_uid != os.geteuid():
                    continue
                if own.issuperset(os.listdir(one.path)):
                    for name in os.listdir(one.path):
                        os.unlink(Path(one.path, name))
                    os.rmdir(one.path)
