"""Reading ahead, computing side by side and writing behind: order, errors, bounds, and no thread left over."""

from __future__ import annotations

import itertools
import threading
from collections.abc import Callable, Iterator
from functools import partial
from queue import Full, Queue
from typing import Any

import pytest

from fpsboost.threads import read_ahead, run_in_parallel, write_behind


class OnPurposeError(Exception):
    """Raised by the tests."""


@pytest.fixture(autouse=True)
def _no_thread_is_left() -> Iterator[None]:
    before = set(threading.enumerate())
    yield
    assert set(threading.enumerate()) == before


def failing_after(count: int) -> Iterator[int]:
    """0, 1, ... and then an error."""
    yield from range(count)
    raise OnPurposeError(f"after {count}")


@pytest.mark.parametrize("count", [0, 200])
@pytest.mark.parametrize("depth", [1, 4, 1000])
def test_both_sides_keep_the_order(depth, count):
    """All items are read, computed and written in order, and all have been written when the block is left."""
    written: list[int] = []
    with read_ahead(range(count), depth) as items, write_behind(written.append, depth) as write:
        for item in items:
            write(item * 2)
    assert written == list(range(0, 2 * count, 2))


@pytest.mark.parametrize("count", [0, 3, 20])
def test_errors_while_reading_surface_after_the_items_before_them(count):
    """The caller gets everything that was read, and then the very error."""
    received = []
    with pytest.raises(OnPurposeError, match=f"after {count}"), read_ahead(failing_after(count), 2) as items:
        received.extend(items)
    assert received == list(range(count))


def test_read_ahead_stays_within_its_depth(monkeypatch):
    """No more are read before the caller asks, and then one for each that it takes."""
    waited, taken = threading.Event(), []

    class Telling(threading.Semaphore):
        def acquire(self, *arguments: Any, **options: Any) -> bool:
            has_room = super().acquire(*arguments, **options)
            if not has_room:
                waited.set()
            return has_room

    monkeypatch.setattr("fpsboost.threads.Semaphore", Telling)

    def source() -> Iterator[int]:
        for k in itertools.count():
            taken.append(k)
            yield k

    with read_ahead(source(), 3) as items:
        for number in range(3):
            for _ in range(3):  # the first time may be from before the caller took one; later nothing more is taken
                waited.clear()
                assert waited.wait(10)
            assert len(taken) == 3 + number
            assert next(items) == number


def test_leaving_early_stops_an_endless_source_with_a_full_queue():
    """The block can be left at any time; the thread ends with it."""
    with read_ahead(itertools.count(), 2) as items:
        assert [next(items) for _ in range(5)] == [0, 1, 2, 3, 4]


@pytest.mark.parametrize("items", [itertools.count(), failing_after(0)], ids=["endless", "failing"])
def test_leaving_by_an_exception_stops_the_reader(items):
    """The body's own error is the one that counts, also when the source has failed unseen."""
    with pytest.raises(ZeroDivisionError), read_ahead(items, 2):
        raise ZeroDivisionError


def test_what_waits_for_another_program_is_told_to_give_up():
    """Leaving by an exception lets a reader and a writer go that would wait forever; leaving normally tells nobody."""
    told = threading.Event()

    def read_and_fail() -> None:
        with read_ahead(iter(lambda: told.wait(60), True), 2, told.set):
            raise OnPurposeError

    def write_and_fail() -> None:
        with write_behind(lambda _: told.wait(60), 2, told.set) as write:
            write(0)
            raise OnPurposeError

    for leave in (read_and_fail, write_and_fail):
        told.clear()
        with pytest.raises(OnPurposeError):
            leave()
        assert told.is_set()
    told.clear()
    with read_ahead(range(3), 2, told.set) as items, write_behind(lambda _: None, 2, told.set) as write:
        for item in items:
            write(item)
    assert not told.is_set()


@pytest.mark.parametrize("good", [0, 3])
def test_errors_while_writing_surface_in_the_caller(good):
    """An endless producer is stopped by the very error of the writer, though the queue is full."""
    written: list[int] = []

    def write_some(item: int) -> None:
        if len(written) == good:
            raise OnPurposeError("disk full")
        written.append(item)

    def write_forever() -> None:
        with write_behind(write_some, 2) as write:
            for k in itertools.count():
                write(k)

    with pytest.raises(OnPurposeError, match="disk full"):
        write_forever()
    assert written == list(range(good))


