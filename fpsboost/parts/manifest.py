"""Manifest of a part: the job that it belongs to, what it holds, and what to know of it to join it with the others."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Self

from fpsboost.errors import InputError, explained
from fpsboost.io.part import Part
from fpsboost.io.staging import write_safely
from fpsboost.io.trim import Window
from fpsboost.io.video.decode_options import DecodeOptions
from fpsboost.io.video.encode_options import Encoding
from fpsboost.observer import LowestMatch, SourceMoment
from fpsboost.parts.stored_options import as_json, from_json
from fpsboost.timing.rate import FrameIntervals, OutputRate

MANIFEST_NAME = "part.json"
FORMAT = 2
"""Version of the manifest's fields."""


@dataclass(frozen=True)
class StoredFile:
    """File of a part: name, size in bytes, and SHA-256 of its content in hexadecimal digits."""

    name: str
    size: int
    sha256: str


@dataclass(frozen=True)
class Manifest:
    """What is known of a part.

    Attributes
    ----------
    part : Part
    input, output : str
        Paths of the whole conversion; the input's is absolute.
    rate, decoding, encoding
        Options of the conversion that matter for joining.
    facts : dict of str to str
        Everything that must be the same for all parts.
    first : int
        Number of the part's first frame in the output, counted from 0.
    frames, frames_made : int
        Number of frames in the part, and of those that are not from the source.
    frames_read : int
        Number of source frames from the clip's first one to the last one that was read.
    scene_cuts, duplicates, lowest_match
        See `fpsboost.observer.Summary`.
    begins, ends : SourceMoment or None
        Frames of the source at or before the first output frame of the part, and of the next one.
    counts_frames : bool
        Whether the numbers of the source's frames shape the output, so that boundaries must agree on them.
    window : Window or None
        See `fpsboost.io.output.Output`.
    intervals : FrameIntervals
    remarks : list of str
    files : list of StoredFile
    """

    part: Part
    input: str
    output: str
    rate: OutputRate
    decoding: DecodeOptions
    encoding: Encoding
    facts: dict[str, str]
    first: int
    frames: int
    frames_made: int
    frames_read: int
    scene_cuts: int
    duplicates: int
    begins: SourceMoment | None
    ends: SourceMoment | None
    counts_frames: bool
    window: Window | None
    intervals: FrameIntervals
    lowest_match: LowestMatch | None
    remarks: list[str] = field(default_factory=list)
    files: list[StoredFile] = field(default_factory=list)

    def write(self, folder: Path) -> None:
        """Write the manifest into the folder of its part.

        Raises
        ------
        OSError
        """
        text = json.dumps({"format": FORMAT, **as_json(self)}, indent=1)
        write_safely(folder / MANIFEST_NAME, text.encode())

    @classmethod
    def read(cls, folder: Path) -> Self:
        """Read the manifest of a part.

        Raises
        ------
        InputError
            There is none, it is damaged, or it was written by another version.
        """
        advice = "make this part again"
        with explained(InputError, "read", folder / MANIFEST_NAME, advice):
            data = (folder / MANIFEST_NAME).read_bytes()
        try:
            values: dict[str, Any] = json.loads(data)
            if values.pop("format") != FORMAT:
                raise InputError(f"{folder} was made by another version of fpsboost; {advice}.")
            manifest: Self = from_json(cls, values)
        except (ValueError, TypeError, KeyError, AttributeError):
            raise InputError(f"{folder / MANIFEST_NAME} is damaged; {advice}.") from None
        return manifest


def stored(path: Path) -> StoredFile:
    """Return name, size and hash of a file.

    Raises
    ------
    OSError
    """
    with path.open("rb") as file:
        return StoredFile(path.name, path.stat().st_size, hashlib.file_digest(file, "sha256").hexdigest())


def first_difference(facts: Mapping[str, str], others: Mapping[str, str]) -> str | None:
    """Return the name of the first fact that differs, as words; None if none does."""
    for key in [*facts, *(key for key in others if key not in facts)]:
        if facts.get(key) != others.get(key):
            return key.rpartition(".")[2].replace("_", " ")
    return None
