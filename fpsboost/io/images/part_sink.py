"""Write a part of numbered images, which are put into one folder with those of the other parts later."""

from __future__ import annotations

import os
from types import TracebackType
from typing import Self

from fpsboost.errors import OutputError, explained
from fpsboost.frame import Frame
from fpsboost.io.images.files import IMAGE_SUFFIXES, check_size, extension_of
from fpsboost.io.images.image_encoder import ImageEncoder
from fpsboost.io.images.numbered import choose_numbering, first_number, numbering_remarks
from fpsboost.io.output import Output
from fpsboost.io.part import PartFolder
from fpsboost.io.staging import write_safely


class ImagePartSink:
    """Sink that writes the images of a part, with their final names, in a folder that appears when they are complete.

    Parameters
    ----------
    output : Output
        With a part. Its path is that of all images.

    Raises
    ------
    OutputError
        The images cannot be written; see also `fpsboost.io.part.PartFolder`.
    """

    holds_last_frame = False

    def __init__(self, output: Output) -> None:
        assert output.part is not None
        images = output.stream.images
        self._path = output.path
        self._numbering = choose_numbering(output)
        first, self._step, kept = first_number(images, output.factor)
        self._next = first + output.part.first * self._step
        self._remarks = numbering_remarks(images, output.factor, kept=kept)
        extension = extension_of(self._numbering.path(1).name)
        if extension not in IMAGE_SUFFIXES:
            raise OutputError(
                f"{output.path} names no type of image that can be written; use one of {', '.join(IMAGE_SUFFIXES)}."
            )
        check_size(output.path, extension, output.info)
        self._folder = PartFolder(output)
        self._encoder = ImageEncoder(output.path, images, anew=not kept)
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
        """Write the next image; its time does not matter.

        Raises
        ------
        InputError, OutputError
            An original cannot be read again, or the image cannot be written.
        """
        path = self._numbering.path(self._next)
        self._next += self._step
        self._encoder.check(path, frame.array)
        if len(self._names) >= self._frames_there:
            data = self._encoder.content(path, frame)
            with explained(OutputError, "write", self._folder.name, "check the free space and the permissions"):
                write_safely(self._folder.files / path.name, data)
        self._names.append(path.name)
