"""Numbered images in a folder: PNG, TIFF, JPEG, WebP and BMP.

A sequence is one naming, ``prefix + number + suffix``, with consecutive numbers. Pixels are kept as the files have
them, 8 or 16 bit or float, gray or colour, with or without alpha. What describes the pixels is not: colour profiles and
other metadata end here, and an EXIF orientation is not applied. A palette becomes colour, a PNG's gray with alpha BGRA.

Encoding was chosen by measuring 1080p frames: OpenCV's own PNG setting takes 60 to 130 ms, compression 3 two to four
times as long for files between 30 % smaller (smooth) and 7 % larger (grain); LZW with a predictor takes a third off an
8-bit TIFF in 60 ms; float TIFF stays uncompressed, because OpenCV 4 would choose a lossy compression by itself.
"""

from __future__ import annotations

import itertools
import os
import re
import secrets
import shutil
from collections import defaultdict
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass, replace
from fractions import Fraction
from pathlib import Path
from types import TracebackType
from typing import Self

import cv2
import numpy as np

from fpsboost.errors import FpsboostError, InputError, OptionError, OutputError
from fpsboost.frame import ClipInfo, Frame, Image, describe, type_names

IMAGE_SUFFIXES = (".png", ".tif", ".tiff", ".jpg", ".jpeg", ".webp", ".bmp")

JPEG_QUALITY = 95
VIDEO_DIGITS = 6  # where the source has no numbers: 999999 frames are more than four hours at 60 per second

# What each format keeps exactly (JPEG: as far as a lossy format does).
_types_kept = {
    ".png": (np.uint8, np.uint16),
    ".tif": (np.uint8, np.uint16, np.float32),
    ".tiff": (np.uint8, np.uint16, np.float32),
    ".jpg": (np.uint8,),
    ".jpeg": (np.uint8,),
    ".webp": (np.uint8,),
    ".bmp": (np.uint8,),
}
_keeps_alpha = (".png", ".tif", ".tiff", ".webp")
_largest_side = {".jpg": 65500, ".jpeg": 65500, ".webp": 16383}


# ---------------------------------------------------------------------------------------------------------------- names


def is_pattern(path: str) -> bool:
    """Say whether a path stands for numbered images, by its last component alone.

    ``%04d`` and two or more ``#`` always do. A lone ``%d`` or ``#`` does where the name ends like an image, so that
    ``take #2.mp4`` and ``100%done.mkv`` stay file names.

    Examples
    --------
    >>> is_pattern("render/shot_%04d.png"), is_pattern("shot_####.png"), is_pattern("shot_####/0001.png")
    (True, True, False)
    """
    name = Path(path).name
    place = _find_placeholder(name)
    return place is not None and (place[0] not in ("%d", "#") or _extension(name) in IMAGE_SUFFIXES)


def _find_placeholder(name: str) -> re.Match[str] | None:
    """The last one counts, so that ``shot #2_####.png`` works; ``%`` goes before ``#``."""
    found = list(re.finditer("%(?:0[0-9]+)?d", name)) or list(re.finditer("#+", name))
    return found[-1] if found else None


def _extension(name: str) -> str:
    return os.path.splitext(name)[1].lower()


@dataclass(frozen=True, slots=True)
class Numbering:
    """How the images of one sequence are named.

    Attributes
    ----------
    folder : Path
    prefix : str
        What stands before the number.
    digits : int
        Numbers are padded with zeros to this width, and grow beyond it; 1 for no padding.
    suffix : str
        What stands behind the number, with the file type: ``.png``, ``_left.png``.
    """

    folder: Path
    prefix: str
    digits: int
    suffix: str

    @classmethod
    def parse(cls, pattern: str) -> Self:
        """Read a pattern, ``shot_%04d.png`` or ``shot_####.png``.

        Raises
        ------
        OptionError
            There is no place for a number in the last component.

        Examples
        --------
        >>> Numbering.parse("shot_##.png").path(7).name
        'shot_07.png'
        """
        folder, name = Path(pattern).parent, Path(pattern).name
        place = _find_placeholder(name)
        if place is None:
            raise OptionError(f"{pattern} has no place for a number; write one like shot_%04d.png or shot_####.png.")
        digits = len(place[0]) if place[0][0] == "#" else int(place[0][1:-1] or 1)
        return cls(folder, name[: place.start()], max(digits, 1), name[place.end() :])

    @property
    def pattern(self) -> str:
        """The naming as a user would write it, without the folder."""
        return f"{self.prefix}{'#' * self.digits}{self.suffix}"

    def path(self, number: int) -> Path:
        """Name the image of this number."""
        return self.folder / f"{self.prefix}{number:0{self.digits}d}{self.suffix}"

    def number_in(self, name: str, *, any_padding: bool = False) -> int | None:
        """Read the number out of a file name; None where the name is not of this naming."""
        found = re.fullmatch(f"{re.escape(self.prefix)}([0-9]+){re.escape(self.suffix)}", name)
        if found is None or not (any_padding or self.path(int(found[1])).name == name):
            return None
        return int(found[1])

    def find(self, *, any_padding: bool = False) -> list[tuple[int, Path]]:
        """List the existing images of this naming with their numbers, in the order of the numbers.

        Raises
        ------
        OSError
            The folder cannot be read.
        """
        numbers = ((self.number_in(name, any_padding=any_padding), name) for name in _list_files(self.folder))
        return sorted((number, self.folder / name) for number, name in numbers if number is not None)


