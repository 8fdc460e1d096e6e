# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A file that a program is asked to write, checked before work starts."""

from collections.abc import Iterable
from dataclasses import dataclass
import os
from pathlib import Path

from convseq_ros.errors import ConfigError, printable
from convseq_ros.io.regular_file import MARK

LIBRARY = 'convseq_ros'  # what recordings that this package writes name in their header
_HEAD_BYTES = 4096  # in which the mark is
_MCAP_HEADER = b'\x89MCAP0\r\n\x01'  # the magic bytes of a recording, and its first record
PAGE, FIGURE = ('.html', '.htm'), ('.png', '.svg', '.pdf')  # kinds
ANY = ('',)  # any name; the writer itself refuses what it must not replace
TEXT = ()  # any name
ANSWERS = ('.csv', '.mcap')  # a table, or a recording
_TABLE = b'query_index,'  # begins a table of answers


@dataclass(frozen=True, slots=True)
class OutputFile:
    """
    A file to write, which replaces an empty file of that name, or one of this program.

    `option` asked for it. `kinds` are the endings that its name may have: `PAGE`, `FIGURE`, `ANY`,
    `ANSWERS` or `TEXT`. Files of this program have `MARK`, or are tables or recordings of answers.
    """

    option: str
    path: Path
    kinds: tuple[str, ...] = TEXT

    def refuse(self, others: Iterable[Path] = ()) -> None:
        """Raise a ConfigError if the file cannot be written, or would replace one of `others`."""
        try:
            problem = self._problem({os.path.realpath(other) for other in others})
        except (OSError, ValueError) as error:
            reason = getattr(error, 'strerror', None) or error
            problem = f'cannot be written ({reason}); name another file'
        if problem:
            raise ConfigError(f'{self.option}: {printable(str(self.path))} {printable(problem)}')

    def _problem(self, others: set[str]) -> str:
        folder = Path(os.path.realpath(self.path)).parent
        if self.path.is_dir():
            return 'is a folder; name a file'
        if not folder.is_dir():
            return f'cannot be written: there is no folder {folder}; make it, or name another'
        if not os.access(folder, os.W_OK):
            return f'cannot be written: {folder} is read-only; name another folder'
        if self.path.exists() and not self.path.is_file():
            return 'is not a file, but a device, a pipe or a socket; name a file'
        if os.path.realpath(self.path) in others:
            return 'is read or written by the same command; name another file'
        if self.kinds and not self.path.name.lower().endswith(self.kinds):
            return f'is of no kind that is written; name a {" or ".join(self.kinds)}'
        if self.kinds != ANY and self._is_of_others():
            return 'was not written by this program, and is kept; move it, or name another file'
        return ''

    def _is_of_others(self) -> bool:
        """Return whether it exists, and holds what this program has not written."""
        if not self.path.exists():
            return False
        with self.path.open('rb') as file:
            head = file.read(_HEAD_BYTES)
            if self.path.name.lower().endswith('.pdf'):
                head += file.read()  # its comment is at the end
        if self.kinds == ANSWERS and self.path.suffix == '.mcap':
            return bool(head) and not _is_ours(head)
        return bool(head) and MARK.encode() not in head and not head.startswith(_TABLE)


def _is_ours(head: bytes) -> bool:
    """Return whether a file that begins so is a recording whose header ends with `LIBRARY`."""
    size_at = len(_MCAP_HEADER)
    start = size_at + 8
    header = head[start : start + int.from_bytes(head[size_at:start], 'little')]
    return head.startswith(_MCAP_HEADER) and header.endswith(LIBRARY.encode())


def make_folder(path: Path) -> None:
    """Make a folder if there is none; ConfigError if that is impossible."""
    try:
        path.mkdir(parents=True, exist_ok=True)
    except (OSError, ValueError) as error:
        reason = getattr(error, 'strerror', None) or error
        raise ConfigError(f'{path}: cannot be made a folder ({reason}); name another') from None


def refuse_outputs(outputs: Iterable[OutputFile], inputs: Iterable[Path] = ()) -> None:
    """Raise a ConfigError for an output that cannot be written, or replaces another file used."""
    used = [*inputs]
    for output in outputs:
        output.refuse(used)
        used.append(output.path)