def test_errors_of_the_last_writes_surface_when_the_block_is_left():
    """Nobody calls again after the last item, and still its error is not lost."""

    def fail(item: int) -> None:
        raise OnPurposeError(item)

    with pytest.raises(OnPurposeError), write_behind(fail, 2) as write:
        write(1)


def test_leaving_by_an_exception_drops_what_is_not_written(monkeypatch):
    """The body's own error comes through, the item in hand is finished, the rest is not written."""
    started, release = threading.Event(), threading.Event()
    written: list[int] = []

    class Telling(threading.Event):
        """Lets the item in hand be finished as soon as the writer has been told to stop."""

        def set(self) -> None:
            super().set()
            release.set()

    monkeypatch.setattr("fpsboost.threads.Event", Telling)

    def slow(item: int) -> None:
        started.set()
        release.wait(10)
        written.append(item)

    def write_five() -> None:
        with write_behind(slow, 8) as write:
            for k in range(5):
                write(k)
            assert started.wait(10)
            raise ZeroDivisionError

    with pytest.raises(ZeroDivisionError):
        write_five()
    assert release.is_set()
    assert written == [0]


def test_write_behind_stays_within_its_depth(monkeypatch):
    """With the writer held up, the caller gets as far as the queue and the one item in hand."""
    refused, release, ended, sent = threading.Event(), threading.Event(), threading.Event(), []

    class Telling(Queue):
        def put(self, *arguments: Any, **options: Any) -> None:
            try:
                super().put(*arguments, **options)
            except Full:
                refused.set()
                raise

    monkeypatch.setattr("fpsboost.threads.Queue", Telling)

    def produce() -> None:
        with write_behind(lambda _: release.wait(10), 3) as write:
            for k in range(9):
                write(k)
                sent.append(k)
        ended.set()

    thread = threading.Thread(target=produce)
    thread.start()
    for _ in range(3):  # nothing more may be sent, however often it is tried
        assert refused.wait(10)
        refused.clear()
        assert len(sent) <= 4
    release.set()
    assert ended.wait(10)
    thread.join()
    assert sent == list(range(9))


@pytest.mark.parametrize("has_started", [True, False])
@pytest.mark.parametrize("side", [partial(read_ahead, itertools.count(), 2), partial(write_behind, id, 2)])
def test_no_thread_is_left_by_an_interruption_of_its_start(monkeypatch, side, has_started):
    """Ctrl-C may arrive while the caller waits for the thread to start."""

    class Interrupted(threading.Thread):
        def start(self) -> None:
            if has_started:
                super().start()
            raise KeyboardInterrupt

    monkeypatch.setattr("fpsboost.threads.Thread", Interrupted)
    with pytest.raises(KeyboardInterrupt), side():
        pass


@pytest.mark.parametrize("threads", [1, 2, 7])
def test_results_come_in_the_order_of_the_jobs(threads):
    """Whichever ends first, and none is lost."""
    late = threading.Event()

    def job(number: int) -> int:
        if number == 0 and threads > 1:
            assert late.wait(10)
        if number == 1:
            late.set()
        return number

    with run_in_parallel(threads) as in_order:
        assert list(in_order(partial(job, number) for number in range(30))) == list(range(30))


@pytest.mark.parametrize("threads", [1, 3])
def test_no_more_jobs_are_taken_than_there_is_room_for(threads):
    """One more than there are threads, and those that were fetched."""
    taken = []

    def jobs() -> Iterator[Callable[[], int]]:
        for number in range(50):
            taken.append(number)
            yield partial(int, number)

    with run_in_parallel(threads) as in_order:
        for number, result in enumerate(in_order(jobs())):
            assert result == number
            assert len(taken) <= number + 1 + threads


@pytest.mark.parametrize("threads", [1, 4])
@pytest.mark.parametrize("where", ["job", "jobs", "caller"])
def test_an_error_beside_other_jobs_surfaces_in_its_turn(threads, where):
    """After the results before it; whatever waits is dropped, and no thread is left."""

    def job(number: int) -> int:
        if where == "job" and number == 5:
            raise OnPurposeError
        return number

    received = []

    def fetch() -> None:
        source = failing_after(5) if where == "jobs" else itertools.count()
        with run_in_parallel(threads) as in_order:
            for result in in_order(partial(job, number) for number in source):
                received.append(result)
                if where == "caller" and result == 4:
                    raise OnPurposeError

    with pytest.raises(OnPurposeError):
        fetch()
    assert received == list(range(len(received)))
    assert where == "jobs" or len(received) == 5