def _list_files(folder: Path) -> list[str]:
    with os.scandir(folder) as entries:
        return sorted(entry.name for entry in entries if entry.is_file())


def _scan_folder(folder: Path) -> tuple[list[Path], Numbering | None]:
    """Find the one sequence in a folder; images without any number in their names go by the alphabet."""
    names = [name for name in _list_files(folder) if _extension(name) in IMAGE_SUFFIXES and not name.startswith(".")]
    if not names:
        raise InputError(f"{folder} holds no images ({', '.join(IMAGE_SUFFIXES)}); name a folder that does.")
    groups, plain = _group_names(names)
    plain_types = {f"*{os.path.splitext(name)[1]}" for name in plain}
    if len(groups) + len(plain_types) > 1:
        raise _several_sequences(folder, groups, plain_types)
    if plain:
        return [folder / name for name in sorted(plain, key=lambda name: (name.casefold(), name))], None
    (prefix, suffix), numbers = groups.popitem()
    numbering = Numbering(folder, prefix, min(map(len, numbers)), suffix)
    for name in names:
        if numbering.number_in(name) is None:
            raise InputError(
                f"{folder} holds numbers of different widths ({numbering.path(int(min(numbers, key=len))).name} and "
                f"{name}); name the frames alike, or choose some with a pattern such as {folder / numbering.pattern}."
            )
    return _find_without_gap(numbering), numbering


def _group_names(names: Sequence[str]) -> tuple[dict[tuple[str, str], list[str]], list[str]]:
    """Sort names into sequences: numbers by (prefix, suffix), and the names that have no number.

    Of several numbers in a name the frame number is the only one that changes, else the last:
    ``shot2_0001_v3.png`` next to ``shot2_0002_v3.png``.
    """
    alike: dict[tuple[str, ...], list[list[str]]] = defaultdict(list)
    plain = []
    for name in names:
        stem, extension = os.path.splitext(name)
        parts = re.split("([0-9]+)", stem)
        if len(parts) == 1:
            plain.append(name)
        else:
            parts[-1] += extension
            alike[tuple(parts[::2])].append(parts)
    groups: dict[tuple[str, str], list[str]] = defaultdict(list)
    for rows in alike.values():
        changing = [i for i in range(1, len(rows[0]), 2) if len({row[i] for row in rows}) > 1]
        place = changing[0] if len(changing) == 1 else len(rows[0]) - 2
        for row in rows:
            groups["".join(row[:place]), "".join(row[place + 1 :])].append(row[place])
    return groups, plain


def _several_sequences(folder: Path, groups: dict[tuple[str, str], list[str]], plain: set[str]) -> InputError:
    by_size = sorted(groups, key=lambda key: -len(groups[key]))
    patterns = [Numbering(folder, key[0], min(map(len, groups[key])), key[1]).pattern for key in by_size]
    labels = patterns + sorted(plain)
    listed = ", ".join(labels[:3]) + (f" and {len(labels) - 3} more" if len(labels) > 3 else "")
    advice = f"choose one with a pattern such as {folder / patterns[0]}" if patterns else "keep one type of file"
    return InputError(f"{folder} holds several sequences of images ({listed}); {advice}.")


