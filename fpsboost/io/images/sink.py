"""Numbered images written one at a time, all of them or none; and a part of them, to be joined with others later."""

import itertools
import os
import shutil
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Self

from fpsboost.errors import CompleteAlreadyError, OptionError, OutputError, explained, undone_by
from fpsboost.frame import Frame
from fpsboost.io.images.encoder import ImageEncoder
from fpsboost.io.images.files import IMAGE_SUFFIXES, extension_of
from fpsboost.io.images.sequence import NumberedImages, Numbering
from fpsboost.io.images.source import is_pattern
from fpsboost.io.new_output import ADVICE, StagedFiles
from fpsboost.io.output import Output
from fpsboost.media import IN_EXISTING_FOLDER, PartFolder, Remark, StagedSink, StagingDirectory, write_safely
from fpsboost.remarks import Remarks

VIDEO_DIGITS = 6  # where the source has no numbers: 999999 frames are more than four hours at 60 per second


@dataclass(frozen=True)
class ImageNames:
    """Names of the images of an output.

    Parameters
    ----------
    numbering : Numbering
        Folder and naming.
    first : int
        Number of the first image.
    step : int
        Difference of the numbers of successive images.
    is_anew : bool
        Whether the numbers are not those of the source.
    remarks : sequence of Remark
        Remarks on numbers that differ from what a user may expect.
    """

    numbering: Numbering
    first: int
    step: int
    is_anew: bool
    remarks: Sequence[Remark] = ()

    def path(self, place: int) -> Path:
        """Return the path of an image by its place in the output, counted from 0."""
        return self.numbering.path(self.first + place * self.step)


class NumberedSink(StagedSink):
    """Base of the sinks for all images of an output and for a part: images are collected in a hidden folder.

    Parameters
    ----------
    output : Output
        Properties of the frames to come, and of their source.
    names : ImageNames
        Names of the images.
    unfinished : StagingDirectory
        Hidden folder, whose `staged` is the folder of the images.

    Raises
    ------
    OutputError
        The names are those of no type of image that can be written.
    """

    holds_last_frame = False

    def __init__(self, output: Output, names: ImageNames, unfinished: StagingDirectory) -> None:
        if extension_of(names.path(0).name) not in IMAGE_SUFFIXES:
            raise OutputError(
                f"{output.path} names no type of image that can be written; use one of {', '.join(IMAGE_SUFFIXES)}."
            )
        self.names = names
        self._output = output
        self._unfinished = unfinished
        self._name = unfinished.name
        self._staged = unfinished.staged
        self._encoder = ImageEncoder(
            output.path, output.stream.images, output.stream.traits or output.stream.colours, anew=names.is_anew
        )
        originals = output.stream.images.files if output.in_place and output.stream.images is not None else []
        self._originals = {file.name for file in originals}
        self._written: list[str] = []
        self._frames = 0

    @property
    def remarks(self) -> list[Remark]:
        return [*self._unfinished.remarks, *self.names.remarks, *self._encoder.remarks]

    @property
    def kept_frames(self) -> int:
        """Number of `completed_frames` that are images of the input, which stay where they are."""
        return sum(self.names.path(place).name in self._originals for place in range(self.completed_frames))

    def __enter__(self) -> Self:
        """Lock the hidden folder, and count the images, from the first without a gap, that an earlier run has written.

        Raises `OutputError` if that folder holds frames which a stopped run had set aside, and this one does not resume
        it.
        """
        with self._explained():
            self._unfinished.open()
            with undone_by(lambda: self._unfinished.close(keep=True)):
                there = self._finished() | self._originals
        self.completed_frames = next(place for place in itertools.count() if self.names.path(place).name not in there)
        return self

    def _finished(self) -> set[str]:
        """Return the names of the images that an earlier run has written."""
        return set(os.listdir(self._staged))

    def write(self, frame: Frame) -> None:
        """Encode the next frame and write its file, synced to disk, in the hidden folder.

        An original whose file type stays the same is copied byte for byte, if its metadata permits that. Files of an
        earlier run, and of the input in place, stay as they are. Raises `OutputError` if the type of file cannot hold
        the image.
        """
        path = self.names.path(self._frames)
        self._frames += 1
        if path.name in self._originals:  # in place: stays as it is
            self._encoder.passes(path, is_same=True)
            return
        self._encoder.check(path, frame.array)
        if self._frames > self.completed_frames:
            data = self._encoder.content(path, frame)
            with explained(OutputError, "write", path, ADVICE):
                write_safely(self._staged / path.name, data)
        self._written.append(path.name)

    def _finish(self) -> None:
        """Remove files from the hidden folder that this run has not passed, such as half-written ones."""
        for extra in set(os.listdir(self._staged)) - set(self._written):
            (self._staged / extra).unlink()

    def _leave(self, error: BaseException | None) -> None:
        """Remove the hidden folder, unless a later run can resume from it."""
        written = self._frames if self._written else 0
        self._unfinished.leave(error, max(self.completed_frames, written), self._output.expected_of_part)


