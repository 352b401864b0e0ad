"""Side outputs of a conversion, written in step with another sink; see `fpsboost.io.side.options`."""

from __future__ import annotations

import os
import sys
from collections.abc import Iterable, Mapping, Sequence
from contextlib import ExitStack
from dataclasses import replace
from pathlib import Path
from types import TracebackType
from typing import ClassVar, Self

import numpy as np

from fpsboost.contracts import Cancellable, FrameSink, FrameWatcher
from fpsboost.errors import OptionError, OutputError, explained
from fpsboost.frame import Frame, PairMotion
from fpsboost.io.images.encoder import encode_image
from fpsboost.io.images.exr import encode_exr
from fpsboost.io.images.files import IMAGE_SUFFIXES, extension_of
from fpsboost.io.images.sequence import NumberedImages, Numbering
from fpsboost.io.images.sink import VIDEO_DIGITS, ImageSink
from fpsboost.io.images.source import is_pattern
from fpsboost.io.new_output import ADVICE, StagedFiles
from fpsboost.io.side.flow import BACKWARD, FORWARD, encode_flow, flow_picture
from fpsboost.io.side.options import SideOutputs
from fpsboost.media import write_safely
from fpsboost.remarks import Remarks

PICTURE = ".png"
EXR = ".exr"
FLO = ".flo"
FLOW_PICTURES = ("_backward.png", "_forward.png")
"""Ends of the names of the pictures beside the files of a frame's motion."""


class SideSink:
    """Sink that passes frames on to another one, writes side outputs of them, and shows them to a watcher.

    The side outputs get their names after the output has got its own; if anything fails before, none of them appears.

    Parameters
    ----------
    sink : FrameSink
        Sink of the frames, which this one enters and leaves.
    confidence : ConfidenceWriter or None
        Writer of maps of confidence; with it, the sink asks for the confidence of frames.
    motion : MotionWriter or None
        Writer of motion; with it, the sink asks for the motion between frames of the source.
    watcher : FrameWatcher, optional
        Watcher that sees every frame before the sink.
    """

    def __init__(
        self,
        sink: FrameSink,
        confidence: ConfidenceWriter | None,
        motion: MotionWriter | None,
        watcher: FrameWatcher | None = None,
    ) -> None:
        self._sink = sink
        self.holds_last_frame = sink.holds_last_frame
        self._watcher = watcher
        self.needs_confidence = confidence is not None or (watcher is not None and watcher.needs_confidence)
        self.needs_motion = motion is not None
        self._writers = [writer for writer in (confidence, motion) if writer is not None]

    @property
    def remarks(self) -> list[str]:
        """Remarks of the sink and of the writers."""
        return [*self._sink.remarks, *(remark for writer in self._writers for remark in writer.remarks)]

    @property
    def details(self) -> str:
        """Details of the sink; empty if it has none."""
        return str(getattr(self._sink, "details", ""))

    def cancel(self) -> None:
        """Let the sink stop waiting, if it can wait."""
        if isinstance(self._sink, Cancellable):
            self._sink.cancel()

    def write(self, frame: Frame) -> None:
        """Write the side outputs of the next frame, show it to the watcher, and pass it on, in this order."""
        for writer in self._writers:
            writer.write(frame)
        if self._watcher is not None:
            self._watcher.watch(frame)
        self._sink.write(frame)

    def __enter__(self) -> Self:
        """Take the writers' hidden folders, then enter the sink; release the folders if that fails."""
        with ExitStack() as opened:
            for writer in self._writers:
                opened.callback(writer.files.close)
                writer.files.open()
            self._sink.__enter__()
            self._closing = opened.pop_all()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """Finish the side outputs, leave the sink, and then give the side outputs their names.

        After an exception, also one while finishing, the sink is left with it and the side outputs are removed.
        """
        with self._closing:
            try:
                if kind is None:
                    for writer in self._writers:
                        writer.finish()
                        writer.files.check()  # once more: the output gets its name next
            except BaseException as failure:
                self._sink.__exit__(type(failure), failure, failure.__traceback__)
                raise
            self._sink.__exit__(kind, error, trace)
            if kind is None:
                for writer in self._writers:
                    writer.publish()


