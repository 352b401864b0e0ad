"""Numbered images written one at a time, all of them or none; and a part of them, to be joined with others later."""

from __future__ import annotations

import errno
import json
import os
import shutil
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import replace
from fractions import Fraction
from pathlib import Path
from types import TracebackType
from typing import Self

from fpsboost.errors import CompleteAlreadyError, OptionError, OutputError, explained
from fpsboost.frame import ClipInfo, Frame
from fpsboost.io.images.encoder import ImageEncoder, check_size
from fpsboost.io.images.files import IMAGE_SUFFIXES, extension_of
from fpsboost.io.images.sequence import NumberedImages, Numbering
from fpsboost.io.images.source import MOVING, is_pattern
from fpsboost.io.output import Output
from fpsboost.io.part import PartFolder
from fpsboost.io.staging import IN_EXISTING_FOLDER, StagingDirectory, hidden_place, move_all, sync, write_safely

VIDEO_DIGITS = 6  # where the source has no numbers: 999999 frames are more than four hours at 60 per second


class ImageSink:
    """Write numbered images, all of them or none.

    They grow in a hidden folder beside their final place. A new folder gets its name by one renaming; into an existing
    one the images are moved at the end, and moved back should that fail. A later run can go on with images that are
    there when this one is stopped, and with moving them.

    The output's path is a folder, made if it is not there, or a pattern in an existing folder. In a folder the naming
    of an image source is continued; frames of a video become ``000001.png``. Where the factor divides the step of the
    source's numbers, the images keep those, with their padding, and the others get the numbers between. JPEG is written
    with quality 95, everything else without loss: OpenEXR as half where the source is, else as float. With `overwrite`,
    images of the same naming are replaced, later ones too, and anything else in the folder stays.
    """

    holds_last_frame = False

    def __init__(self, output: Output) -> None:
        path, images, factor, frame_count = output.path, output.stream.images, output.factor, output.expected_frames
        self._path, self._job, self._frame_count = path, output.job, frame_count
        self._overwrite, self._in_place = output.overwrite, output.in_place
        self._first, self._step, is_anew, self._remarks = _numbers_of(output)
        self._next = self._first
        self._originals = {file.name for file in images.files} if images is not None and output.in_place else set[str]()
        self._encoder = ImageEncoder(path, images, anew=is_anew)
        self._names: list[str] = []
        self._frames = self._frames_there = 0
        with explained(OutputError, "write to", path, "check the path and the permissions"):
            self._is_folder = Path(path).is_dir() or not is_pattern(path)
            if output.in_place:
                self._numbering = self._numbering_in_place(images, factor)
            else:
                self._numbering = _numbering_of(output)
                if not self._is_folder:
                    self._remark_on_digits(frame_count)
            self._check_place(output.info)
            if images is not None and not output.in_place:
                self._refuse_inputs(images)
            folder = self._numbering.folder
            # Inside an existing folder rather than beside it: the folder may be a mount point, the parent read-only.
            self._is_new = not folder.is_dir()
            if output.in_place or not (self._is_new or self._is_folder):
                called = self._numbering.pattern
            else:
                called = folder.name if self._is_new else IN_EXISTING_FOLDER
            place = hidden_place(folder.parent if self._is_new else folder, called)
            self._unfinished = StagingDirectory(place, "output", path, output.job)
            self._replaced = place / "replaced"
            self._moving = place / MOVING
            self._refuse_existing()

    @property
    def numbering(self) -> Numbering:
        """How the images are named."""
        return self._numbering

    @property
    def numbers(self) -> tuple[int, int]:
        """Number of the first image, and by how much the numbers rise."""
        return self._first, self._step

    @property
    def remarks(self) -> list[str]:
        """Sentences about what the files could not hold."""
        return [*self._unfinished.remarks, *self._remarks, *self._encoder.remarks]

    @property
    def completed_frames(self) -> int:
        """How many images an earlier run has finished; see `fpsboost.io.Resumable`."""
        return self._frames_there

    def _numbering_in_place(self, images: NumberedImages | None, factor: Fraction | None) -> Numbering:
        """Return the source's own numbering if it has numbers for the frames between."""
        if images is None or images.numbering is None or factor is None:
            raise OptionError(f"`in_place` needs images with numbers in their names, and {self._path} has none.")
        has_room = images.step > 1 or images.numbers[-1] - images.numbers[0] >= len(images.numbers)
        if not has_room:
            if self._job is not None and self._job.resume:
                raise CompleteAlreadyError(f"No image is missing from {self._path}, so it was left as it is.")
            raise OutputError(
                f"No image is missing from {self._path}: there are no numbers for frames between; leave `in_place` out "
                "and name another folder."
            )
        fits = factor == 1 if images.fills_gaps else factor > 1 and images.numbers_for(factor) is not None
        if not fits:
            way = "leave `factor` out" if images.fills_gaps else f"give `factor={images.step}`, or `fill_gaps`"
            raise OptionError(
                f"{factor} times the frames of {self._path} do not fit between its numbers, which `in_place` keeps; "
                f"{way}."
            )
        return images.numbering

    def _remark_on_digits(self, frame_count: int | None) -> None:
        digits = self._numbering.digits
        if frame_count is not None and 1 < digits < len(str(self._next + (frame_count - 1) * self._step)):
            self._remarks.append(f"{self._path} has too few digits for {frame_count} frames: later names grow longer.")

    def _check_place(self, info: ClipInfo) -> None:
        folder = self._numbering.folder
        _check_type(self._path, self._numbering, info)
        if folder.exists() and not folder.is_dir():
            raise OutputError(f"{folder} is a file; name a folder, or a pattern in one.")
        needed = folder.parent if self._is_folder else folder
        if not needed.is_dir():
            raise OutputError(f"The folder {needed} does not exist; create it first.")

    def _refuse_inputs(self, images: NumberedImages) -> None:
        """Raise `OutputError` if the output would overwrite an input, also via links or case."""
        folder = self._numbering.folder
        if not folder.is_dir():
            return
        clash = None
        if folder.samefile(images.files[0].parent):
            if self._is_folder:
                raise OutputError(f"{self._path} is also the input; write to another folder.")
            folded = replace(
                self._numbering, prefix=self._numbering.prefix.casefold(), suffix=self._numbering.suffix.casefold()
            )
            clash = next((file for file in images.files if folded.number_in(file.name.casefold()) is not None), None)
        old = {path.resolve() for path in self._find_old()}
        if old and clash is None:
            clash = next((file for file in images.files if file.resolve() in old), None)
        if clash is not None:
            raise OutputError(f"{self._path} would replace the input {clash}; write to another folder or pattern.")

    def _find_old(self) -> list[Path]:
        # In a folder the digits are this program's choice, so frames of an earlier run may have fewer or more.
        if not self._numbering.folder.is_dir():
            return []
        return [path for _, path in self._numbering.find(any_padding=self._is_folder)]

    def _refuse_existing(self) -> None:
        folder = self._numbering.folder
        is_moving = self._unfinished.goes_on and self._moving.exists()
        if self._in_place:
            if self._moving.exists() and not is_moving:
                raise OutputError(
                    f"A run in {self._path} was stopped while its frames got their names; `resume` goes on with that."
                )
            for name in self._names:
                if (self._unfinished.staged / name).exists() and (folder / name).exists():
                    raise OutputError(f"{folder / name} has appeared meanwhile; move it away, and use `resume`.")
            return
        if self._overwrite or not folder.is_dir() or is_moving:
            return
        old = self._find_old()
        is_full = self._is_folder and any(not name.startswith(".") for name in os.listdir(folder))
        if not old and not is_full:
            return
        if self._job is not None and self._job.resume and not self._unfinished.is_pending:
            raise CompleteAlreadyError(
                f"{self._path} exists already and no run of it is unfinished, so it was left as it is."
            )
        if is_full:
            raise OutputError(
                f"{folder} is not empty; add `overwrite=True` to replace the frames in it, or name another."
            )
        raise OutputError(f"{old[0]} exists; add `overwrite=True` to replace such images, or choose another pattern.")

    def __enter__(self) -> Self:
        with explained(OutputError, "write to", self._path, "check the free space and the permissions"):
            self._refuse_set_aside()
            self._unfinished.open()
            try:
                self._unfinished.staged.mkdir(exist_ok=True)
                self._frames_there = self._count_finished()
            except BaseException:
                self._unfinished.close(keep=True)
                raise
        return self

    def _refuse_set_aside(self) -> None:
        """Raise `OutputError` if a stopped run left replaced frames that were not restored."""
        if not self._unfinished.goes_on and self._replaced.is_dir() and os.listdir(self._replaced):
            raise OutputError(
                f"{self._replaced} holds frames that a run had set aside to replace them; let that run finish with "
                "`resume`, or move them to where they belong."
            )

    def _count_finished(self) -> int:
        """Return frames that an earlier run has finished, from the first up to the first that is missing."""
        if self._moving.exists():
            return int(json.loads(self._moving.read_bytes())["frames"])
        staged = set(os.listdir(self._unfinished.staged))
        there = staged | self._originals if staged else staged
        count = 0
        while self._numbering.path(self._next + count * self._step).name in there:
            count += 1
        return count

    def write(self, frame: Frame) -> None:
        """Write the next image; its time does not matter."""
        path = self._numbering.path(self._next)
        self._next += self._step
        self._frames += 1
        if path.name in self._originals:  # in place: stays as it is
            self._encoder.passes_in_place(path, frame.array)
            return
        self._encoder.check(path, frame.array)
        if self._frames > self._frames_there:
            data = self._encoder.content(path, frame)
            with explained(OutputError, "write", path, "check the free space and the permissions"):
                write_safely(self._unfinished.staged / path.name, data)
        self._names.append(path.name)

    def join(self, files: Sequence[Path]) -> None:
        """Take image files that were written elsewhere, in order, instead of frames; they stay where they are."""
        with explained(OutputError, "write to", self._path, "check the free space and the permissions"):
            for file in files:
                path = self._numbering.path(self._next)
                if file.name != path.name:
                    raise OutputError(
                        f"{self._path} would name an image {path.name} that is called {file.name} in its part; name "
                        "the output as then."
                    )
                _link_or_copy(file, self._unfinished.staged / path.name)
                self._next += self._step
                self._frames += 1
                self._names.append(path.name)

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        try:
            if kind is None and self._names:
                with explained(OutputError, "write to", self._path, "check the free space and the permissions"):
                    self._finish()
        except BaseException as failure:
            self._leave(failure)
            raise
        self._leave(error)

    def _finish(self) -> None:
        self._refuse_existing()  # once more: hours may have passed
        folder, staged = self._numbering.folder, self._unfinished.staged
        for extra in set(os.listdir(staged)) - set(self._names):  # torn images
            (staged / extra).unlink()
        if self._is_new and not folder.exists():
            self._unfinished.publish(folder)
            return
        self._replaced.mkdir(exist_ok=True)
        moves = [(staged / name, folder / name) for name in self._names if (staged / name).exists()]
        is_begun = len(moves) < len(self._names)  # an earlier run has moved some, and the old ones before them
        if not is_begun and not self._in_place:
            moves = [(path, self._replaced / path.name) for path in self._find_old()] + moves
        write_safely(self._moving, json.dumps({"frames": self._frames, "names": self._names}).encode())
        try:
            if self._in_place:
                move_all(moves, _move_new)
            else:
                move_all(moves)
        except BaseException:
            if all((staged / name).exists() for name in self._names):
                self._moving.unlink()
            raise
        sync(folder)
        shutil.rmtree(self._replaced, ignore_errors=True)

    def _leave(self, error: BaseException | None) -> None:
        """Remove the hidden folder, unless it holds resumable frames or originals not restored."""
        with suppress(OSError):
            self._replaced.rmdir()  # fails where it is not empty
        count = self._frames if self._moving.exists() else max(self._frames_there, self._frames if self._names else 0)
        self._unfinished.leave(error, count, self._frame_count, stays=self._replaced.exists())


