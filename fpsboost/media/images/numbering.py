"""Which paths stand for numbered images, and which images of a folder are one sequence."""

from __future__ import annotations

import os
from pathlib import Path

from fpsboost.errors import InputError
from fpsboost.media.images.files import IMAGE_SUFFIXES, extension_of
from fpsboost.media.video.encoding import VIDEO_SUFFIXES
from fpsboost.sequence import Numbering, find_placeholder, list_files, order_names


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


def scan_folder(folder: Path) -> tuple[list[Path], Numbering | None]:
    """Find the one sequence in a folder; images without any number in their names go by the alphabet.

    Returns
    -------
    list of Path, Numbering or None
        The images in order, and how they are named; None where the names have no numbers.

    Raises
    ------
    InputError
        No images, several sequences, numbers of different widths, or a gap.
    OSError
        The folder cannot be read.
    """
    names = [name for name in list_files(folder) if extension_of(name) in IMAGE_SUFFIXES and not name.startswith(".")]
    if not names:
        raise InputError(f"{folder} holds no images ({', '.join(IMAGE_SUFFIXES)}); name a folder that does.")
    return order_names(folder, names)