def with_side_outputs(
    sink: FrameSink,
    side: SideOutputs,
    images: NumberedImages | None,
    *,
    overwrite: bool,
    watcher: FrameWatcher | None = None,
) -> FrameSink:
    """Return a sink that also writes side outputs, and shows frames; the same sink if neither is asked for.

    `images` are those of the source, which lend their names to files of motion. Raises `OptionError` for a path that
    names neither a folder of its own nor a pattern of a type that can be written.
    """
    if side == SideOutputs() and watcher is None:
        return sink
    taken = [images.files[0].parent] if images else []
    confidence = motion = None
    naming = None
    numbers = range(1, sys.maxsize)
    if isinstance(sink, ImageSink):
        naming = sink.names.numbering
        numbers = range(sink.names.first, sys.maxsize, sink.names.step)
        taken.append(naming.folder)
    if side.confidence is not None:
        confidence = ConfidenceWriter(str(side.confidence), naming, numbers, taken, overwrite=overwrite)
        taken.append(confidence.folder)
    if side.save_motion is not None:
        places: Sequence[int] = images.numbers if images and images.numbers else range(1, sys.maxsize)
        naming = images.numbering if images else None
        motion = MotionWriter(str(side.save_motion), naming, places, taken, overwrite=overwrite)
    return SideSink(sink, confidence, motion, watcher)


class SideWriter:
    """Base of writers of files about the frames of a conversion.

    The files go into a folder, where they are named by `naming` and have the first type of `endings`, or get the names
    and the type of a pattern. They appear when `files` are published; until then they are in a hidden folder.

    Parameters
    ----------
    path : str
        Folder or pattern, as the user has given it.
    naming : Numbering or None
        Naming of the images whose names the files get in a folder; None to count with six digits.
    numbers : sequence of int
        Numbers of the frames, in order.
    taken : iterable of Path
        Folders in which frames are read or other files are written.
    overwrite : bool
        Replace existing files.

    Attributes
    ----------
    folder : Path
        Final folder of the files.

    Raises
    ------
    OptionError
        The path names neither a folder nor a pattern of a type that is written, or its folder is among those taken.
    OutputError
        The folder cannot be written, or has files that only `overwrite` would replace.
    """

    option: str
    """Option that asks for the files, in messages."""
    endings: ClassVar[Mapping[str, Sequence[str]]]
    """Ends of the names that are written, by the type of file; all files with any of them are replaced."""

    def __init__(
        self, path: str, naming: Numbering | None, numbers: Sequence[int], taken: Iterable[Path], *, overwrite: bool
    ) -> None:
        self.path = path
        self.remarks = Remarks()
        self._numbers = numbers
        self._suffix, naming = self._parse(path, naming)
        self.folder = naming.folder
        if os.path.realpath(self.folder) in map(os.path.realpath, taken):
            raise OptionError(
                f"{self.option} needs a folder of its own, and {self.folder} holds other images; name another."
            )
        self._naming = replace(naming, suffix=naming.suffix.rpartition(".")[0])
        names = [replace(self._naming, suffix=self._naming.suffix + ending) for ending in self.endings[self._suffix]]
        self.files = StagedFiles(path, names, "fpsboost-side", overwrite=overwrite, alone=not is_pattern(path))
        self.files.check()

    def _parse(self, path: str, naming: Numbering | None) -> tuple[str, Numbering]:
        """Return the type of file and the naming for a path; raise `OptionError` if it is no folder or pattern."""
        suffixes = list(self.endings)
        extension = extension_of(path)
        if is_pattern(path):
            if extension not in suffixes:
                raise OptionError(
                    f"{self.option} writes {' or '.join(suffixes)}, not {path}; name a folder, or a pattern such as "
                    "map_####.exr."
                )
            return extension, Numbering.parse(path)
        if not path or (extension in {*suffixes, *IMAGE_SUFFIXES} and not Path(path).is_dir()):
            raise OptionError(
                f"{self.option} needs a folder, or a pattern such as map_####{suffixes[0]}, not {path or 'nothing'}."
            )
        return suffixes[0], replace(naming or Numbering(Path(), "", VIDEO_DIGITS, suffixes[0]), folder=Path(path))

    def _stem(self, place: int) -> str:
        """Return the name of the file of a frame, by its place, without the type."""
        return self._naming.path(self._numbers[place]).name

    def write(self, frame: Frame) -> None:
        """Write the files about the next frame of the output, if there are any."""
        raise NotImplementedError

    def _write_file(self, name: str, data: bytes) -> None:
        """Write a file by its final name, in any order; it appears when `publish` is called."""
        with explained(OutputError, "write", self.folder / name, ADVICE):
            write_safely(self.files.staged / name, data)

    def finish(self) -> None:
        """Write files that waited for the next frame; called once, after the last."""

    def publish(self) -> None:
        """Give all files their names; without any, there is only a remark."""
        self.remarks.take(self.files.remarks)
        if not os.listdir(self.files.staged):
            self.remarks.add("no-side-frames", name=self.path)
        self.files.publish_files()


