"""Parts of a conversion, which are made one by one and joined afterwards."""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path

from fpsboost.errors import OptionError

MAX_PARTS = 9999


@dataclass(frozen=True)
class Part:
    """One of the parts that a conversion is cut into.

    Parameters
    ----------
    number, count : int
        The part's number, counted from 1, and how many there are.

    Raises
    ------
    OptionError
        There is no such part.

    Examples
    --------
    >>> str(Part(3, 8))
    '3/8'
    """

    number: int
    count: int

    def __post_init__(self) -> None:
        if not 1 <= self.count <= MAX_PARTS:
            raise OptionError(f"`chunk={self}` must have 1 to {MAX_PARTS} parts; write it like 3/8.")
        if not 1 <= self.number <= self.count:
            raise OptionError(f"`chunk={self}` does not exist; parts are numbered from 1 to {self.count}.")

    def __str__(self) -> str:
        return f"{self.number}/{self.count}"


def parse_part(text: str, option: str = "`chunk`") -> Part:
    """Parse the number of a part and how many there are; messages name it by `option`.

    Raises
    ------
    OptionError
        The text is not of the form K/N, or there is no such part.

    Examples
    --------
    >>> parse_part("3/8")
    Part(number=3, count=8)
    """
    found = re.fullmatch(r"([0-9]{1,9})/([0-9]{1,9})", text.strip())
    if found is None:
        raise OptionError(f"{option} {text!r} is no part of a whole; write it like 3/8 for the third of eight.")
    return Part(int(found[1]), int(found[2]))


def part_folder(output: str, part: Part) -> Path:
    """Return the folder of a part: beside the output, in a folder of the output's name with ``.parts`` behind it.

    Examples
    --------
    >>> part_folder("films/out.mp4", Part(3, 8)).as_posix()
    'films/out.mp4.parts/0003-of-0008'
    """
    whole = Path(output)
    return whole.parent / f"{whole.name}.parts" / f"{part.number:04d}-of-{part.count:04d}"
