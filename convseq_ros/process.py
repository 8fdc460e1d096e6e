# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
What SIGINT and SIGTERM do to a process of ours, and what it tells Fast DDS.

Importing NumPy, OpenCV and rclpy takes a second, in which nothing is at stake yet: a signal then
ends the process at once. Later it is handed over to whoever has something to finish.
"""

from collections.abc import Callable
from importlib import import_module
import os
from pathlib import Path
import signal
import sys
import tempfile
from typing import Any, NoReturn

SIGNALS = (signal.SIGINT, signal.SIGTERM)

# Settings of Fast DDS that come with this package; other middlewares do not read them.
VARIABLE = 'FASTRTPS_DEFAULT_PROFILES_FILE'
LARGE_IMAGES = 'fastdds_large_images.xml'
QUICK_START = 'fastdds_quick_start.xml'
_CHOSEN_BY = VARIABLE, 'FASTDDS_DEFAULT_PROFILES_FILE'

# Threads of BLAS and of OpenCV wait for each other in a loop: a pair of images takes ten times as
# long on a busy machine, and small images cost more than they gain on a quiet one.
_ALONE = 'OPENBLAS_NUM_THREADS', 'OPENCV_FOR_THREADS_NUM'

_later: Callable[[], None] | None = None


def work_alone() -> None:
    """Have BLAS and OpenCV use one thread, unless told otherwise, if they are imported later."""
    for name in _ALONE:
        os.environ.setdefault(name, '1')


def run(module: str, code: int, text: str = '') -> int:
    """Import a module, which may take long, and return what its `main` returns."""
    stand(code, text)
    # Whoever became this process by `execve` had them wait.
    signal.pthread_sigmask(signal.SIG_UNBLOCK, SIGNALS)
    try:
        return int(import_module(module).main())
    finally:
        ignore()


def run_node(module: str) -> NoReturn:
    """Do as `run`, and end at once: on a busy machine Python would tidy up for seconds."""
    code = run(module, 0)
    sys.stdout.flush()
    sys.stderr.flush()
    os._exit(code)


def stand(code: int, text: str = '') -> None:
    """Have a signal end this process at once, with this code and text, until it is handed over."""

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
    """Have a signal call this from now on, in the main thread, where `stand` was called before."""
    global _later
    _later = later


def interrupt() -> None:
    """Raise KeyboardInterrupt; when called again, end the process at once."""
    hand_over(lambda: os._exit(1))
    # What is raised where nobody can catch it, as in a finaliser, would be printed and forgotten.
    sys.unraisablehook = lambda what: (
        os._exit(1)
        if isinstance(what.exc_value, KeyboardInterrupt)
        else sys.__unraisablehook__(what)
    )
    raise KeyboardInterrupt


def ignore() -> None:
    """Let no signal disturb the end: Python gives them back their deadly default before it."""
    for number in SIGNALS:
        signal.signal(number, signal.SIG_IGN)


def fast_dds(profile: str) -> dict[str, str]:
    """
    Return the environment variable with which a process uses one of our profiles.

    Empty if the user has chosen settings, or ours are not installed. `LARGE_IMAGES` loses no large
    images, nor what is sent beside them, and finds others at once, as `QUICK_START` does.
    """
    beside = Path(__file__).resolve().parents[1]
    prefix = beside.parent.parent.parent
    for folder in (beside / 'config', prefix / 'share' / 'convseq_ros' / 'config'):
        if (folder / profile).is_file() and not any(name in os.environ for name in _CHOSEN_BY):
            return {VARIABLE: str(folder / profile)}
    return {}


def settle_logs() -> None:
    """Have ROS write its logs to a folder of its own where the home is read-only; it says so."""
    if 'ROS_LOG_DIR' in os.environ:
        return
    folder = Path(os.environ.get('ROS_HOME') or os.path.expanduser('~/.ros'), 'log')
    try:
        folder.mkdir(parents=True, exist_ok=True)
        tempfile.TemporaryFile(dir=folder).close()
    except OSError as error:
        os.environ['ROS_LOG_DIR'] = tempfile.mkdtemp(prefix='ros_log_')
        told = f'{folder}: {error.strerror}; ROS logs to {os.environ["ROS_LOG_DIR"]}'
        print(f'warning: {told}', file=sys.stderr)
