"""Running a producer or a consumer aside, in order, with a bounded queue between."""

from __future__ import annotations

import os
import queue
import threading
from collections import deque
from collections.abc import Callable, Generator, Iterable
from concurrent.futures import Future, ThreadPoolExecutor
from typing import Generic, TypeVar

R = TypeVar("R")
T = TypeVar("T")


def usable_cores() -> int:
    """Processor cores this process may run on."""
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


def prefetch(items: Iterable[T], depth: int = 2) -> Generator[T, None, None]:
    """Iterate ``items`` in a background thread, at most ``depth`` items ahead.

    An exception of the producer is raised here, after the items before it. Closing the returned
    generator stops the thread.
    """
    ahead: queue.Queue[tuple[bool, T | BaseException | None]] = queue.Queue(max(depth, 1))
    stop = threading.Event()

    def put(message: tuple[bool, T | BaseException | None]) -> None:
        while not stop.is_set():
            try:
                ahead.put(message, timeout=0.1)
            except queue.Full:
                continue
            return

    def produce() -> None:
        try:
            for item in items:
                put((True, item))
                if stop.is_set():
                    return
            put((False, None))
        except BaseException as error:  # handed to the consumer, which raises it
            put((False, error))

    thread = threading.Thread(target=produce, name="railinspect-prefetch", daemon=True)
    thread.start()
    try:
        while True:
            more, value = ahead.get()
            if more:
                yield value  # type: ignore[misc]  # an item, as `more` says
            elif isinstance(value, BaseException):
                raise value
            else:
                return
    finally:
        stop.set()
        thread.join()


def one_ahead(items: Iterable[T]) -> Generator[T, None, None]:
    """Iterate in a background thread that asks for the next item when the last has been taken.

    So an item is as new as it can be while its making overlaps with the use of the one before.
    Whoever closes this while ``items`` waits for something must end that wait first.
    """
    wanted = threading.Semaphore(1)
    closed = threading.Event()

    def gated() -> Generator[T, None, None]:
        iterator = iter(items)
        while True:
            wanted.acquire()
            if closed.is_set():
                return
            try:
                item = next(iterator)
            except StopIteration:
                return
            yield item

    ahead = prefetch(gated(), 1)
    try:
        for item in ahead:
            wanted.release()
            yield item
    finally:
        closed.set()
        wanted.release()
        ahead.close()


def side_by_side(
    function: Callable[[T], R], items: Iterable[T], lanes: int
) -> Generator[R, None, None]:
    """Apply ``function`` to ``items`` in ``lanes`` threads at once; results come in order.

    At most one result waits beside those in the making. An exception of the function or of the
    items is raised here, after the results before it.
    """
    iterator, ended = iter(items), False
    begun: deque[Future[R]] = deque()
    broken: BaseException | None = None
    with ThreadPoolExecutor(lanes, "railinspect-lane") as pool:
        try:
            while True:
                while not ended and len(begun) <= lanes:
                    try:
                        begun.append(pool.submit(function, next(iterator)))
                    except StopIteration:
                        ended = True
                    except BaseException as error:  # raised when its turn comes
                        ended, broken = True, error
                if not begun:
                    break
                yield begun.popleft().result()
            if broken is not None:
                raise broken
        finally:
            for future in begun:
                future.cancel()


class Worker(Generic[T]):
    """Hands items to a function in a background thread, in order, at most ``depth`` waiting.

    The function's first exception is raised by the next ``put`` or by ``close``.
    """

    def __init__(self, function: Callable[[T], None], depth: int = 3) -> None:
        self._function = function
        self._items: queue.Queue[tuple[T] | None] = queue.Queue(depth)
        self._error: BaseException | None = None
        self._failed = False
        self._thread = threading.Thread(target=self._run, name="railinspect-worker", daemon=True)
        self._thread.start()

    def put(self, item: T) -> None:
        """Queue an item; blocks while ``depth`` items are waiting."""
        self._raise()
        self._items.put((item,))

    def close(self) -> None:
        """Wait until every queued item is done."""
        if self._thread.is_alive():
            self._items.put(None)
            self._thread.join()
        self._raise()

    def _run(self) -> None:
        while (boxed := self._items.get()) is not None:
            if self._failed:
                continue  # drain, so that put never blocks for ever
            try:
                self._function(boxed[0])
            except BaseException as error:  # re-raised in the owner's thread
                self._error, self._failed = error, True

    def _raise(self) -> None:
        if self._error is not None:
            error, self._error = self._error, None
            raise error
