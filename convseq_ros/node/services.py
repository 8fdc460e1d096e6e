# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Long work inside a service, without holding up the executor."""

from collections.abc import Callable, Generator
from concurrent.futures import Future
import threading
from typing import TypeVar

Result = TypeVar('Result')

_POLL_S = 0.005


async def in_background(work: Callable[[], Result]) -> Result:
    """
    Return the result of work done in another thread, while the executor serves other callbacks.

    An executor of rclpy polls a waiting coroutine without a pause; this one sleeps a moment at
    every poll, so that the thread gets the processor. The service needs a callback group of its
    own: the default one is held until the coroutine ends.

    Parameters
    ----------
    work : callable
        Its errors are raised here. The thread does not outlive the process.

    """
    future: Future[Result] = Future()

    def run() -> None:
        try:
            future.set_result(work())
        except BaseException as error:
            future.set_exception(error)

    thread = threading.Thread(target=run, name='service', daemon=True)
    thread.start()
    while thread.is_alive():
        thread.join(_POLL_S)
        await _Turn()
    return future.result()


class _Turn:
    """Gives other callbacks a turn."""

    def __await__(self) -> Generator[None, None, None]:
        yield
