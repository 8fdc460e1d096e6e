# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""How the process of a node runs, from ROS's first moment to the exit code."""

from collections.abc import Callable, Iterator
from contextlib import suppress
from ctypes import CDLL
import os
import sys
import threading

from convseq_ros.errors import ConvseqError, one_line
from convseq_ros.process import fast_dds, hand_over, ignore, QUICK_START, settle_logs, stand
import rclpy
from rclpy.executors import SingleThreadedExecutor
from rclpy.logging import get_logger
from rclpy.node import Node
from rclpy.signals import SignalHandlerOptions
from rclpy.utilities import ok, try_shutdown

_LOOK_UP_S = 0.2
_M_MMAP_THRESHOLD = -3  # malloc.h of glibc: what is larger is mapped, and unmapped when it is free
_MAPPED_BYTES = 1 << 22  # smaller images are worth more when their memory is at hand
_M_TRIM_THRESHOLD = -1  # malloc.h of glibc: what is free at the end of its heap, and kept
_KEPT_BYTES = 1 << 23  # two such images; by 128 kB, every image's memory is asked for anew


def run_until_signal(make_node: Callable[[], Node], args: list[str] | None = None) -> int:
    """Run a node until SIGINT or SIGTERM; return the exit code."""
    stand(0)
    keep_memory_at_hand()
    os.environ.update(fast_dds(QUICK_START))  # read when the first node is made
    settle_logs()
    try:
        # Its own handlers would shut ROS down under whatever is at work.
        rclpy.init(args=args, signal_handler_options=SignalHandlerOptions.NO)
    except RuntimeError as error:
        return _refuse(error)
    try:
        node = make_node()
        try:
            for _ in turns(node):
                pass
        finally:
            node.destroy_node()
    except (ConvseqError, OSError) as error:
        return _refuse(error)
    finally:
        try_shutdown()
        ignore()
    _leave_what_is_at_work()
    return 0


def turns(node: Node) -> Iterator[None]:
    """Serve a node until a signal comes or ROS is shut down; yield after every turn."""
    ending = threading.Event()
    hand_over(ending.set)
    executor = SingleThreadedExecutor()
    executor.add_node(node)
    # A signal does not wake the executor: it looks up now and then.
    while ok() and not ending.is_set():
        executor.spin_once(timeout_sec=_LOOK_UP_S)
        yield


def keep_memory_at_hand() -> None:
    """Have the C library keep what one image needs for the next, and give back large ones."""
    with suppress(AttributeError, OSError):
        library = CDLL(None)
        library.mallopt(_M_MMAP_THRESHOLD, _MAPPED_BYTES)
        library.mallopt(_M_TRIM_THRESHOLD, _KEPT_BYTES)


def _leave_what_is_at_work() -> None:
    """End at once if threads are still at work: Python would tidy up what they are using."""
    if any(thread.name in ('worker', 'service') for thread in threading.enumerate()):
        sys.stdout.flush()
        sys.stderr.flush()
        os._exit(0)


def _refuse(error: Exception) -> int:
    get_logger('vpr_node').error(one_line(error))
    return 1