class ImagePartSink:
    """Sink for a part: its images appear with their final names in a folder once they are complete."""

    holds_last_frame = False

    def __init__(self, output: Output) -> None:
        assert output.part is not None
        self._numbering = _numbering_of(output)
        first, self._step, is_anew, self._remarks = _numbers_of(output)
        self._next = first + output.part.first * self._step
        _check_type(output.path, self._numbering, output.info)
        self._folder = PartFolder(output)
        self._encoder = ImageEncoder(output.path, output.stream.images, anew=is_anew)
        self._names: list[str] = []
        self._frames_there = 0

    @property
    def remarks(self) -> list[str]:
        return [*self._folder.remarks, *self._remarks, *self._encoder.remarks]

    @property
    def completed_frames(self) -> int:
        """Number of images that an earlier run has finished; see `fpsboost.io.Resumable`."""
        return self._frames_there

    def __enter__(self) -> Self:
        with explained(OutputError, "write to", self._folder.name, "check the free space and the permissions"):
            self._folder.open()
            while self._numbering.path(self._next + self._frames_there * self._step).name in os.listdir(
                self._folder.files
            ):
                self._frames_there += 1
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        try:
            if kind is None:
                with explained(OutputError, "write to", self._folder.name, "check the free space and the permissions"):
                    for extra in set(os.listdir(self._folder.files)) - set(self._names):  # torn images
                        (self._folder.files / extra).unlink()
                    self._folder.publish()
        except BaseException as failure:
            self._folder.leave(failure, len(self._names))
            raise
        self._folder.leave(error, max(self._frames_there, len(self._names)))

    def write(self, frame: Frame) -> None:
        """Write the next image; its time does not matter."""
        path = self._numbering.path(self._next)
        self._next += self._step
        self._encoder.check(path, frame.array)
        if len(self._names) >= self._frames_there:
            data = self._encoder.content(path, frame)
            with explained(OutputError, "write", self._folder.name, "check the free space and the permissions"):
                write_safely(self._folder.files / path.name, data)
        self._names.append(path.name)