class ImageSink(NumberedSink):
    """Sink that writes numbered images, all of them or none.

    They are collected in a hidden folder beside their final place. A new folder gets its name by one renaming; into an
    existing one the images are moved at the end, and moved back should that fail. A later run can go on with images
    that are there when this one is stopped, and with moving them.

    The output's path is a folder, made if it is not there, or a pattern in an existing folder. In a folder the naming
    of an image source is continued; frames of a video become ``000001.png``. Where the factor divides the step of the
    source's numbers, the images keep those, with their padding, and the others get the numbers between. JPEG is written
    with quality 95, everything else without loss: OpenEXR as half where the source is, else as float.

    Parameters
    ----------
    output : Output
        Path, size and options of the frames to come, and the images of the source. With `overwrite`, images of the same
        naming are replaced, later ones too, and anything else in the folder stays. With `in_place`, images are added to
        those of the source.

    Raises
    ------
    OptionError
        The numbers of the source have no room for an output in place.
    ExistsError, CompleteAlreadyError
        There are images that only `overwrite` would replace; the second if the job is to be resumed but is complete.
    OutputError
        The folder or type of file cannot be written, or the output would replace an input.
    """

    def __init__(self, output: Output) -> None:
        path = output.path
        images = output.stream.images
        with explained(OutputError, "write to", path, "check the path and the permissions"):
            self._is_folder = _is_folder(path)
            names = _names_in_place(output) if output.in_place else _names_of(output)
            self._files = StagedFiles(
                path,
                [names.numbering],
                IN_EXISTING_FOLDER if self._is_folder and not output.in_place else names.numbering.pattern,
                overwrite=output.overwrite,
                alone=self._is_folder,
                job=output.job,
                adds_only=output.in_place,
            )
            if images is not None and not output.in_place:
                self._refuse_inputs(path, images)
            super().__init__(output, names, self._files)
            self._files.check()

    def _refuse_inputs(self, path: str, images: NumberedImages) -> None:
        """Raise `OutputError` if the output would overwrite an input, also via links or case."""
        numbering = self._files.namings[0]
        folder = numbering.folder
        if not folder.is_dir():
            return
        old = set(map(os.path.realpath, self._files.find_old()))
        inputs = images.files
        clash = next((file for file in inputs if os.path.realpath(file) in old), None) if old else None
        if folder.samefile(inputs[0].parent):
            if self._is_folder:
                raise OutputError(f"{path} is also the input; write to another folder.")
            folded = replace(numbering, prefix=numbering.prefix.casefold(), suffix=numbering.suffix.casefold())
            clash = next((file for file in inputs if folded.number_in(file.name.casefold()) is not None), clash)
        if clash is not None:
            raise OutputError(f"{path} would replace the input {clash}; write to another folder or pattern.")

    def _finished(self) -> set[str]:
        return self._files.finished

    def join(self, files: Sequence[Path]) -> None:
        """Take image files that were written elsewhere, in order, instead of frames; they stay where they are.

        Raises `OutputError` if a file has another name than this output would give it.
        """
        with self._explained():
            for file in files:
                name = self.names.path(self._frames).name
                if file.name != name:
                    raise OutputError(
                        f"{self._name} would name an image {name} that is called {file.name} in its part; name "
                        "the output as then."
                    )
                try:
                    os.link(file, self._staged / name)
                except OSError:  # another disk, or one that knows no links
                    shutil.copy2(file, self._staged / name)
                self._frames += 1
                self._written.append(name)

    def _finish(self) -> None:
        """Give the images their names, replaced ones set aside until all are moved; nothing without frames."""
        super()._finish()
        self._files.publish_files()


