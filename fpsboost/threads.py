"""Threads that run decoder, encoder and computation in parallel, connected by bounded queues.

An error in any thread is raised in the caller, and no thread outlives the ``with`` block, however it is left.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Generator, Iterable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack, contextmanager
from queue import Empty, Full, Queue
from threading import Event, Semaphore, Thread
from typing import TypeVar

T = TypeVar("T")

POLL_INTERVAL = 0.1
"""Seconds between checks whether the other thread has stopped."""


class End:
    """Mark in a queue that no item follows, so that nobody waits for one."""


def nothing() -> None:
    """Do nothing."""


def available_cores() -> int:
    """Return the number of cores that this process may use."""
    try:
        return len(os.sched_getaffinity(0))
    except AttributeError:  # not Linux
        return os.cpu_count() or 1


@contextmanager
def read_ahead(items: Iterable[T], depth: int, cancel: Callable[[], None] = nothing) -> Generator[Iterator[T]]:
    """Run an iterable in a thread, up to `depth` items ahead of the caller, including the one that is being fetched.

    Yields an iterator over the items, which raises what the iterable raised. `cancel` is called when the block is left
    by an exception, so that an iterable that waits for another program stops.
    """
    queue: Queue[T | End] = Queue()
    room = Semaphore(depth)
    stopped = Event()
    errors: list[BaseException] = []

    def run() -> None:
        try:
            remaining = iter(items)
            # an item is only fetched when there is room, so that none waits beside the queue
            while _acquire(room, stopped) and not isinstance(item := next(remaining, End()), End):
                queue.put(item)
        except BaseException as error:
            errors.append(error)
        queue.put(End())

    def received() -> Iterator[T]:
        while not stopped.is_set():
            try:
                item = queue.get(timeout=POLL_INTERVAL)
            except Empty:
                continue
            if isinstance(item, End):
                break
            room.release()
            yield item
        if errors:
            raise errors[0]

    thread = Thread(target=run, name="fpsboost-ahead")
    try:
        thread.start()
        yield received()
    except BaseException:
        cancel()
        raise
    finally:
        stopped.set()
        _join(thread)


def _join(thread: Thread) -> None:
    """Wait for a thread to end, unless it has not started: Ctrl-C may arrive while it is about to."""
    if thread.is_alive():
        thread.join()


def _acquire(room: Semaphore, stopped: Event) -> bool:
    """Wait until there is room; return whether that was before the flag was set."""
    while not stopped.is_set():
        if room.acquire(timeout=POLL_INTERVAL):
            return not stopped.is_set()
    return False


def _put(queue: Queue[T | End], item: T | End, stopped: Event) -> None:
    """Put an item into a queue when it has room, unless the flag is set before."""
    while not stopped.is_set():
        try:
            return queue.put(item, timeout=POLL_INTERVAL)
        except Full:
            continue


@contextmanager
def run_in_parallel(
    threads: int, cancel: Callable[[], None] = nothing
) -> Generator[Callable[[Iterable[Callable[[], T]]], Iterator[T]]]:
    """Run jobs in threads, a few at a time; with one thread in the caller's own, each when its result is asked for.

    Yields a function that takes an iterable of jobs, which is advanced in a thread of its own when there is room for
    the next job: one more than there are threads are running or wait to be fetched. It yields their results in order,
    each as soon as it is available, and raises what a job or the iterable raised. `cancel` as in `read_ahead`.
    """
    if threads == 1:
        yield lambda jobs: (job() for job in jobs)
        return
    with ExitStack() as stack:
        pool = ThreadPoolExecutor(threads, "fpsboost-pair")
        stack.callback(pool.shutdown, cancel_futures=True)

        def in_order(jobs: Iterable[Callable[[], T]]) -> Iterator[T]:
            # in addition to these, one job is being fetched
            running = stack.enter_context(read_ahead((pool.submit(job) for job in jobs), threads, cancel))
            for future in running:
                yield future.result()

        yield in_order


@contextmanager
def write_behind(
    write: Callable[[T], None], depth: int, cancel: Callable[[], None] = nothing
) -> Generator[Callable[[T], None]]:
    """Call a function in a thread, up to `depth` items behind the caller.

    Yields a function that takes one item and raises what `write` raised on an earlier one. Leaving the block waits for
    the remaining items, or drops them if the block is left by an exception; `cancel` as in `read_ahead`.
    """
    queue: Queue[T | End] = Queue(depth)
    stopped = Event()
    errors: list[BaseException] = []

    def run() -> None:
        while not stopped.is_set():
            try:
                item = queue.get(timeout=POLL_INTERVAL)
            except Empty:
                continue
            if isinstance(item, End):
                return
            try:
                write(item)
            except BaseException as error:
                errors.append(error)
                stopped.set()

    def send(item: T) -> None:
        while True:
            if errors:
                raise errors[0]
            try:
                return queue.put(item, timeout=POLL_INTERVAL)
            except Full:
                continue

    thread = Thread(target=run, name="fpsboost-write")
    try:
        thread.start()
        yield send
        _put(queue, End(), stopped)
        thread.join()
    except BaseException:
        cancel()
        raise
    finally:
        stopped.set()
        _join(thread)
    if errors:
        raise errors[0]