class ConfidenceWriter(SideWriter):
    """Writer of a map of confidence for every frame that has one, named by the frame's place in the output.

    Maps are PNG, with 255 for certain, or half OpenEXR, with 1.
    """

    option = "`confidence`"
    endings: ClassVar = {PICTURE: [PICTURE], EXR: [EXR]}
    _place = 0

    def write(self, frame: Frame) -> None:
        """Write the map of the next frame; a frame without one is only counted."""
        place = self._place
        self._place = self._place + 1
        if frame.confidence is None:
            return
        values = frame.confidence[..., np.newaxis]
        if self._suffix == PICTURE:
            values = np.rint(values.clip(0, 1) * 255).astype(np.uint8)
        path = Path(self._stem(place) + self._suffix)
        self._write_file(path.name, encode_image(path, values))


class MotionWriter(SideWriter):
    """Writer of the motion of source frames to the previous and to the next one, and of pictures of it.

    Files are ``.flo``, or OpenEXR in Blender's convention, and are named by the place of the frame in the source. If
    frames are interpolated on one side of a frame alone (at both ends of a clip and of a scene), its motion is
    extrapolated to the other side, because readers ask for both.
    """

    option = "`save_motion`"
    endings: ClassVar = {FLO: [BACKWARD, FORWARD, *FLOW_PICTURES], EXR: [EXR, *FLOW_PICTURES]}
    _last: PairMotion | None = None
    _first: PairMotion | None = None
    _is_still: bool | None = None

    def write(self, frame: Frame) -> None:
        """Write the motion of the first frame of the pair whose motion the frame carries, if it carries any."""
        motion = frame.motion
        if motion is None:
            return
        if self._last is not None and self._last.number1 == motion.number0:
            self._write_vectors(motion.number0, self._last.flow10, motion.flow01)
        else:
            self.finish()
            self._write_vectors(motion.number0, -motion.flow01, motion.flow01)
        self._first = self._first or motion
        self._last = motion
        self._is_still = self._is_still is not False and not motion.flow01.any() and not motion.flow10.any()

    def finish(self) -> None:
        """Write the motion of the last frame of a scene, extrapolated to the frame after it.

        Of a loop, that is the first frame once more, whose motion is known on both sides now.
        """
        if self._last is not None and self._first is not None:
            self._write_vectors(
                self._last.number1,
                self._last.flow10,
                self._first.flow01 if self._last.number1 == self._first.number0 else -self._last.flow10,
            )
            self._last = None

    def publish(self) -> None:
        super().publish()
        if self._is_still:
            self.remarks.add("no-motion", name=self.path)

    def _write_vectors(self, place: int, backward: np.ndarray, forward: np.ndarray) -> None:
        """Write the vectors of a source frame, pixels to the frames before and after it, and their pictures."""
        stem = self._stem(place)
        if self._suffix == EXR:
            x, y = np.moveaxis(backward, -1, 0)
            z, w = np.moveaxis(forward, -1, 0)
            # Blender: the place in the previous frame minus that here, that here minus that in the next, y up
            self._write_file(stem + EXR, encode_exr({"X": x, "Y": -y, "Z": -z, "W": w}, half=False))
        for ending, picture, flow in zip((BACKWARD, FORWARD), FLOW_PICTURES, (backward, forward), strict=True):
            if self._suffix == FLO:
                self._write_file(stem + ending, encode_flow(flow))
            self._write_file(stem + picture, encode_image(Path(picture), flow_picture(flow)))
