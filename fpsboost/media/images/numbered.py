"""Numbered images in a folder, read and written one at a time."""

from __future__ import annotations

import json
import os
import shutil
from collections.abc import Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from fractions import Fraction
from pathlib import Path
from types import TracebackType
from typing import Self

from fpsboost.errors import CompleteAlreadyError, InputError, OptionError, OutputError, explained
from fpsboost.frame import ClipInfo, Frame, Image, describe
from fpsboost.media import Closing
from fpsboost.media.images.files import (
    IMAGE_SUFFIXES,
    check_format,
    check_size,
    encode_image,
    extension_of,
    losses,
    needs_float,
    read_image,
    unread_channels,
)
from fpsboost.media.images.metadata import (
    ImageMetadata,
    can_pass,
    content_of,
    lost_metadata,
    read_metadata,
    upright,
    with_metadata,
)
from fpsboost.media.images.numbering import is_pattern, scan_folder
from fpsboost.media.unfinished import Job, Unfinished, hidden_place, sync, write_safely
from fpsboost.memory_limit import MemoryLimit
from fpsboost.sequence import Numbering, find_without_gap

VIDEO_DIGITS = 6  # where the source has no numbers: 999999 frames are more than four hours at 60 per second


@dataclass(frozen=True)
class ImageFile:
    """The file that a frame was read from: its `Frame.original`."""

    path: Path


class ImageSource(Closing):
    """Read a folder or a pattern of images, one at a time.

    Parameters
    ----------
    path : str
        A folder that holds one sequence, or a pattern. In a folder, files that are no images and hidden files are
        ignored.
    rate : Fraction
        Frames per second; images do not say.
    limit : MemoryLimit, optional
        What may be taken; what is available without it.
    upright : bool
        Turn images as their EXIF orientation says, for targets that cannot say it; frames then have no original.

    Attributes
    ----------
    files : list of Path
        The images in order.
    numbering : Numbering or None
        How they are named; None where the names have no numbers.
    skipped : int
        Files before these that are not read.
    first_number : int
        Number of the first image; 1 where there are none.
    suffix : str
        The type of the files as they write it, ``.png``.
    needs_float : bool
        Whether OpenEXR's half would lose some of their precision.

    Raises
    ------
    OptionError
        The rate is not above 0.
    InputError
        No images, several sequences, a gap, or an unreadable first image; while iterating, an unreadable image or one
        that differs from the first in size or type.
    """

    def __init__(self, path: str, rate: Fraction, *, upright: bool = False, limit: MemoryLimit | None = None) -> None:
        if rate <= 0:
            raise OptionError(f"The frame rate of images must be above 0, not {rate}.")
        place = Path(path)
        self.numbering: Numbering | None
        with explained(InputError, "read", path, "check that it exists and that you may read it"):
            if place.is_dir():
                self.files, self.numbering = scan_folder(place)
            elif is_pattern(path):
                self.numbering = Numbering.parse(path)
                self.files = find_without_gap(self.numbering)
            elif place.exists():
                raise InputError(f"{path} is a single file; give a folder of images or a pattern like shot_####.png.")
            else:
                raise InputError(f"{path} does not exist; check the path.")
        self.skipped = 0
        self.suffix = self.files[0].suffix
        if self.suffix.lower() not in IMAGE_SUFFIXES:
            raise InputError(f"{path} is no type of image that can be read; use one of {', '.join(IMAGE_SUFFIXES)}.")
        number = None if self.numbering is None else self.numbering.number_in(self.files[0].name)
        self.first_number = 1 if number is None else number
        self._upright, self._limit = upright, limit or MemoryLimit()
        first = self._read(self.files[0])
        self.needs_float = needs_float(self.files[0], first)
        self._unread = unread_channels(self.files[0])
        height, width, _ = first.shape
        self.info = ClipInfo(path, height, width, rate, 1 / rate, len(self.files))

    @property
    def remarks(self) -> list[str]:
        """What is not read; what is wrong with images is an error."""
        names = self._unread
        if not names:
            return []
        listed = ", ".join(names[:4]) + (f" and {len(names) - 4} more" if len(names) > 4 else "")
        return [f"{self.files[0].name} and its like hold other channels ({listed}), which were left out."]

    def __iter__(self) -> Iterator[Frame]:
        first = None
        for index, path in enumerate(self.files):
            image = self._read(path)
            if first is None:
                first = image
            if image.shape != first.shape or image.dtype != first.dtype:
                raise InputError(
                    f"{path} ({describe(image)}) is unlike {self.files[0]} ({describe(first)}); "
                    "make all images one size and type."
                )
            original = None if self._upright else ImageFile(path)
            yield Frame(image, index / self.info.rate, 1 / self.info.rate, original)

    def _read(self, path: Path) -> Image:
        image = read_image(path, self._limit)
        return upright(image, read_metadata(path).orientation) if self._upright else image

    def keep(self, first: int, last: int | None) -> None:
        """Read only the files from one place to before another.

        Raises
        ------
        InputError
            There are none.
        """
        count = len(self.files)
        self.files, self.skipped = self.files[first:last], first
        if not self.files:
            raise InputError(f"{self.info.name} has {count} images and ends before --start; name an earlier one.")
        self.info = replace(self.info, frame_count=len(self.files))

    def close(self) -> None:
        """Do nothing: no file stays open."""