def _find_without_gap(numbering: Numbering) -> list[Path]:
    found = numbering.find()
    if not found:
        raise InputError(f"No image is named like {numbering.folder / numbering.pattern}; check the pattern.")
    for expected, (number, _) in zip(itertools.count(found[0][0]), found, strict=False):
        if number != expected:
            raise InputError(
                f"{numbering.path(expected)} is missing from its sequence; add it, or renumber the images without gaps."
            )
    return [path for _, path in found]


# -------------------------------------------------------------------------------------------------------------- reading


@contextmanager
def _explain(kind: type[FpsboostError], task: str, path: str | Path, advice: str) -> Iterator[None]:
    try:
        yield
    except OSError as error:
        raise kind(f"Cannot {task} {path} ({error.strerror or error}); {advice}.") from error


def read_image(path: Path) -> Image:
    """Read one image as it is stored.

    Returns
    -------
    (H, W, C) uint8, uint16 or float32

    Raises
    ------
    InputError
        It cannot be read, is damaged, or has another type of pixels.
    """
    with _explain(InputError, "read", path, "check that it exists and that you may read it"):
        data = path.read_bytes()  # not cv2.imread, which knows no Unicode names on Windows and gives no reasons
    try:
        image = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_UNCHANGED) if data else None
    except cv2.error:
        image = None
    if image is None or _ends_early(data):
        raise InputError(f"{path} is damaged or no image; replace it.")
    if image.ndim == 2:
        image = image[:, :, np.newaxis]
    if image.dtype not in type_names or image.shape[2] not in (1, 3, 4):
        raise InputError(
            f"{path} has {image.shape[2]} channels of {image.dtype}; "
            "save it as gray or colour with 8 bits, 16 bits or 32-bit float."
        )
    return image


def _ends_early(data: bytes) -> bool:
    """Look for the end of a JPEG behind the start of its scan: OpenCV 4 fills up what is missing with gray."""
    if data[:2] != b"\xff\xd8":
        return False
    place = 2
    while data[place : place + 1] == b"\xff" and data[place + 1 : place + 2] not in (b"\xda", b""):
        is_filler = data[place + 1] == 0xFF
        place += 1 if is_filler else 2 + int.from_bytes(data[place + 2 : place + 4])
    return data[place : place + 2] == b"\xff\xda" and data.find(b"\xff\xd9", place) < 0


class ImageSource:
    """Read a folder or a pattern of images, one at a time.

    Parameters
    ----------
    path : str
        A folder that holds one sequence, or a pattern. In a folder, files that are no images and hidden files are
        ignored.
    rate : Fraction
        Frames per second; images do not say.

    Attributes
    ----------
    files : list of Path
        The images in order.
    numbering : Numbering or None
        How they are named; None where the names have no numbers.
    first_number : int
        Number of the first image; 1 where there are none.
    suffix : str
        The type of the files as they write it, ``.png``.

    Raises
    ------
    OptionError
        The rate is not above 0.
    InputError
        No images, several sequences, a gap, or an unreadable first image; while iterating, an unreadable image or one
        that differs from the first in size or type.
    """

    def __init__(self, path: str, rate: Fraction) -> None:
        if rate <= 0:
            raise OptionError(f"The frame rate of images must be above 0, not {rate}.")
        place = Path(path)
        self.numbering: Numbering | None
        with _explain(InputError, "read", path, "check that it exists and that you may read it"):
            if place.is_dir():
                self.files, self.numbering = _scan_folder(place)
            elif is_pattern(path):
                self.numbering = Numbering.parse(path)
                self.files = _find_without_gap(self.numbering)
            elif place.exists():
                raise InputError(f"{path} is a single file; give a folder of images or a pattern like shot_####.png.")
            else:
                raise InputError(f"{path} does not exist; check the path.")
        self.suffix = self.files[0].suffix
        if self.suffix.lower() not in IMAGE_SUFFIXES:
            raise InputError(f"{path} is no type of image that can be read; use one of {', '.join(IMAGE_SUFFIXES)}.")
        number = None if self.numbering is None else self.numbering.number_in(self.files[0].name)
        self.first_number = 1 if number is None else number
        height, width, _ = read_image(self.files[0]).shape
        self.info = ClipInfo(path, height, width, rate, 1 / rate, len(self.files))

    @property
    def remarks(self) -> list[str]:
        """Nothing is ever lost or guessed: what is wrong with images is an error."""
        return []

    def __iter__(self) -> Iterator[Frame]:
        first = None
        for index, path in enumerate(self.files):
            image = read_image(path)
            if first is None:
                first = image
            if image.shape != first.shape or image.dtype != first.dtype:
                raise InputError(
                    f"{path} ({describe(image)}) is unlike {self.files[0]} ({describe(first)}); "
                    "make all images one size and type."
                )
            yield Frame(image, index / self.info.rate, 1 / self.info.rate)

    def close(self) -> None:
        """Do nothing: no file stays open."""

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()


