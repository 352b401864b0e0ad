"""The folders of a round trip, and the frames in them."""

from __future__ import annotations

import re
import shutil
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

from .errors import RoundTripError


@dataclass(frozen=True)
class Folders:
    """The folders of a round trip, all in the one that the user chose."""

    base: Path

    @property
    def renders(self) -> Path:
        """Every N-th frame, as Blender rendered it."""
        return self.base / "renders"

    @property
    def made(self) -> Path:
        """All frames: the rendered ones, and those made between them."""
        return self.base / "made"

    @property
    def confidence(self) -> Path:
        """A gray image per made frame; white is certain."""
        return self.base / "confidence"

    @property
    def plan(self) -> Path:
        """Which regions to render, as fpsboost planned them."""
        return self.base / "plan"

    @property
    def regions(self) -> Path:
        """The planned regions, as Blender rendered them."""
        return self.base / "regions"

    @property
    def merged(self) -> Path:
        """All frames, with the rendered regions in them."""
        return self.base / "merged"


def unfinished(folder: Path) -> Path:
    """Return the folder that a command writes instead, which `replace_folder` then puts in its place.

    Examples
    --------
    >>> unfinished(Path("trip", "plan")).name
    'plan-unfinished'
    """
    return folder.with_name(folder.name + "-unfinished")


def remove_unfinished(folder: Path) -> None:
    """Remove what a run that was interrupted has left of a folder."""
    shutil.rmtree(unfinished(folder), ignore_errors=True)


def replace_folder(folder: Path) -> None:
    """Put the finished output of a command in the place of that of an earlier round."""
    try:
        unfinished(folder).stat()  # it must be there before anything is removed
        if folder.exists():
            shutil.rmtree(folder)
        unfinished(folder).rename(folder)
    except OSError as error:
        raise RoundTripError(
            f"{folder} cannot be replaced ({error.strerror}); close what uses it and rename {unfinished(folder)}."
        ) from error


def numbered_files(folder: Path, suffix: str) -> dict[int, Path]:
    """Return the files of a folder, which may be missing, whose names end with a number, by that number, in its order.

    Examples
    --------
    >>> numbered_files(Path("no such folder"), ".exr")
    {}
    """
    return dict(sorted(_numbered(folder, suffix)))


def _numbered(folder: Path, suffix: str) -> Iterator[tuple[int, Path]]:
    if folder.is_dir():
        for path in folder.iterdir():
            number = re.search(r"\d+$", path.stem)
            if path.suffix.lower() == suffix and number:
                yield int(number[0]), path


def check_renders(folder: Path, frames: Sequence[int]) -> None:
    """Raise `RoundTripError` unless a folder holds these frames as OpenEXR, and no others."""
    present = numbered_files(folder, ".exr")
    missing = [frame for frame in frames if frame not in present]
    if missing:
        raise RoundTripError(f"{folder} lacks {_counted(missing)}; render the animation first.")
    surplus = sorted(present.keys() - set(frames))
    if surplus:
        raise RoundTripError(
            f"{folder} also holds {_counted(surplus)}, not of this frame range and step; move the old ones away."
        )


def _counted(frames: Sequence[int]) -> str:
    """Return which frames are meant: ``frame 3``, ``4 frames, the first of them 3``."""
    return f"frame {frames[0]}" if len(frames) == 1 else f"{len(frames)} frames, the first of them {frames[0]}"
