# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Long work inside a service, without holding up the executor."""

from collections.abc import Callable, Generator
from concurrent.futures import Future
import threading
import time
from typing import TypeVar

Result = TypeVar('Result')

_POLL_S = 0.005


class Background:
    """
    Does work in other threads, which do not outlive the process.

    The service needs a callback group of its own: the default one is held until the coroutine
    ends.
    """

    def __init__(self) -> None:
        self._threads: set[threading.Thread] = set()

    async def result_of(self, work: Callable[[], Result]) -> Result:
        """Return the result of work, or raise its error, while other callbacks are served."""
        future: Future[Result] = Future()
        thread = threading.Thread(target=settle, args=(future, work), name='service', daemon=True)
        self._threads.add(thread)
        thread.start()
        while thread.is_alive():
            await Turn()
        self._threads.discard(thread)
        return future.result()

    def finish(self, timeout_s: float) -> bool:
        """Wait for all work to end; return whether it did."""
        for thread in self._threads:
            thread.join(timeout_s)
        return not any(thread.is_alive() for thread in self._threads)


def settle(future: Future[Result], work: Callable[[], Result]) -> None:
    """Do some work, and give what it returns or raises to whoever waits for it."""
    try:
        future.set_result(work())
    except BaseException as error:
        future.set_exception(error)


class Turn:
    """
    Gives other callbacks a turn, once it is awaited.

    An executor of rclpy polls waiting coroutines without a pause; of all of them, one sleeps a
    moment now and then, so that threads get the processor. Were it each of them at each poll, many
    would hold up the images.
    """

    _slept_s = 0.0

    def __await__(self) -> Generator[None, None, None]:
        if time.monotonic() - Turn._slept_s > _POLL_S:
            time.sleep(_POLL_S)
            Turn._slept_s = time.monotonic()
        yield
