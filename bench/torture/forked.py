# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Runs work in a fork of this process, with limits, and sees how it ends."""

from collections.abc import Callable
import os
import resource
import signal
import tempfile
import traceback
from typing import NamedTuple, NoReturn

MOST_S = 5  # of the CPU
BLOCKED_S = 60  # more than that, with what other programs take
MOST_BYTES = 1_000_000_000
_LIMITS = -signal.SIGXCPU, -signal.SIGALRM
_BESIDE = 'warning: ', '[rcl]: Failed to parse global arguments'  # ROS says the second of itself


class End(NamedTuple):
    """How work ended: its exit code, standard error, and the problem, empty if there was none."""

    code: int
    told: str
    problem: str = ''


def ended(work: Callable[[], int], most_s: int = MOST_S) -> End:
    """
    Do work that returns an exit code like a command.

    It is a problem if it takes too much time or memory, or if it does not end with 0, with 1 and
    one line on standard error, or with 2 for wrong usage.
    """
    with tempfile.TemporaryFile() as output:
        if not (child := os.fork()):
            _work(work, output.fileno(), most_s)
        _, status, usage = os.wait4(child, 0)
        output.seek(0)
        told = output.read().decode(errors='backslashreplace')
    end = End(os.waitstatus_to_exitcode(status), told)
    lines = [line for line in told.splitlines() if not any(one in line for one in _BESIDE)]
    if end.code in _LIMITS:
        return end._replace(problem=f'took more than {most_s} s')
    # Linux reports kB, including memory shared with this process.
    if usage.ru_maxrss * 1024 > MOST_BYTES:
        return end._replace(problem=f'took {usage.ru_maxrss / 1e6:.1f} GB')
    if 'Traceback' in told or end.code not in (0, 1, 2) or (end.code == 1 and len(lines) != 1):
        return end._replace(problem=f'exit {end.code}, {len(lines)} lines: {told[-400:]}')
    return end


def _work(work: Callable[[], int], output: int, most_s: int) -> NoReturn:
    """Do the work, and end this process."""
    code = 70
    os.dup2(output, 2)
    os.dup2(os.open(os.devnull, os.O_WRONLY), 1)
    resource.setrlimit(resource.RLIMIT_CPU, (most_s, most_s + 1))
    # A larger allocation by a library would only slow the machine down.
    resource.setrlimit(resource.RLIMIT_AS, (8 * MOST_BYTES, 8 * MOST_BYTES))
    signal.signal(signal.SIGALRM, signal.SIG_DFL)  # not the handler of a test's time limit
    signal.alarm(most_s + BLOCKED_S)
    try:
        code = work()
    except SystemExit as error:
        code = error.code if isinstance(error.code, int) else 1
    except BaseException:
        os.write(2, traceback.format_exc().encode(errors='replace'))
    finally:
        os._exit(code)
