# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""One interface to the files of a recording, complete or damaged."""

from collections.abc import Callable, Iterator
from pathlib import Path
import re
from typing import Any

from convseq_ros.config.reading_config import ReadingConfig
from convseq_ros.errors import ConfigError, one_line, pip_install, SourceError
from convseq_ros.io.files import read_yaml
from convseq_ros.io.regular_file import refuse_irregular
from convseq_ros.sources import bag_file, database_file, mcap_file
from convseq_ros.sources.folder import natural_key
from convseq_ros.sources.inflate import inflate, inflated_file, ZSTD_START
from convseq_ros.sources.raw_message import RawMessage
from convseq_ros.sources.topics import ForeignRecording, typestore

_FORMATS: dict[str, tuple[Any, str]] = {
    '.mcap': (mcap_file, 'mcap recover'),
    '.db3': (database_file, 'sqlite3 FILE .recover'),
    '.bag': (bag_file, 'rosbag reindex'),
}
_NAME = re.compile(r'(\.mcap|\.db3|\.bag)(\.zstd)?$')


class Storage:
    """
    One file of a recording: its `topics` by name, and when its first and last message came.

    `damage` describes the damage of a file that can be read in part; otherwise it is empty.
    SourceError if nothing can be read; while iterating, at unexpected damage.
    """

    def __init__(self, path: Path, reading: ReadingConfig) -> None:
        refuse_irregular(path)
        self.path, self._reading = path, reading
        name = _NAME.search(path.name.lower())
        if not name:
            raise SourceError(
                f'{path}: not a recording; expected a folder or a {", ".join(_FORMATS)} file'
            )
        typestore()
        self._format, repair = _FORMATS[name[1]]
        self._advice = f'repair it with `{repair}` or record again'
        try:
            with inflated_file(path, reading) as plain:
                about = self._format.index(plain, reading)
            self.topics, self.start_ns, self.end_ns, damage = about
        except ImportError as error:
            package = (error.name or '').partition('.')[0]
            raise SourceError(f'{path}: {package} is missing; {pip_install(package)}') from None
        except ForeignRecording as error:
            raise SourceError(f'{path}: {error}') from None
        except Exception as error:
            raise SourceError(
                f'{path}: not a readable recording ({one_line(error)}); {self._advice}'
            ) from None
        self.damage = f'{path}: {damage}' if damage else ''

    @property
    def duration_s(self) -> float:
        """Time from the first message to the last."""
        return max(0, self.end_ns - self.start_ns) / 1e9

    def messages(
        self, topic: str, warn: Callable[[str], None] = lambda _line: None
    ) -> Iterator[RawMessage]:
        """
        Yield the messages of a topic as recorded; each call starts anew.

        At the end, `warn` gets a line if messages were left out as damaged.
        """
        report = lambda line: warn(f'{self.path}: {line}')  # noqa: E731
        count = 0
        try:
            with inflated_file(self.path, self._reading) as plain:
                for message in self._format.messages(plain, self._reading, topic, report):
                    yield self._plain(message)
                    count += 1
        except Exception as error:
            if self.damage and self.path.exists():
                return
            raise SourceError(
                f'{self.path}: damaged after {count} messages of {topic} ({one_line(error)}); '
                f'{self._advice}'
            ) from None

    def _plain(self, message: RawMessage) -> RawMessage:
        """Return a message whose recorder may have compressed it; else its first byte is 0."""
        if not message.cdr.startswith(ZSTD_START):
            return message
        return message._replace(cdr=inflate(message.cdr, 'zstd', self._reading.most_bytes))


def is_storage_file(path: Path) -> bool:
    """Return whether a name is that of a recording's file, which may be compressed."""
    return _NAME.search(path.name.lower()) is not None


def open_storage(
    path: Path, reading: ReadingConfig = ReadingConfig()
) -> tuple[list[Storage], list[str]]:
    """
    Open a recording's file, or all readable ones in a folder; SourceError if there is none.

    Return the storages in the natural order of their names, and a line for every file that was
    left out.
    """
    refuse_irregular(path)
    if not path.exists():
        raise SourceError(f'{path}: no such file or folder; check the path')
    if not path.is_dir():
        return [Storage(path, reading)], []
    problem = SourceError(
        f'{path}: no recording in this folder; expected a .mcap, .db3 or .bag file'
    )
    files, warnings = _files_of(path, reading)
    storages: list[Storage] = []
    for file in files:
        try:
            storages.append(Storage(file, reading))
        except SourceError as error:
            problem = error
            warnings.append(f'{error}; the file was left out')
    if not storages:
        raise problem
    return storages, warnings


def _files_of(folder: Path, reading: ReadingConfig) -> tuple[list[Path], list[str]]:
    """Return the files that a folder's metadata.yaml names, or all, and a line on the others."""
    files = [file for file in sorted(folder.iterdir(), key=natural_key) if is_storage_file(file)]
    present, chosen, missing = {file.name for file in files}, set[str](), list[str]()
    for name in _named_in(folder / 'metadata.yaml', reading):
        # A file may have been compressed, or decompressed, since it was recorded.
        forms = name, f'{name}.zstd', name.removesuffix('.zstd')
        found = [form for form in forms if form in present][:1]
        chosen.update(found)
        missing += [] if found else [name]
    others = [file.name for file in files if file.name not in chosen]
    if chosen and missing:
        return files, [
            f'{folder}: metadata.yaml names {", ".join(missing)}, not there; all that is there '
            'is read: copy them, too'
        ]
    if not (chosen and others):
        return files, []
    return [file for file in files if file.name in chosen], [
        f'{folder}: metadata.yaml does not name {", ".join(others)}; left out: remove '
        'metadata.yaml to read all files'
    ]


def _named_in(metadata: Path, reading: ReadingConfig) -> list[str]:
    """Return the names of files in the metadata.yaml of rosbag2; none if it cannot be used."""
    try:
        about = read_yaml(metadata, reading)['rosbag2_bagfile_information']
        return [Path(name).name for name in about['relative_file_paths']]
    except (ConfigError, LookupError, TypeError):
        return []
