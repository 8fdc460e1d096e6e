# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The lock that a writer of a map holds."""

from contextlib import suppress
import fcntl
import glob
import os
from pathlib import Path
import stat
from typing import Self

from convseq_ros.core.map.database import BESIDE
from convseq_ros.errors import MapError
from convseq_ros.io.regular_file import PART

LOCK = '-lock'  # ends the name of the lock's file


class MapLock:
    """
    The lock that a writer of a map holds, on the file `<map>-lock`; MapError if it is held.

    The system releases it when the program ends, also by a crash; a lock file that is left behind
    blocks nobody. Parts of maps that a crash left are deleted. The map itself is not locked,
    because closing it would also release SQLite's locks. Readers need no lock.
    """

    def __init__(self, path: Path) -> None:
        _refuse_read_only(path)
        try:
            target = path.resolve()
        except RuntimeError:  # of Python before 3.13
            raise MapError(f'{path}: a loop of symbolic links; name a file') from None
        self._path, is_ours = target.with_name(target.name + LOCK), False
        while not is_ours:
            try:
                self._file = os.open(self._path, os.O_CREAT | os.O_NOFOLLOW, 0o666)
            except OSError as error:
                raise MapError(f'{path}: cannot be written ({error.strerror})') from None
            try:
                fcntl.flock(self._file, fcntl.LOCK_EX | fcntl.LOCK_NB)
                is_ours = os.path.samestat(os.fstat(self._file), os.stat(self._path))
            except FileNotFoundError:  # its owner deleted it meanwhile
                pass
            except BlockingIOError:
                os.close(self._file)
                raise MapError(
                    f'{path}: another program adds to this map; end it, or name another map'
                ) from None
            if not is_ours:
                os.close(self._file)
        _delete_parts(target)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        """Release the lock."""
        with suppress(OSError):
            self._path.unlink()
        os.close(self._file)


def _refuse_read_only(path: Path) -> None:
    """Raise MapError if the map or its folder, where SQLite's journal goes, is read-only."""
    folder = path.absolute().parent
    if not folder.is_dir():
        raise MapError(f'{path}: there is no folder {folder}; make it')
    if not os.access(folder, os.W_OK) or (path.exists() and not os.access(path, os.W_OK)):
        raise MapError(
            f'{path}: cannot be written; make it and its folder writable, or copy it elsewhere'
        )


def _delete_parts(target: Path) -> None:
    """
    Delete the folders that programs left beside a map when they were killed while replacing it.

    A folder is only made under the lock. One is deleted only if its name fits, it belongs to this
    user, no other user may read it, and it holds nothing but a map.
    """
    names = {target.name + end for end in ('', LOCK, *BESIDE)}
    pattern = f'{glob.escape(target.name)}.{8 * "[a-z0-9_]"}{PART}'  # names by `tempfile`
    with suppress(OSError):
        for folder in target.parent.glob(pattern):
            with suppress(OSError):
                status = folder.lstat()
                is_ours = status.st_mode == stat.S_IFDIR | 0o700 and status.st_uid == os.geteuid()
                if is_ours and names.issuperset(os.listdir(folder)):
                    for name in os.listdir(folder):
                        (folder / name).unlink()
                    folder.rmdir()
