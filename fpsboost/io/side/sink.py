"""Sink that writes side outputs beside another sink; see `fpsboost.io.side.options`."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import ExitStack
from pathlib import Path
from types import TracebackType
from typing import Self

from fpsboost.errors import OptionError
from fpsboost.frame import Frame
from fpsboost.io import Cancellable, FrameSink
from fpsboost.io.images.numbered import ImageSink
from fpsboost.io.images.sequence import NumberedImages
from fpsboost.io.side.names import FileNames
from fpsboost.io.side.options import SideOutputs
from fpsboost.io.side.writers import ConfidenceWriter, MotionWriter, SideWriter
from fpsboost.observer import FrameWatcher


class SideSink:
    """Sink that passes frames on to another one, and writes what is known of them beside.

    Parameters
    ----------
    sink : FrameSink
    confidence : ConfidenceWriter, optional
    motion : MotionWriter, optional
    watcher : FrameWatcher, optional
    """

    def __init__(
        self,
        sink: FrameSink,
        confidence: ConfidenceWriter | None,
        motion: MotionWriter | None,
        watcher: FrameWatcher | None = None,
    ) -> None:
        self._sink, self.holds_last_frame, self._watcher = sink, sink.holds_last_frame, watcher
        self.needs_confidence = confidence is not None or (watcher is not None and watcher.needs_confidence)
        self.needs_motion = motion is not None
        self._writers: Sequence[SideWriter] = [each for each in (confidence, motion) if each is not None]

    @property
    def remarks(self) -> list[str]:
        """See `fpsboost.contracts.FrameSink.remarks`."""
        return [*self._sink.remarks, *(remark for writer in self._writers for remark in writer.remarks)]

    @property
    def details(self) -> str:
        """How the other sink writes its target."""
        return getattr(self._sink, "details", "")

    def cancel(self) -> None:
        """See `fpsboost.contracts.Cancellable.cancel`."""
        if isinstance(self._sink, Cancellable):
            self._sink.cancel()

    def write(self, frame: Frame) -> None:
        """Write the next frame, and what is known of it."""
        for writer in self._writers:
            writer.write(frame)
        if self._watcher is not None:
            self._watcher.watch(frame)
        self._sink.write(frame)

    def __enter__(self) -> Self:
        with ExitStack() as opened:
            for writer in self._writers:
                opened.callback(writer.files.close)
                writer.files.open()
            self._sink.__enter__()
            opened.pop_all()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        with ExitStack() as opened:
            for writer in self._writers:
                opened.callback(writer.files.close)
            try:
                if kind is None:
                    self._finish()
            except BaseException as failure:
                self._sink.__exit__(type(failure), failure, failure.__traceback__)
                raise
            self._sink.__exit__(kind, error, trace)
            if kind is None:
                for writer in self._writers:
                    writer.files.publish()

    def _finish(self) -> None:
        """Write what is left, and look once more for files in the way: the output gets its name next."""
        for writer in self._writers:
            writer.finish()
            writer.files.check()


def with_side_outputs(
    sink: FrameSink,
    side: SideOutputs,
    images: NumberedImages | None,
    *,
    overwrite: bool,
    watcher: FrameWatcher | None = None,
) -> FrameSink:
    """Return a sink that also writes side outputs, and shows frames; the same sink if neither is asked for.

    Parameters
    ----------
    sink : FrameSink
        Not entered yet.
    side : SideOutputs
    images : NumberedImages or None
        The images that are read, if the source has images.
    overwrite : bool
        Replace existing files.
    watcher : FrameWatcher, optional
        Sees every frame before it is written.

    Returns
    -------
    FrameSink

    Raises
    ------
    OptionError
        A path names neither a folder nor a pattern of a type that can be written, or no folder of its own.
    OutputError
        Files exist there already, or the place cannot be written.
    """
    if not side.given and watcher is None:
        return sink
    taken = [images.files[0].parent] if images else []
    taken += [sink.numbering.folder] if isinstance(sink, ImageSink) else []
    confidence = motion = None
    if side.confidence is not None:
        names = FileNames.after_output(side.confidence, "`confidence`", ConfidenceWriter.suffixes, sink)
        _check_alone(names.folder, "`confidence`", taken)
        confidence = ConfidenceWriter(names, overwrite=overwrite)
        taken.append(names.folder)
    if side.save_motion is not None:
        names = FileNames.after_source(side.save_motion, "`save_motion`", MotionWriter.suffixes, images)
        _check_alone(names.folder, "`save_motion`", taken)
        motion = MotionWriter(names, overwrite=overwrite)
    return SideSink(sink, confidence, motion, watcher)


def _check_alone(folder: Path, option: str, taken: Sequence[Path]) -> None:
    """Raise `OptionError` if a folder is one that frames are read from, or that other files are written to."""
    if folder.resolve() in {each.resolve() for each in taken}:
        raise OptionError(f"{option} needs a folder of its own, and {folder} holds other images; name another.")