class ImageSink:
    """Write numbered images, all of them or none.

    They grow in a hidden folder beside their final place. A new folder gets its name by one renaming; into an existing
    one the images are moved at the end, and moved back should that fail. A later run can go on with images that are
    there when this one is stopped, and with moving them.

    Parameters
    ----------
    path : str
        A folder, made if it is not there, or a pattern in an existing folder. In a folder the naming of an image source
        is continued; frames of a video become ``000001.png``. JPEG is written with quality 95, everything else without
        loss: OpenEXR as half where the source is, else as float.
    info : ClipInfo
        The size of the images.
    source : ImageSource or None
        Where the frames come from, if that is images: gives the first number and, in a folder, the naming.
    frame_count : int or None
        Expected number of frames; decides the digits in a folder.
    overwrite : bool
        Replace images of the same naming, later ones too. Anything else in the folder stays.
    job : Job, optional
        What a later run must have in common with this one to go on with it; without one, nothing can be resumed.

    Raises
    ------
    OutputError
        The target exists (without `overwrite`), is the source, is being written by another run, or cannot hold or
        receive the images.
    """

    holds_last_frame = False

    def __init__(
        self,
        path: str,
        info: ClipInfo,
        source: ImageSource | None,
        frame_count: int | None,
        *,
        overwrite: bool,
        job: Job | None = None,
    ) -> None:
        self._path, self._job, self._frame_count = path, job, frame_count
        self._overwrite = overwrite
        self._half = source is None or not source.needs_float
        self._next = 1 if source is None else source.first_number
        self._metadata = None if source is None else read_metadata(source.files[0])
        self._names: list[str] = []
        self._frames_there = 0
        self._remarks: list[str] = []
        with explained(OutputError, "write to", path, "check the path and the permissions"):
            self._is_folder = Path(path).is_dir() or not is_pattern(path)
            if self._is_folder:
                self._numbering = _name_in_folder(Path(path), source, frame_count)
            else:
                self._numbering = Numbering.parse(path)
                self._remark_on_digits(frame_count)
            self._check_place(info)
            if source is not None:
                self._refuse_inputs(source)
            folder = self._numbering.folder
            # Inside an existing folder rather than beside it: the folder may be a mount point, the parent read-only.
            self._is_new = not folder.is_dir()
            called = folder.name if self._is_new else "fpsboost" if self._is_folder else self._numbering.pattern
            place = hidden_place(folder.parent if self._is_new else folder, called)
            self._unfinished = Unfinished(place, "output", path, job)
            self._replaced = place / "replaced"
            self._moving = place / "moving.json"
            self._refuse_existing()

    @property
    def numbering(self) -> Numbering:
        """How the images are named."""
        return self._numbering

    @property
    def remarks(self) -> list[str]:
        """Sentences about what the files could not hold."""
        return [*self._unfinished.remarks, *self._remarks]

    @property
    def frames_there(self) -> int:
        """How many images an earlier run has finished; see `fpsboost.media.Resuming`."""
        return self._frames_there

    def _remark_on_digits(self, frame_count: int | None) -> None:
        digits = self._numbering.digits
        if frame_count is not None and 1 < digits < len(str(self._next + frame_count - 1)):
            self._remarks.append(f"{self._path} has too few digits for {frame_count} frames: later names grow longer.")

    def _check_place(self, info: ClipInfo) -> None:
        folder, extension = self._numbering.folder, extension_of(self._numbering.path(1).name)
        if extension not in IMAGE_SUFFIXES:
            raise OutputError(
                f"{self._path} names no type of image that can be written; use one of {', '.join(IMAGE_SUFFIXES)}."
            )
        check_size(self._path, extension, info)
        if folder.exists() and not folder.is_dir():
            raise OutputError(f"{folder} is a file; name a folder, or a pattern in one.")
        needed = folder.parent if self._is_folder else folder
        if not needed.is_dir():
            raise OutputError(f"The folder {needed} does not exist; create it first.")

    def _refuse_inputs(self, source: ImageSource) -> None:
        """Never touch what is being read, also through links and where names ignore case."""
        folder = self._numbering.folder
        if not folder.is_dir():
            return
        clash = None
        if folder.samefile(source.files[0].parent):
            if self._is_folder:
                raise OutputError(f"{self._path} is also the input; write to another folder.")
            folded = replace(
                self._numbering, prefix=self._numbering.prefix.casefold(), suffix=self._numbering.suffix.casefold()
            )
            clash = next((file for file in source.files if folded.number_in(file.name.casefold()) is not None), None)
        old = {path.resolve() for path in self._find_old()}
        if old and clash is None:
            clash = next((file for file in source.files if file.resolve() in old), None)
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
            raise OutputError(f"{folder} is not empty; add --overwrite to replace the frames in it, or name another.")
        raise OutputError(f"{old[0]} exists; add --overwrite to replace such images, or choose another pattern.")

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
        """Never remove frames of before that a run was about to replace, and that it could not put back."""
        if not self._unfinished.goes_on and self._replaced.is_dir() and os.listdir(self._replaced):
            raise OutputError(
                f"{self._replaced} holds frames that a run had set aside to replace them; let that run finish with "
                "--resume, or move them to where they belong."
            )

    def _count_finished(self) -> int:
        """Images of an earlier run, from the first up to the first that is missing."""
        if self._moving.exists():
            return int(json.loads(self._moving.read_bytes()))
        there = set(os.listdir(self._unfinished.staged))
        count = 0
        while self._numbering.path(self._next + count).name in there:
            count += 1
        return count

    def write(self, frame: Frame) -> None:
        """Write the next image; its time does not matter."""
        path = self._numbering.path(self._next)
        check_format(path, frame.image)
        self._remarks += [remark for remark in losses(path, frame.image) if remark not in self._remarks]
        if len(self._names) >= self._frames_there:
            data = self._content(path, frame)
            with explained(OutputError, "write", path, "check the free space and the permissions"):
                write_safely(self._unfinished.staged / path.name, data)
        self._names.append(path.name)
        self._next += 1

    def _content(self, path: Path, frame: Frame) -> bytes:
        """A frame that passes into a file of its own type as that file, to the byte; others with what it says."""
        if isinstance(frame.original, ImageFile):
            source = frame.original.path
            self._metadata = read_metadata(source)
            is_same = _one_name(extension_of(source.name)) == _one_name(extension_of(path.name))
            if is_same and can_pass(source) and not unread_channels(source):
                return content_of(source)
        metadata, extension = self._metadata or ImageMetadata(), extension_of(path.name)
        for lost in lost_metadata(extension, metadata, frame.image.shape[2]):
            remark = f"{self._path} cannot hold the {lost} of its source; left out."
            self._remarks += [remark] * (remark not in self._remarks)
        data = encode_image(path, frame.image, half=self._half, attributes=metadata.attributes)
        return with_metadata(extension, data, metadata, frame.image.shape[2])

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
        if len(moves) == len(self._names):  # else an earlier run has moved some, and the old ones before them
            moves = [(path, self._replaced / path.name) for path in self._find_old()] + moves
        write_safely(self._moving, json.dumps(len(self._names)).encode())
        try:
            _move_all(moves)
        except BaseException:
            if all((staged / name).exists() for name in self._names):
                self._moving.unlink()
            raise
        sync(folder)
        shutil.rmtree(self._replaced, ignore_errors=True)

    def _leave(self, error: BaseException | None) -> None:
        """Remove the hidden folder, but for images to go on with, and earlier ones that could not be moved back."""
        with suppress(OSError):
            self._replaced.rmdir()  # fails where it is not empty
        count = len(self._names) if self._moving.exists() else max(self._frames_there, len(self._names))
        self._unfinished.leave(error, count, self._frame_count, stays=self._replaced.exists())


def _one_name(extension: str) -> str:
    """The shorter of two names that stand for one type of file."""
    return {".jpeg": ".jpg", ".tiff": ".tif"}.get(extension, extension)


def _name_in_folder(folder: Path, source: ImageSource | None, frame_count: int | None) -> Numbering:
    """Continue the source's naming, with as many digits as keep the order of names the order of frames."""
    first = 1 if source is None else source.first_number
    digits = VIDEO_DIGITS if frame_count is None else len(str(first + frame_count - 1))
    if source is None:
        return Numbering(folder, "", max(digits, VIDEO_DIGITS), ".png")
    if source.numbering is None:
        return Numbering(folder, "", max(digits, VIDEO_DIGITS), source.suffix)
    return replace(source.numbering, folder=folder, digits=max(digits, source.numbering.digits))


def _move_all(moves: Sequence[tuple[Path, Path]]) -> None:
    """Move every file or, where one cannot be moved, none."""
    try:
        for here, there in moves:
            os.replace(here, there)
    except BaseException:
        for here, there in reversed(moves):
            with suppress(OSError):
                if there.exists() and not here.exists():
                    os.replace(there, here)
        raise
