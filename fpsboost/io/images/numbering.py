"""Which paths stand for numbered images, and which images of a folder are one sequence."""

from __future__ import annotations

import os
from pathlib import Path

from fpsboost.errors import InputError
from fpsboost.io.images.files import IMAGE_SUFFIXES, extension_of
from fpsboost.io.images.sequence import (
    FileSequence,
    Numbering,
    find_numbered,
    find_placeholder,
    list_files,
    order_names,
)
from fpsboost.io.video.encoding import VIDEO_SUFFIXES


def is_pattern(path: str) -> bool:
    """Say whether a path stands for numbered images, by its last component alone.

    ``%04d`` and two or more ``#`` do, unless the name ends like a video or with a slash. A lone ``%d`` or ``#`` does
    where it ends like an image, so that ``take #2.mp4`` and ``100%done.mkv`` stay file names.

    Examples
    --------
    >>> is_pattern("render/shot_%04d.png"), is_pattern("shot_####.png"), is_pattern("shot_####/0001.png")
    (True, True, False)
    """
    name = Path(path).name
    place = find_placeholder(name)
    if place is None or path.endswith(("/", os.sep)):
        return False
    extension = extension_of(name)
    return extension in IMAGE_SUFFIXES or (place[0] not in ("%d", "#") and extension not in VIDEO_SUFFIXES)


def find_images(path: str) -> FileSequence:
    """Find the images that a folder or a pattern stands for, some of which may be missing.

    Raises
    ------
    InputError
        As `scan_folder`; or the path is neither, or nothing is named like the pattern.
    OSError
        The folder cannot be read.
    """
    place = Path(path)
    if place.is_dir():
        return scan_folder(place)
    if is_pattern(path):
        return find_numbered(Numbering.parse(path))
    if place.exists():
        raise InputError(f"{path} is a single file; give a folder of images or a pattern like shot_####.png.")
    raise InputError(f"{path} does not exist; check the path.")


def find_numbers(path: str) -> range | None:
    """Find the numbers of images where they rise by one step; None where there are none, or no images.

    Raises
    ------
    InputError
        As `find_images`.
    OSError
        The folder cannot be read.
    """
    if not Path(path).is_dir() and (Path(path).is_file() or not is_pattern(path)):
        return None
    found = find_images(path)
    if not found.numbers or found.missing(found.step):
        return None
    return range(found.numbers[0], found.numbers[-1] + 1, found.step)


def scan_folder(folder: Path) -> FileSequence:
    """Find the one sequence in a folder; images without any number in their names go by the alphabet.

    Returns
    -------
    FileSequence

    Raises
    ------
    InputError
        No images, several sequences, or numbers of different widths.
    OSError
        The folder cannot be read.
    """
    names = [name for name in list_files(folder) if extension_of(name) in IMAGE_SUFFIXES and not name.startswith(".")]
    if not names:
        raise InputError(f"{folder} holds no images ({', '.join(IMAGE_SUFFIXES)}); name a folder that does.")
    return order_names(folder, names)
