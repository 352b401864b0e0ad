"""Where frames come from and go to.

Two contracts, `FrameSource` and `FrameSink`. `fpsboost.io.opening` picks an implementation by looking at a path,
which names a video file, an animation, a folder of images, a pattern of images (``shot_%04d.png``, ``shot_####.png``),
or a pipe (``-``).
"""

from __future__ import annotations

from collections.abc import Iterator
from types import TracebackType
from typing import Protocol, Self, runtime_checkable

from fpsboost.frame import ClipInfo, Frame


class FrameSource(Protocol):
    """Contract: a clip that is read once, in presentation order.

    Opening reads only headers. Iterating yields frames whose times strictly increase and whose images all have one
    shape and dtype, and raises `InputError` where the material does not allow that. A source is a context manager;
    leaving it closes the file.
    """

    @property
    def info(self) -> ClipInfo: ...

    @property
    def remarks(self) -> list[str]:
        """Sentences about what was lost or guessed so far (damage, missing duration); complete after the last frame."""
        ...

    def __iter__(self) -> Iterator[Frame]: ...

    def close(self) -> None: ...

    def __enter__(self) -> Self: ...

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None: ...


class Closing:
    """A context manager that closes what it is when it is left."""

    def close(self) -> None:
        """Let go of everything."""
        raise NotImplementedError

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()


class FrameSink(Protocol):
    """Contract: a target that appears whole or not at all; only what goes into a pipe cannot be taken back.

    Frames are written in order, each with its time and duration set. A sink is a context manager: leaving it normally
    finishes the output and gives it its final name; leaving it by an exception removes every trace, but for finished
    frames that a later run can go on with. What stood under the final name before stays untouched until then. Raises
    `OutputError`, never a bare OSError.
    """

    holds_last_frame: bool
    """True where the last frame must be shown for its duration (video); False where a clip ends with it (images)."""

    @property
    def remarks(self) -> list[str]:
        """Sentences about what the target could not hold."""
        ...

    def write(self, frame: Frame) -> None: ...

    def __enter__(self) -> Self: ...

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None: ...


@runtime_checkable
class Resumable(Protocol):
    """Contract: a sink that can go on with what an earlier run of the same job has finished.

    Frames that are there are written again in their turn, with their times and durations; only their pixels are not
    looked at, so that nobody need make them.
    """

    @property
    def completed_frames(self) -> int:
        """How many frames, from the first, an earlier run has finished; known when the sink is entered."""
        ...


@runtime_checkable
class Cancellable(Protocol):
    """Contract: a source or sink that waits for another program, perhaps forever."""

    def cancel(self) -> None:
        """Stop waiting: a call in another thread ends with an exception."""
        ...
