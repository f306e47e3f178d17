from __future__ import annotations

import threading
import time

import pytest
from hypothesis import given
from hypothesis import strategies as st

from railinspect._threads import Worker, prefetch


@given(st.lists(st.integers()), st.integers(1, 4))
def test_prefetch_keeps_items_and_order(items, depth):
    assert list(prefetch(items, depth)) == items


def test_prefetch_raises_after_the_items_before_the_error():
    def items():
        yield 1
        raise ValueError("broken")

    ahead = prefetch(items())
    assert next(ahead) == 1
    with pytest.raises(ValueError, match="broken"):
        next(ahead)


def test_prefetch_is_bounded_and_stops_when_left():
    made: list[int] = []

    def items():
        for index in range(1000):
            made.append(index)
            yield index

    before = threading.active_count()
    ahead = prefetch(items(), depth=2)
    next(ahead)
    time.sleep(0.1)
    ahead.close()
    assert len(made) <= 5
    assert threading.active_count() == before


def test_worker_works_in_order_and_hands_back_the_error():
    done: list[int] = []
    worker = Worker(done.append)
    for index in range(20):
        worker.put(index)
    worker.close()
    assert done == list(range(20))

    def fail(item: int) -> None:
        raise OSError("disk full")

    failing = Worker(fail, depth=1)
    with pytest.raises(OSError, match="disk full"):  # noqa: PT012  (put or close may raise)
        for index in range(10):
            failing.put(index)
        failing.close()
    failing.close()