def _numbers_of(output: Output) -> tuple[int, int, bool, list[str]]:
    """Return the first number, the step, whether images are numbered otherwise than the source's, and remarks on it."""
    images, factor = output.stream.images, output.factor
    kept = None if images is None or factor is None else images.numbers_for(factor)
    first, step = kept or (1 if images is None else images.first_number, 1)
    remarks = []
    if images is not None and images.step > 1 and kept is None and factor is not None:
        remarks.append(
            f"{factor} times the frames do not fit between numbers that rise by {images.step}: all were numbered anew, "
            f"one by one; `factor={images.step}` makes just those that are missing."
        )
    return first, step, kept is None, remarks


def _check_type(name: str, numbering: Numbering, info: ClipInfo) -> None:
    """Raise `OutputError` unless the names are those of images that can be written, in this size."""
    extension = extension_of(numbering.path(1).name)
    if extension not in IMAGE_SUFFIXES:
        raise OutputError(f"{name} names no type of image that can be written; use one of {', '.join(IMAGE_SUFFIXES)}.")
    check_size(name, extension, info)


def _numbering_of(output: Output) -> Numbering:
    """Return how the images of an output are named, which are not written in place."""
    path, images = output.path, output.stream.images
    if is_pattern(path) and not Path(path).is_dir():
        return Numbering.parse(path)
    folder, frame_count = Path(path), output.expected_frames
    *_, is_anew, _ = _numbers_of(output)
    # as many digits as keep the order of names the order of frames
    first = 1 if images is None else images.first_number
    digits = VIDEO_DIGITS if frame_count is None else len(str(first + frame_count - 1))
    if images is None or images.numbering is None:
        return Numbering(folder, "", max(digits, VIDEO_DIGITS), ".png" if images is None else images.files[0].suffix)
    kept = images.numbering.digits
    return replace(images.numbering, folder=folder, digits=max(digits, kept) if is_anew else kept)


def _link_or_copy(here: Path, there: Path) -> None:
    """Give a file a second name, or copy it where that is another disk or the disk knows no links."""
    try:
        os.link(here, there)
    except OSError:
        shutil.copy2(here, there)


def _move_new(here: Path, there: Path) -> None:
    """Move a file to a name that nothing has, also where capital letters make no difference."""
    if there.exists():
        raise FileExistsError(errno.EEXIST, os.strerror(errno.EEXIST), str(there))
    os.rename(here, there)
