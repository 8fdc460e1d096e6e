# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Replacing a map file in one step, or not at all."""

from collections.abc import Iterator
from contextlib import closing, contextmanager, suppress
import os
from pathlib import Path
import re
import stat
import tempfile

from convseq_ros.core.map.crash_recovery import open_to_write
from convseq_ros.core.map.database import explained
from convseq_ros.core.map.lock import MapLock
from convseq_ros.errors import MapError
from convseq_ros.regular_file import sync

_END = '.part'
_MADE = re.compile(r'[a-z0-9_]{8}')  # what `tempfile` puts between a map's name and the end
_BESIDE = '-journal', '-wal', '-shm'


@contextmanager
def replaced(path: Path) -> Iterator[Path]:
    """
    Give a name under which a map is made, which takes its place at the end, or is deleted.

    MapError if another program adds to the map, or the file cannot be written.
    """
    target = path.resolve()
    prefix, folder = f'{target.name}.', target.parent
    with MapLock(path):
        delete_parts(path)
        try:
            with tempfile.TemporaryDirectory(_END, prefix, folder) as own:
                part = Path(own, target.name)
                try:
                    yield part
                except MapError as error:
                    raise MapError(str(error).replace(str(part), str(path))) from error
                _delete_journal(target)
                os.replace(part, target)
            sync(folder)
        except OSError as error:
            raise MapError(f'{path}: cannot write the map ({error.strerror})') from error


def delete_parts(path: Path) -> None:
    """
    Delete what programs left beside a map that were killed while they replaced it.

    For who holds the `MapLock`, without which no part is made. What others may have made stays:
    only this user's closed folders are looked at, of such a name, with nothing but a map in them.
    """
    target = path.resolve()
    start, own = f'{target.name}.', {target.name + end for end in ('', *_BESIDE)}
    with suppress(OSError):
        for one in os.scandir(target.parent):
            middle = one.name.removeprefix(start).removesuffix(_END)
            if one.name != start + middle + _END or not _MADE.fullmatch(middle):
                continue
            with suppress(OSError):
                about = one.stat(follow_symlinks=False)
                if about.st_mode != stat.S_IFDIR | 0o700 or about.st_uid != os.geteuid():
                    continue
                if own.issuperset(os.listdir(one.path)):
                    for name in os.listdir(one.path):
                        os.unlink(Path(one.path, name))
                    os.rmdir(one.path)


def _delete_journal(path: Path) -> None:
    """Delete what a crash left beside a file: it would be taken for what replaces the file."""
    beside = [path.with_name(path.name + end) for end in _BESIDE]
    if any(one.exists() for one in beside):
        with suppress(MapError), explained(path), closing(open_to_write(path)) as database:
            database.number('PRAGMA page_count')  # mends the file, if it can be
        for one in beside:
            one.unlink(missing_ok=True)