# -------------------------------------------------------------------------------------------------------------- writing


def _encoding(extension: str, image: Image) -> list[int]:
    """Options of OpenCV for one image; see the module's text for why."""
    if extension in (".jpg", ".jpeg"):
        return [cv2.IMWRITE_JPEG_QUALITY, JPEG_QUALITY]
    if extension in (".tif", ".tiff"):
        if image.dtype == np.float32:
            return [cv2.IMWRITE_TIFF_COMPRESSION, cv2.IMWRITE_TIFF_COMPRESSION_NONE]
        lzw, horizontal = cv2.IMWRITE_TIFF_COMPRESSION_LZW, cv2.IMWRITE_TIFF_PREDICTOR_HORIZONTAL
        return [cv2.IMWRITE_TIFF_COMPRESSION, lzw, cv2.IMWRITE_TIFF_PREDICTOR, horizontal]
    if extension == ".webp":
        return [cv2.IMWRITE_WEBP_QUALITY, 101]  # above 100 means lossless
    return []


def _check_format(path: Path, image: Image) -> None:
    extension = path.suffix.lower()
    if image.dtype not in _types_kept[extension]:
        other = ".tif" if image.dtype == np.float32 else ".png or .tif"
        kind = type_names[image.dtype]
        raise OutputError(f"{path.name} cannot hold {kind} images; use {other}, as in shot_######{other[-4:]}.")
    if image.shape[2] == 4 and extension not in _keeps_alpha:
        raise OutputError(f"{path.name} cannot hold alpha; use .png or .tif, as in shot_######.png.")


def _name_in_folder(folder: Path, source: ImageSource | None, frame_count: int | None) -> Numbering:
    """Continue the source's naming, with as many digits as keep the order of names the order of frames."""
    first = 1 if source is None else source.first_number
    digits = VIDEO_DIGITS if frame_count is None else len(str(first + frame_count - 1))
    if source is None:
        return Numbering(folder, "", max(digits, VIDEO_DIGITS), ".png")
    if source.numbering is None:
        return Numbering(folder, "", max(digits, VIDEO_DIGITS), source.suffix)
    return replace(source.numbering, folder=folder, digits=max(digits, source.numbering.digits))


