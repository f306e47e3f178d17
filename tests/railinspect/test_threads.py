from __future__ import annotations

import threading
import time

import pytest
from hypothesis import given
from hypothesis import strategies as st

from railinspect._threads import Worker, prefetch, side_by_side


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


@pytest.mark.parametrize("lanes", [1, 2, 5])
def test_lanes_keep_the_order_whichever_is_done_first(lanes: int) -> None:
    def slow_at_first(number: int) -> int:
        time.sleep(0.02 / (1 + number))
        return number * number

    assert list(side_by_side(slow_at_first, range(9), lanes)) == [n * n for n in range(9)]


def test_lanes_work_at_once() -> None:
    both = threading.Barrier(2, timeout=10)
    assert list(side_by_side(lambda _: both.wait() < 2, range(4), 2)) == [True] * 4


def test_lanes_take_few_items_ahead() -> None:
    taken: list[int] = []

    def items():
        for number in range(100):
            taken.append(number)
            yield number

    lanes = side_by_side(lambda number: number, items(), 2)
    assert next(lanes) == 0
    assert len(taken) <= 4
    lanes.close()


def test_a_lanes_and_the_items_exceptions_come_after_what_was_before_them() -> None:
    def items():
        yield from (4, 2)
        raise RuntimeError("no more")

    lanes = side_by_side(lambda number: 8 / number, items(), 3)
    assert [next(lanes), next(lanes)] == [2.0, 4.0]
    with pytest.raises(RuntimeError, match="no more"):
        next(lanes)
    lanes = side_by_side(lambda number: 8 / number, [1, 0, 2], 2)
    assert next(lanes) == 8.0
    with pytest.raises(ZeroDivisionError):
        next(lanes)
