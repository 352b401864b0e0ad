"""Standard input and standard output: reads and writes that another thread can cancel, and a file object for FFmpeg."""

import os
import select
import stat
from collections.abc import Callable
from contextlib import suppress
from threading import Event
from typing import Any, TextIO, TypeVar

from fpsboost.errors import FpsboostError

T = TypeVar("T")


INPUT_NAME = "standard input"


OUTPUT_NAME = "standard output"


POLL_INTERVAL = 0.1
"""Interval, seconds, at which a thread that waits for the program at the other end checks for cancellation."""


MAX_READ = 1 << 16
"""Bytes that are read at once; a pipe holds no more."""


class CountingReader:
    """File object for FFmpeg that counts the bytes read, because its demuxer does not report a truncated frame.

    FFmpeg would swallow an exception raised while reading, including those of signals, and go on. Here it is kept, the
    stream ends for FFmpeg, and `check` raises it.

    Parameters
    ----------
    stream : file object
        Anything with `read`, such as a binary file or a `Descriptor`; it is never closed here.
    """

    def __init__(self, stream: Any) -> None:
        self._stream = stream
        self.count = 0
        self.start = b""
        self._error: BaseException | None = None

    def read(self, size: int) -> bytes:
        """Return at most `size` bytes for FFmpeg; none at the end, and from the first exception on."""
        try:
            data = b"" if self._error else self._stream.read(size)
        except BaseException as error:
            self._error = error
            data = b""
        self.count += len(data)
        if b"\n" not in self.start:
            self.start += data
        return data

    def check(self) -> None:
        """Raise the exception that ended reading, if there was one."""
        if self._error is not None:
            raise self._error


class Descriptor:
    """Unbuffered standard stream whose reads and writes another thread can cancel while they wait.

    Parameters
    ----------
    number : int
        File descriptor, which is never closed here.
    """

    def __init__(self, number: int) -> None:
        self._number = number
        self._given_up = Event()
        # a pipe that select() reports as writable takes this much without blocking
        self._portion = 1 << 20 if stat.S_ISREG(os.fstat(number).st_mode) else getattr(select, "PIPE_BUF", 1 << 16)

    def cancel(self) -> None:
        """End the call that waits for this stream in another thread, and all later ones, with an OSError."""
        self._given_up.set()

    def read(self, size: int) -> bytes:
        """Return at most `size` bytes, as soon as there are any; none at the end of the stream."""
        return self._when_ready(True, lambda: os.read(self._number, min(size, MAX_READ)))

    def write(self, data: memoryview) -> int:
        """Write the beginning of `data` as soon as the stream takes any; return the number of bytes written."""
        return self._when_ready(False, lambda: os.write(self._number, data[: self._portion]))

    def _when_ready(self, to_read: bool, transfer: Callable[[], T]) -> T:
        """Wait until the descriptor is readable or writable, then return the result of the transfer."""
        ends = ([self._number], []) if to_read else ([], [self._number])
        while True:
            if self._given_up.is_set():
                raise OSError("given up")
            if os.name == "nt" or any(select.select(*ends, [], POLL_INTERVAL)):  # Windows can ask sockets only
                with suppress(BlockingIOError):
                    return transfer()


def descriptor_of(stream: TextIO | None, kind: type[FpsboostError], name: str) -> Descriptor:
    """Return the descriptor of a standard stream; raise an error of class `kind` if it is closed or a terminal."""
    advice = "pipe a YUV4MPEG2 stream into it" if name == INPUT_NAME else "pipe it into a program"
    if stream is None or stream.closed:
        raise kind(f"{name} is closed; {advice}, or name a file.")
    if stream.isatty():
        raise kind(f"{name} is a terminal; {advice}, or name a file.")
    return Descriptor(stream.fileno())
