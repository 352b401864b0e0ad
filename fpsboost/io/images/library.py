"""OpenImageIO, the library of images: the only place that imports it."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from fpsboost.errors import InputError, explained


def image_library() -> Any:
    """Return OpenImageIO with one thread, as conversions work on several frames at a time already."""
    import OpenImageIO  # noqa: PLC0415  # only who has images waits for it

    OpenImageIO.attribute("threads", 1)
    return OpenImageIO


@contextmanager
def opened(path: Path) -> Iterator[tuple[Any, Any]]:
    """Open an image while the block lasts, its alpha as it is stored; yield the file and what its header says.

    Raises
    ------
    InputError
        It cannot be read, or is damaged.
    """
    with explained(InputError, "read", path, "check that it exists and that you may read it"):
        path.open("rb").close()
    library = image_library()
    hints = library.ImageSpec()
    hints.attribute("oiio:UnassociatedAlpha", 1)
    file = library.ImageInput.open(str(path), hints)
    if file is None:
        library.geterror()  # which is kept until it is read
        raise damaged(path)
    try:
        yield file, file.spec()
    finally:
        file.close()


def damaged(path: Path) -> InputError:
    """Return the error to raise for a file that cannot be decoded."""
    return InputError(f"{path} is damaged or no image; replace it.")