class ImagePartSink(NumberedSink):
    """Sink for a part of an output: its images, with their final names, appear in a folder when they are complete.

    Parameters
    ----------
    output : Output
        As for `ImageSink`, with `part`.
    """

    def __init__(self, output: Output) -> None:
        assert output.part is not None
        names = _names_of(output)
        self._folder = PartFolder(output.part, output.job, overwrite=output.overwrite)
        names = replace(names, first=names.first + output.part.first * names.step)
        super().__init__(output, names, self._folder)

    def _finish(self) -> None:
        super()._finish()
        self._folder.publish_part()


def _is_folder(path: str) -> bool:
    """Return whether an output's path is a folder and not a pattern."""
    return Path(path).is_dir() or not is_pattern(path)


def _names_of(output: Output) -> ImageNames:
    """Return the names of an output: the source's numbers with those between, if they have room, else new ones."""
    path = output.path
    images = output.stream.images
    factor = output.factor
    count = output.expected_frames
    kept = None if images is None or factor is None else images.numbers_for(factor)
    first, step = kept or (1 if images is None else images.first_number, 1)
    # as many digits as keep the order of names the order of frames
    digits = 0 if count is None else len(str(first + (count - 1) * step))
    if not _is_folder(path):
        numbering = Numbering.parse(path)
    elif images is None or images.numbering is None:
        suffix = ".png" if images is None else images.files[0].suffix
        numbering = Numbering(Path(path), "", max(digits, VIDEO_DIGITS), suffix)
    else:
        padded = max(digits or VIDEO_DIGITS, images.numbering.digits)
        numbering = replace(images.numbering, folder=Path(path), digits=images.numbering.digits if kept else padded)
    gap = 1 if images is None else images.step
    remarks = Remarks()
    if gap > 1 and kept is None and factor is not None:
        remarks.add("numbered-anew", factor=factor, gap=gap)
    if not _is_folder(path) and 1 < numbering.digits < digits:
        remarks.add("few-digits", name=path, frames=count)
    return ImageNames(numbering, first, step, kept is None, remarks)


def _names_in_place(output: Output) -> ImageNames:
    """Return the source's own names for an output in place; raise an error if its numbers have no room."""
    path = output.path
    images = output.stream.images
    factor = output.factor
    if images is None or images.numbering is None or factor is None:
        raise OptionError(f"`in_place` needs images with numbers in their names, and {path} has none.")
    if images.step == 1 and images.numbers[-1] - images.numbers[0] < len(images.numbers):
        if output.job is not None and output.job.resume:
            raise CompleteAlreadyError(f"No image is missing from {path}, so it was left as it is.")
        raise OutputError(
            f"No image is missing from {path}: there are no numbers for frames between; leave `in_place` out "
            "and name another folder."
        )
    kept = images.numbers_for(factor) if (factor == 1) == images.fills_gaps and factor >= 1 else None
    if kept is None:
        way = "leave `factor` out" if images.fills_gaps else f"give `factor={images.step}`, or `fill_gaps`"
        raise OptionError(
            f"{factor} times the frames of {path} do not fit between its numbers, which `in_place` keeps; {way}."
        )
    return ImageNames(images.numbering, *kept, is_anew=False)
