"""Results that appear under their name whole or not at all."""

from __future__ import annotations

import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from fpsboost.errors import OutputError


@contextmanager
def appearing(path: Path) -> Iterator[Path]:
    """Give the place where a file or folder is to be written; it gets its name when that is done.

    Parameters
    ----------
    path : Path
        Its name, which is not taken.

    Raises
    ------
    OutputError
        It cannot be written.
    """
    unfinished = path.with_name(f".unfinished-{path.name[-50:]}")  # the ending stays: it may say the format
    try:
        yield unfinished
        unfinished.replace(path)
    except OSError as error:
        raise OutputError(f"{path} cannot be written ({error.strerror}); choose another place.") from None
    finally:
        if unfinished.is_dir():
            shutil.rmtree(unfinished, ignore_errors=True)
        elif unfinished.exists():
            unfinished.unlink()
