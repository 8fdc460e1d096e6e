# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Runs a node's process, from the start of ROS to the exit code."""

from collections.abc import Callable, Iterator
from contextlib import suppress
from ctypes import CDLL
import os
import re
import signal
import sys
import threading
import time
from typing import NoReturn

from convseq_ros.config.arguments import refuse_foreign
from convseq_ros.errors import ConfigError, ConvseqError, one_line, with_traceback
from convseq_ros.node.process import check_logs, fast_dds, QUICK_START
import rclpy
from rclpy.executors import SingleThreadedExecutor
from rclpy.logging import get_logger
from rclpy.node import Node
from rclpy.signals import SignalHandlerOptions
from rclpy.utilities import ok, try_shutdown

_IN_C = re.compile(r'(, at \S+:\d+)+$')  # where the C code of ROS met an error
_OUR_THREADS = frozenset({'worker', 'solver'})  # they end when the node is destroyed
_SPIN_S = 0.2
_LOG_PERIOD_S = 5.0
_M_MMAP_THRESHOLD = -3  # malloc.h of glibc: larger blocks are mapped, and unmapped when freed
_MAPPED_BYTES = 1 << 22  # smaller images are faster if their memory is reused
_M_TRIM_THRESHOLD = -1  # malloc.h of glibc: free memory that the heap keeps at its end
_KEPT_BYTES = 1 << 23  # two such images; with 128 kB, the default, each image allocates anew
_RETURNED_S = 30.0  # after which memory that is free between objects is returned again


def run_until_signal(
    make_node: Callable[[], Node], args: list[str] | None = None, name: str = 'vpr_node'
) -> int:
    """Run a node until SIGINT or SIGTERM; return the exit code."""
    ending = threading.Event()
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda *_: ending.set())
    keep_memory_at_hand()
    os.environ.update(fast_dds(QUICK_START))  # read when the first node is made
    check_logs()
    try:
        refuse_foreign(sys.argv if args is None else args)
        # rclpy's own handlers would shut ROS down in the middle of the work.
        rclpy.init(args=args, signal_handler_options=SignalHandlerOptions.NO)
    except ConfigError as error:
        return _refuse(error, name)
    except RuntimeError as error:
        words = _IN_C.sub('', str(error))
        return _refuse(ConfigError(f'{words}; check the words after --ros-args'), name)
    try:
        node = make_node()
        try:
            returned_s = time.monotonic()
            for _ in spin(node):
                if ending.is_set():
                    break
                if time.monotonic() - returned_s > _RETURNED_S:
                    return_free_memory()
                    returned_s = time.monotonic()
        finally:
            node.destroy_node()
    except (ConvseqError, OSError) as error:
        return _refuse(error, name)
    finally:
        try_shutdown()
        for thread in threading.enumerate():
            if thread.name in _OUR_THREADS:
                thread.join()  # Python's own end would forbid it to start threads
    return 0


def leave(code: int) -> NoReturn:
    """End the process: Python takes its own handlers back then, and Ctrl-C would kill it."""
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, signal.SIG_IGN)
    sys.exit(code)


def spin(node: Node) -> Iterator[None]:
    """
    Serve a node until ROS is shut down; yield after every turn.

    The error of a callback is logged: no message ends the node.
    """
    executor = SingleThreadedExecutor()
    executor.add_node(node)
    # A signal does not wake the executor, so it returns now and then.
    while ok():
        try:
            executor.spin_once(timeout_sec=_SPIN_S)
        except Exception as error:
            if ok():
                logger = node.get_logger()
                logger.error(with_traceback(error), throttle_duration_sec=_LOG_PERIOD_S)
        yield


def keep_memory_at_hand() -> None:
    """Let the C library reuse the memory of images, but return that of large ones."""
    with suppress(AttributeError, OSError):
        library = CDLL(None)
        library.mallopt(_M_MMAP_THRESHOLD, _MAPPED_BYTES)
        library.mallopt(_M_TRIM_THRESHOLD, _KEPT_BYTES)


def return_free_memory() -> None:
    """
    Return memory that is free between objects; the C library does so at the end of its heap only.

    When a map has doubled, caches begin anew: 30 MB of holes, of which objects that stay fill few.
    """
    with suppress(AttributeError, OSError):
        CDLL(None).malloc_trim(_KEPT_BYTES)


def _refuse(error: Exception, name: str) -> int:
    get_logger(name).error(one_line(error))
    return 1
