# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Standard output and error, which may be closed, full, or of a poor encoding."""

from contextlib import suppress
import os
import sys
from typing import TextIO

OUTPUT = 'standard output'
_MODES = {'stdin': 'r', 'stdout': 'w', 'stderr': 'w'}


def prepare() -> None:
    """Open streams that are closed, and print what an encoding lacks by its number."""
    for name, mode in _MODES.items():
        if getattr(sys, name) is None:  # a file that is opened later would take its place
            handle = os.open(os.devnull, os.O_RDWR)
            setattr(sys, name, open(handle, mode, encoding='utf-8', closefd=False))
        if mode == 'w':
            getattr(sys, name).reconfigure(errors='backslashreplace')


def finish(code: int) -> int:
    """Write what is left of the output; return the exit code, 1 if that fails."""
    try:
        sys.stdout.flush()
    except BrokenPipeError:  # the reader, such as `head`, has what it wants
        discard()
    except OSError as error:
        discard()
        with suppress(OSError):
            print(f'convseq: {OUTPUT}: {error.strerror}', file=sys.stderr)
        code = code or 1
    try:
        sys.stderr.flush()
    except OSError:  # Python would end with a code of its own
        discard(sys.stderr)
    return code


def discard(stream: TextIO | None = None) -> None:
    """Write nothing more to a stream, standard output unless another is given."""
    with suppress(OSError):
        os.dup2(os.open(os.devnull, os.O_WRONLY), (stream or sys.stdout).fileno())
