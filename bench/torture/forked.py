# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Runs work in a fork of this process, which takes milliseconds, with limits as the oracle."""

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
BLOCKED_S = 30.0  # waiting time without CPU, which other programs may use
LOOK_S = 0.5  # between two polls; counted at most if the machine was suspended
MOST_BYTES = 1_000_000_000
_MOST_OUTPUT = 100_000  # bytes of a child's standard error


def problem_of(work: Callable[[], int], most_s: float = MOST_S) -> str:
    """
    Return the problem of work that returns an exit code like a command, or an empty text.

    It is empty if the work ended within the CPU time and memory limits, with 0, or with 1 and one
    line on standard error without a traceback.
    """
    reader, writer = os.pipe()
    child = os.fork()
    if not child:
        os.close(reader)
        _work(work, writer)
    os.close(writer)
    output, in_time = _read(reader, BLOCKED_S + most_s)
    os.close(reader)
    if not in_time:
        os.kill(child, signal.SIGKILL)
    _, status, usage = os.wait4(child, 0)
    if not in_time or usage.ru_utime + usage.ru_stime > most_s:
        return f'took more than {most_s:g} s'
    # Linux reports kB, including memory shared with this process.
    if usage.ru_maxrss * 1024 > MOST_BYTES:
        return f'took {usage.ru_maxrss / 1e6:.1f} GB'
    if os.WIFSIGNALED(status):
        return f'killed by signal {os.WTERMSIG(status)}: {output[-200:]}'
    code = os.WEXITSTATUS(status)
    lines = [line for line in output.splitlines() if line.strip() and 'warning:' not in line]
    if 'Traceback' in output or code not in (0, 1):
        return f'exit {code}: {" | ".join(lines)[-400:]}'
    if code == 1 and not lines:
        return 'exit 1 without a word'
    return ''


def _work(work: Callable[[], int], writer: int) -> None:
    """Do the work, send its standard error to the parent, and end this process."""
    code, output = 70, io.StringIO()
    try:
        with contextlib.redirect_stderr(output), contextlib.redirect_stdout(io.StringIO()):
            # A larger allocation by a library would only slow the machine down.
            resource.setrlimit(resource.RLIMIT_AS, (8 * MOST_BYTES, 8 * MOST_BYTES))
            code = work()
    except SystemExit as error:
        code = error.code if isinstance(error.code, int) else 1
    except BaseException:
        output.write(traceback.format_exc())
    with contextlib.suppress(OSError):
        os.write(writer, output.getvalue().encode(errors='replace')[-_MOST_OUTPUT:] or b' ')
    os._exit(code)


def _read(reader: int, left_s: float) -> tuple[str, bool]:
    """Return the text until the other end is closed, and whether that was in time."""
    output = b''
    while left_s > 0:
        before_s = time.monotonic()
        if select.select([reader], [], [], LOOK_S)[0]:
            piece = os.read(reader, 65536)
            if not piece:
                return output.decode(errors='replace'), True
            output += piece
        left_s -= min(LOOK_S, time.monotonic() - before_s)
    return output.decode(errors='replace'), False
