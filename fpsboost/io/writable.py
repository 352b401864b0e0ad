"""Check that a file can be written under a path, before any work is done."""

from __future__ import annotations

import os
from collections.abc import Collection
from pathlib import Path

from fpsboost.errors import OutputError


def check_writable(path: Path, name: str, inputs: Collection[Path], overwrite: bool) -> None:
    """Raise `OutputError` unless a file can be written under this path.

    Parameters
    ----------
    path : Path
    name : str
        Name of the file in messages.
    inputs : collection of Path
        Files that are being read.
    overwrite : bool
        Allow an existing file to be replaced.
    """
    if path.is_dir():
        raise OutputError(f"{name} is a folder; name a file in it.")
    if not path.parent.is_dir():
        raise OutputError(f"{name} cannot be written because its folder does not exist; create it first.")
    if os.path.lexists(path):
        if path.exists() and not path.is_file():
            raise OutputError(f"{name} is a device or a pipe; name a file, or - for standard output.")
        if path.exists() and any(each.exists() and path.samefile(each) for each in inputs):
            raise OutputError(f"{name} is the input itself; write to another name.")
        if not overwrite:
            raise OutputError(f"{name} exists already; choose another name or pass `overwrite=True`.")
    if not os.access(path.parent, os.W_OK):
        raise OutputError(f"{name} cannot be written because its folder may not be written to; choose another folder.")
