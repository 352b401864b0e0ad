"""OpenImageIO, the library that reads images, and the properties of a file that Pillow reads beside it."""

import os
import struct
import warnings
from collections.abc import Iterator
from contextlib import closing, contextmanager
from pathlib import Path
from typing import Any

from fpsboost.errors import InputError, explained


def image_library() -> Any:
    """Return OpenImageIO with one thread, as conversions work on several frames at a time already."""
    import OpenImageIO  # noqa: PLC0415  # only who has images waits for it

    OpenImageIO.attribute("threads", 1)
    return OpenImageIO


@contextmanager
def name_for_libraries(path: Path) -> Iterator[str]:
    """Yield a name of a file that the libraries take while the block lasts: Linux has names that are no UTF-8."""
    with explained(InputError, "read", path, "check that it exists and that you may read it"):
        file = path.open("rb")
    with file:
        is_text = str(path).encode(errors="replace") == os.fsencode(path)
        yield str(path) if is_text else f"/proc/self/fd/{file.fileno()}"


@contextmanager
def opened(path: Path) -> Iterator[tuple[Any, Any]]:
    """Open an image while the block lasts, its alpha as it is stored; yield OpenImageIO's file and header."""
    library = image_library()
    hints = library.ImageSpec()
    hints.attribute("oiio:UnassociatedAlpha", 1)
    with name_for_libraries(path) as name:
        file = library.ImageInput.open(name, hints)
        if file is None:
            if "ubsampled" in library.geterror():  # of OpenEXR
                raise InputError(f"{path} has channels with fewer pixels than the image; save it as RGB or gray.")
            raise damaged(path)
        with closing(file):
            yield file, file.spec()


def said_by_pillow(path: Path) -> dict[Any, Any]:
    """Return Pillow's information of a file, such as its EXIF and XMP as they are stored; empty if it cannot read it.

    Pillow refuses images of more than 179 million pixels, which are then read without EXIF and XMP.
    """
    from PIL import Image  # noqa: PLC0415

    try:
        with warnings.catch_warnings(action="ignore"), Image.open(path) as image:  # of EXIF that is damaged
            return dict(image.info)
    except (
        *(ArithmeticError, LookupError, OSError, SyntaxError, TypeError, ValueError, struct.error),
        Image.DecompressionBombError,
    ):
        return {}


def damaged(path: Path) -> InputError:
    """Return the error to raise for a file that cannot be decoded."""
    return InputError(f"{path} is damaged or no image; replace it.")
