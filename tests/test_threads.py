"""Reading ahead, computing side by side and writing behind: how they end, and that no thread is left over."""

import itertools
import threading
from collections.abc import Iterator
from functools import partial

import pytest

from fpsboost.threads import read_ahead, run_in_parallel, write_behind

pytestmark = pytest.mark.usefixtures("no_thread_left")


class OnPurposeError(Exception):
    """Raised by the tests."""


def failing_after(count: int) -> Iterator[int]:
    """0, 1, ... and then an error."""
    yield from range(count)
    raise OnPurposeError(f"after {count}")


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
