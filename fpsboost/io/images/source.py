"""Numbered images read one at a time, from a folder or by a pattern.

Images whose numbers rise by a step of 2 or more were rendered with that step. Frames made between them get the numbers
that are missing, where the factor divides the step; otherwise all are numbered anew, one by one, with a remark.
"""

import os
import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from fractions import Fraction
from itertools import pairwise
from pathlib import Path

from fpsboost.colour import displayed_colours
from fpsboost.contracts import ClosesOnExit
from fpsboost.errors import InputError, OptionError, explained
from fpsboost.frame import ClipInfo, Frame
from fpsboost.frame_cache import SourcePosition
from fpsboost.image import Image, view
from fpsboost.io.images.colours import colours_of
from fpsboost.io.images.files import IMAGE_SUFFIXES, extension_of, metadata_of, read_image
from fpsboost.io.images.layers import ALL, BEAUTY, Passes
from fpsboost.io.images.sequence import (
    NumberedImages,
    Numbering,
    find_numbered,
    find_placeholder,
    list_files,
    order_names,
)
from fpsboost.io.new_output import names_to_move
from fpsboost.io.output import StreamInfo
from fpsboost.io.video.decode_options import View
from fpsboost.layered import LayeredImage
from fpsboost.media import VIDEO_SUFFIXES, VideoTraits, hidden_place
from fpsboost.memory import MemoryLimit
from fpsboost.remarks import Remarks

MAX_GAP = 1000
"""Frames that are made between two images at most, as with the largest factor; names that are dates end here."""

SCENE_LINEAR = (".exr", ".hdr")  # types of files whose values are scene-linear


@dataclass(frozen=True)
class ImageReading:
    """Options for reading numbered images.

    Parameters
    ----------
    upright : bool
        Turn images by their EXIF orientation, for targets that cannot store it; frames then have no original.
    fill_gaps : bool
        Take numbers for the clock, so that images may be missing.
    in_place : bool
        Ignore frames that a stopped run has begun to move among the images.
    passes : str
        Layers of OpenEXR to read beside the picture; see `fpsboost.io.images.layers.Passes.chosen`.
    linear : bool
        Read OpenEXR and HDR as `LayeredImage`, even without layers, which marks their colours as scene-linear.
    view : {'none', 'srgb'}
        View transform of OpenEXR and HDR: none, or the transfer function of sRGB.
    """

    upright: bool = False
    fill_gaps: bool = False
    in_place: bool = False
    passes: str = BEAUTY
    linear: bool = False
    view: View = "none"


