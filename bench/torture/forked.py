# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Work in a fork of this process, so that a try costs milliseconds, with limits as the oracle."""

from collections.abc import Callable
import contextlib
import io
import os
import resource
import select
import signal
import time
import traceback

MOST_S = 5.0
BLOCKED_S = 30.0  # without the processor, which other programs may have
LOOK_S = 0.5  # between two looks: while all is stopped, no more than this passes
MOST_BYTES = 1_000_000_000
_MOST_TOLD = 100_000  # bytes of what a child says


def problem_of(work: Callable[[], int], most_s: float = MOST_S) -> str:
    """
    Return what is wrong with work that returns an exit code, done as a command would do it.

    It is empty if the work ended within so many seconds of the processor, within memory, by 0, or
    by 1 with one line on standard error and no traceback.
    """
    reader, writer = os.pipe()
    child = os.fork()
    if not child:
        os.close(reader)
        _work(work, writer)
    os.close(writer)
    told, in_time = _read(reader, BLOCKED_S + most_s)
    os.close(reader)
    if not in_time:
        os.kill(child, signal.SIGKILL)
    _, status, usage = os.wait4(child, 0)
    if not in_time or usage.ru_utime + usage.ru_stime > most_s:
        return f'took more than {most_s:g} s'
    # Linux counts in kB; what the child shares with this process is counted, too.
    if usage.ru_maxrss * 1024 > MOST_BYTES:
        return f'took {usage.ru_maxrss / 1e6:.1f} GB'
    if os.WIFSIGNALED(status):
        return f'killed by signal {os.WTERMSIG(status)}: {told[-200:]}'
    code = os.WEXITSTATUS(status)
    lines = [line for line in told.splitlines() if line.strip() and 'warning:' not in line]
    if 'Traceback' in told or code not in (0, 1):
        return f'exit {code}: {" | ".join(lines)[-400:]}'
    if code == 1 and not lines:
        return 'exit 1 without a word'
    return ''


def _work(work: Callable[[], int], writer: int) -> None:
    """Do it, and end this process."""
    code, told = 70, io.StringIO()
    try:
        with contextlib.redirect_stderr(told), contextlib.redirect_stdout(io.StringIO()):
            # What a library allocates beyond twice the limit would only slow the machine down.
            resource.setrlimit(resource.RLIMIT_AS, (8 * MOST_BYTES, 8 * MOST_BYTES))
            code = work()
    except SystemExit as error:
        code = error.code if isinstance(error.code, int) else 1
    except BaseException:
        told.write(traceback.format_exc())
    with contextlib.suppress(OSError):
        os.write(writer, told.getvalue().encode(errors='replace')[-_MOST_TOLD:] or b' ')
    os._exit(code)


def _read(reader: int, left_s: float) -> tuple[str, bool]:
    """Return what is written until the other end is closed, and whether that was in time."""
    told = b''
    while left_s > 0:
        before_s = time.monotonic()
        if select.select([reader], [], [], LOOK_S)[0]:
            piece = os.read(reader, 65536)
            if not piece:
                return told.decode(errors='replace'), True
            told += piece
        left_s -= min(LOOK_S, time.monotonic() - before_s)
    return told.decode(errors='replace'), False
