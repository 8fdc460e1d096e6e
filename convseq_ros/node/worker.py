# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The threads of the node: one behind a bounded queue, and those of services that take long."""

from collections import Counter, deque
from collections.abc import Callable, Generator
from concurrent.futures import Future
from functools import partial
import math
import threading
import time
from typing import Generic, TypeVar

Item = TypeVar('Item')
Action = Callable[[], None]


class Worker(Generic[Item]):
    """
    Handles items one after another, in a thread of its own; drops the oldest when they pile up.

    `handle` is called with each item, in the thread, and with those that wait behind it as long as
    they are at most `together()` in all; it must not raise. At most `queue_size` items
    wait, of `queue_bytes` together (one alone may have more), and each, if another waits behind
    it, for `max_wait_s` seconds; 0 for as long as it takes. `drops` counts those that were pushed
    out or waited for too long, by cause: queue_size, memory, max_wait_s.
    """

    def __init__(
        self,
        handle: Callable[..., None],
        queue_size: int,
        max_wait_s: float = 0.0,
        queue_bytes: float = math.inf,
        together: Callable[[], int] = lambda: 1,
    ) -> None:
        self.drops: Counter[str] = Counter()
        self._handle = handle
        self._size = queue_size
        self._max_wait_ns = round(max_wait_s * 1e9)
        self._most_bytes = queue_bytes
        self._together = together
        self._bytes = 0
        self._items: deque[tuple[int, int, Item]] = deque()
        self._actions: deque[Action] = deque()
        self.is_stopping = False  # whether it begins nothing any more
        self._changed = threading.Condition()
        self._thread = threading.Thread(target=self._run, name='worker', daemon=True)

    def start(self) -> None:
        self._thread.start()

    def put(self, item: Item, size: int = 0) -> None:
        """Append an item that holds so many bytes; returns at once."""
        with self._changed:
            while self._items and (cause := self._overfull(size)):
                self._take()
                self.drops[cause] += 1
            self._items.append((time.monotonic_ns(), size, item))
            self._bytes += size
            self._changed.notify()

    def between_items(self, action: Action) -> None:
        """Have the thread call an action once, after the item at hand and before the next."""
        with self._changed:
            self._actions.append(action)
            self._changed.notify()

    @property
    def dropped(self) -> int:
        return self.drops.total()

    @property
    def waiting(self) -> int:
        return len(self._items)

    def stop(self, timeout_s: float) -> bool:
        """Finish the item at hand and end the thread; False if that takes longer."""
        with self._changed:
            self.is_stopping = True
            self._changed.notify()
        if self._thread.ident is not None:
            self._thread.join(timeout_s)
        return not self._thread.is_alive()

    def _run(self) -> None:
        while (job := self._next_job()) is not None:
            job()
            # Else it would hold its item, perhaps a large one, until the next comes.
            del job

    def _next_job(self) -> Action | None:
        with self._changed:
            self._changed.wait_for(lambda: self.is_stopping or self._actions or self._items)
            if self.is_stopping:
                return None
            if self._actions:
                return self._actions.popleft()
            while len(self._items) > 1 and self._is_late():
                self._take()
                self.drops['max_wait_s'] += 1
            count = min(len(self._items), self._together())
            return partial(self._handle, *[self._take() for _ in range(count)])

    def _take(self) -> Item:
        _, size, item = self._items.popleft()
        self._bytes -= size
        return item

    def _overfull(self, size: int) -> str:
        """Return which limit another item of a size would break; empty if none."""
        if len(self._items) == self._size:
            return 'queue_size'
        return 'memory' if self._bytes + size > self._most_bytes else ''

    def _is_late(self) -> bool:
        waited_ns = time.monotonic_ns() - self._items[0][0]
        return 0 < self._max_wait_ns < waited_ns


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
