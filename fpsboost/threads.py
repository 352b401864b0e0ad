"""Threads that run decoder, encoder and computation in parallel, connected by bounded queues.

An error in any thread is raised in the caller, and no thread outlives the ``with`` block, however it is left. If it is
never left, as by a generator that is suspended in it when the interpreter ends, the threads end then.
"""

import atexit
import os
from collections.abc import Callable, Generator, Iterable, Iterator
from concurrent.futures import Future
from contextlib import ExitStack, contextmanager
from queue import Empty, Full, Queue, SimpleQueue
from threading import Event, Semaphore, Thread, current_thread
from time import monotonic
from typing import Any, TypeVar

T = TypeVar("T")

POLL_INTERVAL = 0.1
"""Seconds between checks whether the other thread has stopped."""

GRACE = 2
"""Seconds that threads are waited for when the interpreter ends: one that a caller's source blocks would never end."""

_running: dict[Thread, Callable[[], None]] = {}
"""Threads of blocks that have not been left, each with the function that stops it."""


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


def decoder_threads() -> int:
    """Return the number of threads of a decoder: it has little to do, and each of them holds frames of its own."""
    return max(1, available_cores() // 4)


@atexit.register
def _stop_all() -> None:
    """Stop the threads of blocks that are never left: none may run while the interpreter is taken apart."""
    threads = dict(_running)
    _running.clear()  # so that nothing waits for a thread afterwards, when none can end
    for stop in threads.values():
        stop()
    deadline = monotonic() + GRACE
    for thread in threads:
        thread.join(max(deadline - monotonic(), 0))


@contextmanager
def _in_thread(
    run: Callable[[], None],
    name: str,
    stop: Callable[[], None],
    errors: list[BaseException],
    cancel: Callable[[], None],
) -> Generator[Thread]:
    """Run a function in a thread that ends with the block; `errors` gets a SystemExit if the interpreter ends first."""

    def give_up() -> None:
        errors.insert(0, SystemExit())  # first of all, so that nothing takes this for the end of the items
        stop()
        cancel()

    thread = Thread(target=run, name=name, daemon=True)  # else the interpreter would wait for it before all else
    try:
        _running[thread] = give_up
        thread.start()
        yield thread
    except BaseException:
        cancel()
        raise
    finally:
        stop()
        # Ctrl-C may arrive while it is about to start; and a block that is dropped may be left in any thread
        if thread in _running and thread.is_alive() and thread is not current_thread():
            thread.join()
        _running.pop(thread, None)


@contextmanager
def one_opencv_thread() -> Iterator[None]:
    """Keep OpenCV to one thread in this process, which must do nothing else, while the block lasts.

    Pairs of frames are worked on side by side, and threads that wait for parts of them take 1 % more CPU.
    """
    import cv2  # noqa: PLC0415 (--help does not wait for it)

    before = cv2.getNumThreads()
    cv2.setNumThreads(1)
    try:
        yield
    finally:
        cv2.setNumThreads(before)


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
            while room.acquire() and not stopped.is_set() and not isinstance(item := next(remaining, End()), End):
                queue.put(item)
        except BaseException as error:
            errors.append(error)
        queue.put(End())

    def received() -> Iterator[T]:
        for item in _items_of(queue, stopped):
            room.release()
            yield item
        if errors:
            raise errors[0]

    def stop() -> None:
        stopped.set()
        room.release()  # for a thread that waits for room

    with _in_thread(run, "fpsboost-ahead", stop, errors, cancel):
        yield received()


def _items_of(queue: Queue[T | End], stopped: Event) -> Iterator[T]:
    """Yield the items of a queue up to its end, or until the flag is set."""
    while not stopped.is_set():
        try:
            item = queue.get(timeout=POLL_INTERVAL)
        except Empty:
            continue
        if isinstance(item, End):
            return
        yield item


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
    waiting: SimpleQueue[tuple[Future[Any], Callable[[], Any]] | End] = SimpleQueue()
    stopped = Event()

    # not by a ThreadPoolExecutor, which takes no job any more as soon as the main thread ends, with others at work
    def work() -> None:
        while not isinstance(item := waiting.get(), End) and not stopped.is_set():
            future, job = item
            try:
                future.set_result(job())
            except BaseException as error:
                future.set_exception(error)
            del item, future, job  # what a finished job holds is free while the thread waits
        waiting.put(End())  # for the next thread

    def stop() -> None:
        stopped.set()
        waiting.put(End())

    def submit(job: Callable[[], T]) -> Future[T]:
        future = Future[T]()
        waiting.put((future, job))
        return future

    with ExitStack() as stack:
        for number in range(threads):
            stack.enter_context(_in_thread(work, f"fpsboost-pair-{number}", stop, [], nothing))

        def in_order(jobs: Iterable[Callable[[], T]]) -> Iterator[T]:
            # in addition to these, one job is being fetched
            for future in stack.enter_context(read_ahead(map(submit, jobs), threads, cancel)):
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
        for item in _items_of(queue, stopped):
            try:
                write(item)
            except BaseException as error:
                errors.append(error)
                stopped.set()

    def send(item: T | End) -> None:
        while not errors:
            try:
                return queue.put(item, timeout=POLL_INTERVAL)
            except Full:
                continue
        raise errors[0]

    with _in_thread(run, "fpsboost-write", stopped.set, errors, cancel) as thread:
        yield send
        send(End())
        thread.join()
    if errors:
        raise errors[0]