class ImageSource(ClosesOnExit):
    """Source of the images of a folder or a pattern, at a constant rate, read one at a time.

    A folder must hold one sequence; other files and hidden files in it are ignored. Opening reads the first image.

    Parameters
    ----------
    path : str
        Folder, or pattern such as ``shot_####.png``.
    rate : Fraction
        Images, or with `fill_gaps` numbers, per second; above 0.
    reading : ImageReading, optional
        Options for reading; the defaults without it.
    limit : MemoryLimit, optional
        Limit that the size of the images is checked against; by default the free memory.

    Raises
    ------
    InputError
        There is no image, one is missing from the sequence, or the first cannot be read or is too large; while
        iterating also: one cannot be read, or differs from the first in size, type or layers.
    OptionError
        `reading` has an option that does not suit the type of file.
    """

    def __init__(
        self, path: str, rate: Fraction, reading: ImageReading = ImageReading(), *, limit: MemoryLimit | None = None
    ) -> None:
        self._reading = reading
        self._limit = limit or MemoryLimit()
        with explained(InputError, "read", path, "check that it exists and that you may read it"):
            sequence = _without_moved(find_images(path)) if self._reading.in_place else find_images(path)
        fills_gaps = self._reading.fill_gaps
        if fills_gaps:
            _check_gaps(path, sequence)
        else:
            sequence.check_complete(
                sequence.step, "add it, or convert with `fill_gaps`, which makes just those that are missing"
            )
        numbers = sequence.numbers
        first = sequence.files[0]
        self._places = [number - numbers[0] for number in numbers] if fills_gaps else range(len(sequence.files))
        self._first = 0
        if extension_of(first.name) not in IMAGE_SUFFIXES:
            raise InputError(f"{path} is no type of image that can be read; use one of {', '.join(IMAGE_SUFFIXES)}.")
        is_exr = extension_of(first.name) == ".exr"
        passes = self._reading.passes
        self._is_linear = extension_of(first.name) in SCENE_LINEAR
        if not is_exr and passes not in (ALL, BEAUTY):
            raise OptionError(
                f"`passes` names layers of OpenEXR files, and {first} is another type of file; leave it out."
            )
        if self._reading.view != "none" and not self._is_linear:
            raise OptionError(
                f"`view` is for OpenEXR and HDR, whose numbers are light, and {path} is another type; leave it out."
            )
        self._passes = Passes.chosen(first, passes) if is_exr else Passes(first)
        image = self._read(first)
        self.images = replace(
            sequence,
            step=1 if fills_gaps else sequence.step,
            fills_gaps=fills_gaps,
            layers=self._passes.layers,
        )
        self._holds_more = metadata_of(first).has_more
        self._untaggable = Remarks()
        self._colours = VideoTraits()
        if self._reading.upright:  # where images stay images, their metadata is copied instead
            self._colours = colours_of(self._untaggable, first, displayed=self._reading.view == "srgb")
        self._kind = (image.shape, image.dtype)
        self._described = f"{first} ({view(image).describe()})"
        height, width = image.shape[:2]
        # floats, and what is computed from them, take more; measured: 160 bytes a pixel with `nearest`, 390 with `nlm`
        self._limit.check(
            path, width, height, self.images.planes, decoding=400 * width * height * (image.dtype.kind == "f")
        )
        self.info = ClipInfo(path, height, width, rate, 1 / rate, len(sequence.files), self._duration(rate))

    def _duration(self, rate: Fraction) -> Fraction | None:
        """Return the time from the first number to the end of the last, seconds; None if numbers are no clock."""
        return (self._places[-1] - self._places[0] + 1) / rate if self.images.fills_gaps else None

    @property
    def stream_info(self) -> StreamInfo:
        """Files, metadata and colour tags that a sink may carry over."""
        return StreamInfo(images=self.images, files=self.images.files, colours=self._colours)

    def position_of(self, number: int, seconds: Fraction) -> SourcePosition:
        """Return the position, in the whole sequence, of an image that is read, by its number and its time."""
        return SourcePosition(self.images.skipped + number, self._places[0] / self.info.rate + seconds)

    @property
    def remarks(self) -> Remarks:
        """Remarks on assumptions, and on pictures and channels that are not read."""
        remarks = Remarks()
        name = self.info.name
        step = self.images.step
        first = self.images.files[0].name
        pictures = self._passes.pictures
        names = self._passes.left_out
        if step > 1:
            remarks.add("numbers-with-step", name=name, step=step)
        if not self.images.numbers and len(self.images.files) > 1 and not pictures_in(name):
            remarks.add("without-numbers", name=name, file=first)
        if pictures[1:]:
            remarks.add("several-layers", file=first, pictures=", ".join(pictures))
        if self._is_linear and self._reading.upright and self._reading.view == "none":
            remarks.add("linear-light", file=first)
        remarks.take(self._untaggable)
        if self._holds_more:
            remarks.add("several-pictures", file=first)
        if names:
            listed = ", ".join(names[:4]) + (f" and {len(names) - 4} more" if len(names) > 4 else "")
            remarks.add("channels-left-out", file=first, channels=listed)
        return remarks

    def __iter__(self) -> Iterator[Frame]:
        """Yield the images as frames, from the one given to `begin_at` on; each is read when it is due."""
        for number in range(self._first, len(self.images.files)):
            path = self.images.files[number]
            image = self._read(path)
            if (image.shape, image.dtype) != self._kind:
                raise InputError(
                    f"{path} ({view(image).describe()}) is unlike {self._described}; make all images one size and type."
                )
            ends_gap = number > 0 and self._places[number] - self._places[number - 1] > 1
            original = None if self._reading.upright else path
            yield Frame(image, self._time_of(number), 1 / self.info.rate, original, ends_gap=ends_gap)

    def frame_times(self) -> Sequence[Fraction]:
        """Return the times of all frames, seconds, without reading any."""
        return [self._time_of(number) for number in range(len(self._places))]

    def begin_at(self, number: int) -> None:
        """Begin iterating at an image, counted from 0; raise `InputError` if there is none."""
        if number >= len(self.images.files):
            raise InputError(f"{self.info.name} has {len(self.images.files)} images, and none has the number {number}.")
        self._first = number

    def _time_of(self, number: int) -> Fraction:
        """Return the time of an image, counted from 0, seconds."""
        return (self._places[number] - self._places[0]) / self.info.rate

    def _read(self, path: Path) -> Image | LayeredImage:
        """Read an image with the layers or the view transform that are asked for."""
        if self._passes.layers:
            return self._passes.read(path, self._limit)
        image = read_image(path, self._limit, upright=self._reading.upright)
        if self._is_linear and self._reading.view == "srgb":
            return displayed_colours(image)
        return LayeredImage(image, ()) if self._is_linear and self._reading.linear else image

    def keep(self, first: int, last: int | None) -> None:
        """Restrict the source to the images from `first` up to, not including, `last`; None for the end.

        Images are counted from 0; with `fill_gaps`, their numbers are, from the first one. Raises `InputError` if none
        is left. See `fpsboost.derived_sources.trim_source`.
        """
        kept = [index for index, place in enumerate(self._places) if first <= place and (last is None or place < last)]
        if not kept:
            reason = "ends before `start`" if first > self._places[-1] else "has none between `start` and `end`"
            raise InputError(f"{self.info.name} has {len(self.images.files)} images and {reason}; name an earlier one.")
        part = slice(kept[0], kept[-1] + 1)
        self._places = self._places[part]
        files = self.images.files[part]
        numbers = self.images.numbers[part]
        self.images = replace(self.images, files=files, numbers=numbers, skipped=kept[0])
        self.info = replace(self.info, frame_count=len(files), duration=self._duration(self.info.rate))


