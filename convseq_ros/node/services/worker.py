# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Threads of the node: a worker with a bounded queue, and threads for slow services."""

from collections import Counter, deque
from collections.abc import Callable, Generator
from concurrent.futures import Future, ThreadPoolExecutor
from functools import partial
import math
import threading
import time
from typing import Generic, TypeVar

Item = TypeVar('Item')
Action = Callable[[], None]


class Worker(Generic[Item]):
    """
    Handles items one after another in a separate thread; drops the oldest when they pile up.

    The thread calls `handle` with each item; it must not raise. At most `queue_size` items wait,
    with `queue_bytes` in total (a single item may be larger). An item is dropped once it has
    waited for `max_wait_s` seconds and another waits behind it; 0: never. `drops` counts dropped
    items by cause: queue_size, memory or max_wait_s. The thread calls `at_end` last, after the
    item at hand, however long that takes.
    """

    def __init__(
        self,
        handle: Callable[[Item], None],
        queue_size: int,
        max_wait_s: float = 0.0,
        queue_bytes: float = math.inf,
        at_end: Action = lambda: None,
    ) -> None:
        self.drops: Counter[str] = Counter()
        self._handle = handle
        self.configure(queue_size, max_wait_s)
        self._most_bytes = queue_bytes
        self._at_end = at_end
        self._bytes = 0
        self._items: deque[tuple[int, int, Item]] = deque()
        self._actions: deque[Action] = deque()
        self.is_stopping = False  # whether no further item is handled
        self._changed = threading.Condition()
        self._is_idle = threading.Event()  # from the last item on
        self._thread = threading.Thread(target=self._run, name='worker')

    def configure(self, queue_size: int, max_wait_s: float) -> None:
        """Use other limits from now on."""
        self._size, self._max_wait_ns = queue_size, round(max_wait_s * 1e9)

    def start(self) -> None:
        self._thread.start()

    def put(self, item: Item, size: int = 0) -> None:
        """Append an item of `size` bytes; return at once."""
        with self._changed:
            while self._items and (cause := self._overfull(size)):
                self._take()
                self.drops[cause] += 1
            self._items.append((time.monotonic_ns(), size, item))
            self._bytes += size
            self._changed.notify()

    def between_items(self, action: Action) -> None:
        """Let the thread call an action once, after the current item and before the next."""
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
        """Finish the current item and end the thread; return False if the item takes longer."""
        with self._changed:
            self.is_stopping = True
            self._changed.notify()
        if self._thread.ident is None:
            return True
        if is_idle := self._is_idle.wait(timeout_s):
            self._thread.join()
        return is_idle

    def _run(self) -> None:
        while (job := self._next_job()) is not None:
            job()
            # Otherwise it would keep its item, perhaps a large one, until the next arrives.
            del job
        self._is_idle.set()
        self._at_end()

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
            return partial(self._handle, self._take())

    def _take(self) -> Item:
        _, size, item = self._items.popleft()
        self._bytes -= size
        return item

    def _overfull(self, size: int) -> str:
        """Return the limit that another item of this size would exceed; empty if none."""
        if len(self._items) >= self._size:
            return 'queue_size'
        return 'memory' if self._bytes + size > self._most_bytes else ''

    def _is_late(self) -> bool:
        waited_ns = time.monotonic_ns() - self._items[0][0]
        return 0 < self._max_wait_ns < waited_ns


Result = TypeVar('Result')

_POLL_S = 0.005


class BackgroundWork:
    """
    Does the work of services in other threads, for which the process waits at its end.

    The service needs a separate callback group: the default one is blocked until the coroutine
    ends.
    """

    def __init__(self) -> None:
        self._threads = ThreadPoolExecutor(thread_name_prefix='service')

    async def result_of(self, work: Callable[[], Result]) -> Result:
        """Return the result of work, or raise its error, while other callbacks are served."""
        future = self._threads.submit(work)
        while not future.done():
            await Turn()
        return future.result()

    def finish(self) -> None:
        """Wait for all work to end."""
        self._threads.shutdown()


def fulfil(future: Future[Result], work: Callable[[], Result]) -> None:
    """Do some work, and set its result or its error in a future; not if that is cancelled."""
    if not future.set_running_or_notify_cancel():
        return
    try:
        future.set_result(work())
    except BaseException as error:
        future.set_exception(error)


class Turn:
    """
    Gives other callbacks a turn when it is awaited.

    An executor of rclpy polls waiting coroutines without a pause. One of all coroutines sleeps
    briefly now and then, so that threads get the processor. If each slept at each poll, many calls
    would delay the images.
    """

    _slept_s = 0.0

    def __await__(self) -> Generator[None, None, None]:
        if time.monotonic() - Turn._slept_s > _POLL_S:
            time.sleep(_POLL_S)
            Turn._slept_s = time.monotonic()
        yield
