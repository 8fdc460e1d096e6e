# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Replacing a map file in one step, or not at all."""

from collections.abc import Iterator
from contextlib import closing, contextmanager, suppress
import os
from pathlib import Path
import tempfile

from convseq_ros.core.map.crash_recovery import open_to_write
from convseq_ros.core.map.database import explained
from convseq_ros.core.map.lock import BESIDE, MapLock, PART
from convseq_ros.errors import MapError
from convseq_ros.regular_file import sync


@contextmanager
def replaced(path: Path) -> Iterator[Path]:
    """
    Give a name under which a map is made, which takes its place at the end, or is deleted.

    MapError if another program adds to the map, or the file cannot be written.
    """
    target = path.resolve()
    prefix, folder = f'{target.name}.', target.parent
    with MapLock(path):
        try:
            with tempfile.TemporaryDirectory(PART, prefix, folder) as own:
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


def _delete_journal(path: Path) -> None:
    """Delete what a crash left beside a file: it would be taken for what replaces the file."""
    beside = [path.with_name(path.name + end) for end in BESIDE]
    if any(one.exists() for one in beside):
        with suppress(MapError), explained(path), closing(open_to_write(path)) as database:
            database.number('PRAGMA page_count')  # mends the file, if it can be
        for one in beside:
            one.unlink(missing_ok=True)