def _check_gaps(path: str, sequence: NumberedImages) -> None:
    """Raise `OptionError` if images without numbers are to get gaps filled, `InputError` for too large a gap."""
    if not sequence.numbers:
        raise OptionError(f"`fill_gaps` goes by numbers, and the images of {path} have none; leave it out.")
    for (file, number), (next_file, following) in pairwise(zip(sequence.files, sequence.numbers, strict=True)):
        if following - number > MAX_GAP:
            raise InputError(
                f"{following - number - 1} images are missing between {file} and {next_file.name}, and `fill_gaps` "
                f"makes {MAX_GAP - 1} at most; choose one sequence, or number the images anew."
            )


def _without_moved(sequence: NumberedImages) -> NumberedImages:
    """Return the images without those that an interrupted run in place has begun to move among them."""
    if sequence.numbering is None:
        return sequence
    moved = set(names_to_move(hidden_place(sequence.numbering.folder, sequence.numbering.pattern)))
    pairs = zip(sequence.numbers, sequence.files, strict=True)
    return NumberedImages.numbered(sequence.numbering, [pair for pair in pairs if pair[1].name not in moved])


def is_pattern(path: str) -> bool:
    """Return whether a path stands for several images: for a pair (see `pictures_in`), or for numbered ones.

    Its last component tells: ``%04d`` and two or more ``#`` do, unless it ends like a video or with a slash. A lone
    ``%d`` or ``#`` does where it ends like an image, so that ``take #2.mp4`` and ``100%done.mkv`` stay file names.
    """
    name = Path(path).name
    place = find_placeholder(name)
    if place is None or path.endswith(("/", os.sep)):
        return bool(pictures_in(path))
    extension = extension_of(name)
    return extension in IMAGE_SUFFIXES or (place[0] not in ("%d", "#") and extension not in VIDEO_SUFFIXES)


def pictures_in(path: str) -> list[Path]:
    """Return the two images that a text names with a comma between them, ``a.png,b.png``; none if it does not."""
    for comma in re.finditer(",", path):
        pair = [Path(path[: comma.start()]), Path(path[comma.end() :])]
        if all(extension_of(each.name) in IMAGE_SUFFIXES and each.is_file() for each in pair):
            return pair
    return []


def image_names(folder: Path) -> list[str]:
    """Return the names of the images in a folder, without hidden ones."""
    return [name for name in list_files(folder) if extension_of(name) in IMAGE_SUFFIXES and not name.startswith(".")]


def find_images(path: str) -> NumberedImages:
    """Find the images of a folder or a pattern, some of which may be missing; raise `InputError` if there is none."""
    place = Path(path)
    if place.is_dir():
        names = image_names(place)
        if not names:
            lack = f"holds no images ({', '.join(IMAGE_SUFFIXES)})" if any(place.iterdir()) else "is empty"
            if any(extension_of(name) in VIDEO_SUFFIXES for name in list_files(place)):
                raise InputError(f"{place} is a folder of videos; name these: fpsboost {place / '*'} FOLDER.")
            raise InputError(f"{place} {lack}; name a folder that holds images.")
        return order_names(place, names)
    if pair := pictures_in(path):
        return NumberedImages(pair)
    if is_pattern(path):
        return find_numbered(Numbering.parse(path))
    what = "is a single file; give a folder of images or a pattern like shot_####.png."
    raise InputError(f"{path} {what if place.exists() else 'does not exist; check the path.'}")


def find_numbers(path: str) -> range | None:
    """Find the numbers of images where they rise by one step; None where there are none, or no images."""
    if not Path(path).is_dir() and (Path(path).is_file() or not is_pattern(path)):
        return None
    sequence = find_images(path)
    if not sequence.numbers or sequence.missing(sequence.step):
        return None
    return range(sequence.numbers[0], sequence.numbers[-1] + 1, sequence.step)
