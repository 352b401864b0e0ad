"""How the files of side outputs are named after frames; see `fpsboost.io.side.options`."""

from __future__ import annotations

from collections.abc import Callable, Collection
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Self

from fpsboost.errors import OptionError
from fpsboost.io import FrameSink
from fpsboost.io.images.files import IMAGE_SUFFIXES, extension_of
from fpsboost.io.images.numbered import VIDEO_DIGITS, ImageSink
from fpsboost.io.images.numbering import is_pattern
from fpsboost.io.images.sequence import NumberedImages, Numbering


@dataclass(frozen=True)
class FileNames:
    """How the files of a side output are named.

    Attributes
    ----------
    path : str
        Folder or pattern, as the user gave it.
    folder : Path
    suffix : str
        Type of the files, ``.png``.
    stem : callable
        Returns a frame's part of the names by its place among the frames, from 0.
    numbering : Numbering or None
        The names without the type; None if they have no numbers.
    """

    path: str
    folder: Path
    suffix: str
    stem: Callable[[int], str]
    numbering: Numbering | None

    @property
    def is_pattern(self) -> bool:
        """Whether the user has named a pattern, and not a folder."""
        return is_pattern(self.path)

    def namings(self, endings: Collection[str]) -> list[Numbering]:
        """Return the names of all files with these endings."""
        if self.numbering is None:
            return []
        return [replace(self.numbering, suffix=self.numbering.suffix + ending) for ending in endings]

    @classmethod
    def after_output(cls, path: str, option: str, suffixes: Collection[str], sink: FrameSink) -> Self:
        """Name files like the images of an output; by six digits from 1 if it has none.

        Parameters
        ----------
        path : str
            Folder or pattern.
        option : str
            Name of its option.
        suffixes : collection of str
            Types of files, the first for folders.
        sink : FrameSink

        Raises
        ------
        OptionError
            The path names neither a folder nor a pattern of these types.
        """
        numbered = sink if isinstance(sink, ImageSink) else None
        numbering, suffix = _parsed(path, option, suffixes, numbered.numbering if numbered else None)
        first, step = numbered.numbers if numbered else (1, 1)
        return cls(path, numbering.folder, suffix, lambda place: numbering.path(first + place * step).name, numbering)

    @classmethod
    def after_source(cls, path: str, option: str, suffixes: Collection[str], images: NumberedImages | None) -> Self:
        """Name files like the images of a source; by six digits from 1 if it has none.

        Parameters
        ----------
        path, option, suffixes
            As for `after_output`.
        images : NumberedImages or None
            The images that are read, if the source has images.

        Raises
        ------
        OptionError
            The path names neither a folder nor a pattern of these types.
        """
        numbering, suffix = _parsed(path, option, suffixes, images.numbering if images else None)
        numbers = images.numbers if images else []
        if images and not numbers and not is_pattern(path):
            files = images.files
            return cls(path, Path(path), suffix, lambda place: files[place].stem, None)

        def stem(place: int) -> str:
            return numbering.path(numbers[place] if numbers else place + 1).name

        return cls(path, numbering.folder, suffix, stem, numbering)


def _parsed(path: str, option: str, suffixes: Collection[str], naming: Numbering | None) -> tuple[Numbering, str]:
    """Return the naming without the type of file, and the type.

    Raises
    ------
    OptionError
        The path names neither a folder nor a pattern of these types.
    """
    extension = extension_of(path)
    suffix = next(iter(suffixes))
    if is_pattern(path):
        if extension not in suffixes:
            known = " or ".join(suffixes)
            raise OptionError(f"{option} writes {known}, not {path}; name a folder, or a pattern such as map_####.exr.")
        numbering = Numbering.parse(path)
        return _without_type(numbering), extension
    if not path or (extension in {*suffixes, *IMAGE_SUFFIXES} and not Path(path).is_dir()):
        raise OptionError(f"{option} needs a folder, or a pattern such as map_####{suffix}, not {path or 'nothing'}.")
    if naming is None:
        return Numbering(Path(path), "", VIDEO_DIGITS, ""), suffix
    return replace(_without_type(naming), folder=Path(path)), suffix


def _without_type(naming: Numbering) -> Numbering:
    """Return a naming without the type of file: ``_left`` instead of ``_left.png``."""
    return replace(naming, suffix=naming.suffix[: naming.suffix.rfind(".")])
