# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
How this package's processes handle SIGINT and SIGTERM, and how they configure Fast DDS.

While NumPy, OpenCV and rclpy are imported, which takes a second, a signal ends the process at
once. Afterwards `hand_over` sets a function that finishes the work first.
"""

from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from importlib import import_module
import os
from pathlib import Path
import signal
import sys
import tempfile
from typing import Any, NoReturn, TypeVar

Item = TypeVar('Item')
SIGNALS = (signal.SIGINT, signal.SIGTERM)

# Settings of Fast DDS that come with this package; other middlewares do not read them.
VARIABLE = 'FASTRTPS_DEFAULT_PROFILES_FILE'
LARGE_IMAGES = 'fastdds_large_images.xml'
QUICK_START = 'fastdds_quick_start.xml'
_CHOSEN_BY = VARIABLE, 'FASTDDS_DEFAULT_PROFILES_FILE'

# Threads of BLAS and of OpenCV busy-wait for each other: on a busy machine a pair of images takes
# ten times as long, and on a quiet one small images are not faster with several threads.
_THREAD_COUNTS = 'OPENBLAS_NUM_THREADS', 'OPENCV_FOR_THREADS_NUM'

_later: Callable[[], None] | None = None
_is_held = _is_asked = False  # whether an interruption is to wait, and whether one does


def use_one_thread() -> None:
    """Limit BLAS and OpenCV, imported later, to one thread unless the environment sets more."""
    for name in _THREAD_COUNTS:
        os.environ.setdefault(name, '1')


def run(module: str, code: int, text: str = '') -> int:
    """Import a module, which may take long, and return what its `main` returns."""
    end_on_signal(code, text)
    # They may be blocked by what started this process.
    signal.pthread_sigmask(signal.SIG_UNBLOCK, SIGNALS)
    try:
        return int(import_module(module).main())
    finally:
        ignore()


def run_node(module: str) -> NoReturn:
    """Call `run`, then exit at once: on a busy machine Python's cleanup takes seconds."""
    code = run(module, 0)
    sys.stdout.flush()
    sys.stderr.flush()
    os._exit(code)


def end_on_signal(code: int, text: str = '') -> None:
    """Make a signal end this process at once, with this code and text, until `hand_over`."""

    def on_signal(*_: Any) -> None:
        if _later:
            _later()
        else:
            os.write(2, text.encode())
            os._exit(code)

    global _later
    _later = None
    for number in SIGNALS:
        signal.signal(number, on_signal)


def hand_over(later: Callable[[], None]) -> None:
    """Make a signal call `later` in the main thread, which has called `end_on_signal` before."""
    global _later
    _later = later


def interrupt() -> None:
    """Raise KeyboardInterrupt, in `held` blocks later; when called again, end at once."""
    global _is_asked
    hand_over(lambda: os._exit(1))
    if _is_held:
        _is_asked = True
        return
    # Python only prints an exception that cannot be caught, such as one in a finaliser.
    sys.unraisablehook = lambda raised: (
        os._exit(1)
        if isinstance(raised.exc_value, KeyboardInterrupt)
        else sys.__unraisablehook__(raised)
    )
    raise KeyboardInterrupt


@contextmanager
def held() -> Iterator[None]:
    """
    Let `interrupt` raise KeyboardInterrupt at the end of a block, or between two `steps` in it.

    Elsewhere it might leave a file open, or a lock for which other threads would wait for ever.
    """
    global _is_held
    before, _is_held = _is_held, True
    try:
        yield
    finally:
        _is_held = before
    if not before:
        _raise_if_asked()


def steps(items: Iterable[Item]) -> Iterator[Item]:
    """Yield the items; `interrupt` raises KeyboardInterrupt between two of them."""
    with held():
        for item in items:
            _raise_if_asked()
            yield item
        _raise_if_asked()


def _raise_if_asked() -> None:
    global _is_asked
    was_asked, _is_asked = _is_asked, False
    if was_asked:
        raise KeyboardInterrupt


def ignore() -> None:
    """Ignore signals from now on: Python restores their deadly default before it ends."""
    for number in SIGNALS:
        signal.signal(number, signal.SIG_IGN)


def fast_dds(profile: str) -> dict[str, str]:
    """
    Return the environment variable with which a process uses one of our profiles.

    Empty if the user has chosen a profile, or ours are not installed. With `LARGE_IMAGES` neither
    large images nor messages beside them are lost. Both profiles discover others at once.
    """
    beside = Path(__file__).resolve().parents[2]
    prefix = beside.parent.parent.parent
    for folder in (beside / 'config', prefix / 'share' / 'convseq_ros' / 'config'):
        if (folder / profile).is_file() and not any(name in os.environ for name in _CHOSEN_BY):
            return {VARIABLE: str(folder / profile)}
    return {}


def check_logs() -> None:
    """Make ROS log to a temporary folder, with a warning, if it has no writable one."""
    if 'ROS_LOG_DIR' in os.environ:
        return
    home, folder = os.environ.get('HOME'), os.environ.get('ROS_HOME')
    if not (home or folder):
        problem = 'HOME is not set'
    else:
        logs = Path(folder or f'{home}/.ros', 'log')
        try:
            logs.mkdir(parents=True, exist_ok=True)
            tempfile.TemporaryFile(dir=logs).close()
            return
        except OSError as error:
            problem = f'{logs}: {error.strerror}'
    os.environ['ROS_LOG_DIR'] = tempfile.mkdtemp(prefix='ros_log_')
    print(f'warning: {problem}; ROS logs to {os.environ["ROS_LOG_DIR"]}', file=sys.stderr)
