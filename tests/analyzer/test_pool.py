"""Threads that share work: order, what is raised and where, and that nothing is left running."""

from __future__ import annotations

import random
import threading
import time
from collections.abc import Callable, Iterator
from functools import partial

import pytest

from analyzer.pool import MOST_WEIGHT, Pool

THREADS = [1, 2, 3, 8]


def running() -> int:
    """Threads that run now."""
    return threading.active_count()


@pytest.mark.parametrize("threads", THREADS)
def test_results_come_in_order(threads: int) -> None:
    chance = random.Random(threads)
    delays = [chance.choice([0, 0, 0.001]) for _ in range(200)]
    written: list[int] = []
    at_once: list[int] = []

    def task(number: int) -> Callable[[], Callable[[], None]]:
        def prepare() -> Callable[[], None]:
            time.sleep(delays[number])

            def finish() -> None:
                at_once.append(number)
                assert len(at_once) == 1
                written.append(number)
                at_once.pop()

            return finish

        return prepare

    before = running()
    with Pool(threads) as pool:
        for number in pool.ahead(iter(range(200))):
            time.sleep(delays[-number])
            pool.submit(task(number))
    assert written == list(range(200))
    assert running() == before


@pytest.mark.parametrize("threads", THREADS)
def test_no_more_waits_than_a_few(threads: int) -> None:
    """However slow the output is, the caller takes part before much has piled up."""
    begun, done = 0, 0
    most = 0

    def finish() -> None:
        nonlocal done
        time.sleep(0.001)
        done += 1

    with Pool(threads) as pool:
        for _ in range(50):
            pool.submit(lambda: finish, MOST_WEIGHT // 4)
            begun += 1
            most = max(most, begun - done)
    assert done == 50
    assert most <= 5


@pytest.mark.parametrize("threads", THREADS)
def test_what_a_task_raises_is_raised_in_its_order(threads: int) -> None:
    written: list[int] = []

    def task(number: int) -> Callable[[], None]:
        if number == 5:
            time.sleep(0.01)
            raise ValueError(number)
        return lambda: written.append(number)

    def run() -> None:
        with Pool(threads) as pool:
            for number in range(20):
                pool.submit(partial(task, number))

    before = running()
    with pytest.raises(ValueError, match="5"):
        run()
    assert written == list(range(5))
    assert running() == before


@pytest.mark.parametrize("threads", THREADS)
def test_an_error_of_what_is_read_comes_behind_what_was_before(threads: int) -> None:
    def items() -> Iterator[int]:
        yield from range(5)
        raise OSError("gone")

    got: list[int] = []

    def run() -> None:
        with Pool(threads) as pool:
            for item in pool.ahead(items()):
                time.sleep(0.001)
                got.append(item)

    with pytest.raises(OSError, match="gone"):
        run()
    assert got == list(range(5))


@pytest.mark.parametrize("threads", THREADS)
def test_what_is_read_ahead_can_be_left(threads: int) -> None:
    """Nobody reads any more when the caller goes on, as it closes the file."""
    is_open = True

    def items() -> Iterator[int]:
        for item in range(1000):
            assert is_open
            time.sleep(0.001)
            yield item

    with Pool(threads) as pool:
        for _ in range(3):
            is_open = True
            found = pool.ahead(items())
            assert [next(found), next(found)] == [0, 1]
            found.close()
            is_open = False
            pool.submit(lambda: lambda: None)


def test_an_interrupted_caller_waits_for_nobody() -> None:
    """A second Ctrl-C ends the program although a thread waits for who reads its output."""
    released = threading.Event()

    def stall() -> None:
        released.wait(60)

    def run() -> None:
        with Pool(2) as pool:
            pool.submit(lambda: stall)
            raise KeyboardInterrupt

    before = time.monotonic()
    with pytest.raises(KeyboardInterrupt):
        run()
    assert time.monotonic() - before < 30
    released.set()