class ImageSink:
    """Write numbered images, all of them or none.

    They grow in a hidden folder beside their final place. A new folder gets its name by one renaming; into an existing
    one the images are moved at the end, and moved back should that fail.

    Parameters
    ----------
    path : str
        A folder, made if it is not there, or a pattern in an existing folder. In a folder the naming of an image source
        is continued; frames of a video become ``000001.png``. JPEG is written with quality 95, everything else without
        loss.
    info : ClipInfo
        The size of the images.
    source : ImageSource or None
        Where the frames come from, if that is images: gives the first number and, in a folder, the naming.
    frame_count : int or None
        Expected number of frames; decides the digits in a folder.
    overwrite : bool
        Replace images of the same naming, later ones too. Anything else in the folder stays.

    Raises
    ------
    OutputError
        The target exists (without `overwrite`), is the source, or cannot hold or receive the images.
    """

    holds_last_frame = False

    def __init__(
        self, path: str, info: ClipInfo, source: ImageSource | None, frame_count: int | None, *, overwrite: bool
    ) -> None:
        self._path = path
        self._overwrite = overwrite
        self._next = 1 if source is None else source.first_number
        self._names: list[str] = []
        self._remarks: list[str] = []
        with _explain(OutputError, "write to", path, "check the path and the permissions"):
            self._is_folder = Path(path).is_dir() or not is_pattern(path)
            if self._is_folder:
                self._numbering = _name_in_folder(Path(path), source, frame_count)
            else:
                self._numbering = Numbering.parse(path)
                self._remark_on_digits(frame_count)
            self._check_place(info)
            if source is not None:
                self._refuse_inputs(source)
            self._refuse_existing()
            folder, token = self._numbering.folder, secrets.token_hex(4)
            # Inside an existing folder rather than beside it: the folder may be a mount point, the parent read-only.
            self._is_new = not folder.is_dir()
            self._stage = folder.parent / f".{folder.name}.{token}" if self._is_new else folder / f".fpsboost.{token}"

    @property
    def numbering(self) -> Numbering:
        """How the images are named."""
        return self._numbering

    @property
    def remarks(self) -> list[str]:
        """Sentences about what the files could not hold."""
        return list(self._remarks)

    def _remark_on_digits(self, frame_count: int | None) -> None:
        digits = self._numbering.digits
        if frame_count is not None and 1 < digits < len(str(self._next + frame_count - 1)):
            self._remarks.append(f"{self._path} has too few digits for {frame_count} frames: later names grow longer.")

    def _check_place(self, info: ClipInfo) -> None:
        folder, extension = self._numbering.folder, _extension(self._numbering.path(1).name)
        if extension not in IMAGE_SUFFIXES:
            raise OutputError(
                f"{self._path} names no type of image that can be written; use one of {', '.join(IMAGE_SUFFIXES)}."
            )
        largest = _largest_side.get(extension)
        if largest is not None and max(info.height, info.width) > largest:
            raise OutputError(
                f"{self._path} cannot hold {info.width}x{info.height} pixels, {extension} ends at {largest}; use .png."
            )
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
        if self._overwrite or not folder.is_dir():
            return
        if self._is_folder and any(not name.startswith(".") for name in os.listdir(folder)):
            raise OutputError(f"{folder} is not empty; add --overwrite to replace the frames in it, or name another.")
        old = self._find_old()
        if old:
            raise OutputError(f"{old[0]} exists; add --overwrite to replace such images, or choose another pattern.")

    def __enter__(self) -> Self:
        with _explain(OutputError, "write to", self._path, "check the free space and the permissions"):
            self._stage.mkdir()
        return self

    def write(self, frame: Frame) -> None:
        """Write the next image; its time does not matter."""
        path = self._numbering.path(self._next)
        _check_format(path, frame.image)
        data = self._encode(path, frame.image)
        with _explain(OutputError, "write", path, "check the free space and the permissions"):
            (self._stage / path.name).write_bytes(data)
        self._names.append(path.name)
        self._next += 1

    def _encode(self, path: Path, image: Image) -> bytes:
        extension = path.suffix.lower()
        options = _encoding(extension, image)
        if extension == ".webp":
            options += self._care_for_webp(image)
        try:
            done, data = cv2.imencode(extension, image, options)
        except cv2.error:
            done = False
        if not done:
            raise OutputError(f"{path} cannot be encoded ({describe(image)}); try .png or .tif.")
        return data.tobytes()

    def _care_for_webp(self, image: Image) -> list[int]:
        channels = image.shape[2]
        if channels == 1:
            self._remark_once("WebP has no gray: gray images were written as colour with three equal channels.")
        if channels == 4 and hasattr(cv2, "IMWRITE_WEBP_LOSSLESS_MODE"):  # OpenCV 4.12 and later
            return [cv2.IMWRITE_WEBP_LOSSLESS_MODE, cv2.IMWRITE_WEBP_LOSSLESS_PRESERVE_COLOR]
        if channels == 4 and np.any(image[image[:, :, 3] == 0]):
            self._remark_once("This version of OpenCV drops the colour of fully transparent pixels from WebP.")
        return []

    def _remark_once(self, remark: str) -> None:
        if remark not in self._remarks:
            self._remarks.append(remark)

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        try:
            if kind is None and self._names:
                with _explain(OutputError, "write to", self._path, "check the free space and the permissions"):
                    self._finish()
        finally:
            self._remove_stage()

    def _finish(self) -> None:
        self._refuse_existing()  # once more: hours may have passed
        if self._is_new and not self._numbering.folder.exists():
            self._stage.rename(self._numbering.folder)
            return
        old, replaced = self._find_old(), self._stage / "replaced"
        replaced.mkdir()
        moves = [(path, replaced / path.name) for path in old]
        moves += [(self._stage / name, self._numbering.folder / name) for name in self._names]
        _move_all(moves)
        shutil.rmtree(replaced, ignore_errors=True)

    def _remove_stage(self) -> None:
        replaced = self._stage / "replaced"
        with suppress(OSError):
            if replaced.is_dir():
                replaced.rmdir()  # fails where earlier frames could not be moved back: those are never deleted
            shutil.rmtree(self._stage, ignore_errors=True)


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
