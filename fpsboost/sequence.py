"""Which files of a folder are one sequence, and in which order.

A sequence is one naming, ``prefix + number + suffix``, with consecutive numbers.
"""

from __future__ import annotations

import itertools
import os
import re
from collections import defaultdict
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Self

from fpsboost.errors import InputError, OptionError


def find_placeholder(name: str) -> re.Match[str] | None:
    """The last one counts, so that ``shot #2_####.png`` works; ``%`` goes before ``#``."""
    found = list(re.finditer("%(?:0[0-9]+)?d", name)) or list(re.finditer("#+", name))
    return found[-1] if found else None


@dataclass(frozen=True, slots=True)
class Numbering:
    """How the images of one sequence are named.

    Attributes
    ----------
    folder : Path
    prefix : str
        What stands before the number.
    digits : int
        Numbers are padded with zeros to this width, and grow beyond it; 1 for no padding.
    suffix : str
        What stands behind the number, with the file type: ``.png``, ``_left.png``.
    """

    folder: Path
    prefix: str
    digits: int
    suffix: str

    @classmethod
    def parse(cls, pattern: str) -> Self:
        """Read a pattern, ``shot_%04d.png`` or ``shot_####.png``.

        Raises
        ------
        OptionError
            There is no place for a number in the last component.

        Examples
        --------
        >>> Numbering.parse("shot_##.png").path(7).name
        'shot_07.png'
        """
        folder, name = Path(pattern).parent, Path(pattern).name
        place = find_placeholder(name)
        if place is None:
            raise OptionError(f"{pattern} has no place for a number; write one like shot_%04d.png or shot_####.png.")
        digits = len(place[0]) if place[0][0] == "#" else int(place[0][1:-1] or 1)
        return cls(folder, name[: place.start()], max(digits, 1), name[place.end() :])

    @property
    def pattern(self) -> str:
        """The naming as a user would write it, without the folder."""
        return f"{self.prefix}{'#' * self.digits}{self.suffix}"

    def path(self, number: int) -> Path:
        """Name the image of this number."""
        return self.folder / f"{self.prefix}{number:0{self.digits}d}{self.suffix}"

    def number_in(self, name: str, *, any_padding: bool = False) -> int | None:
        """Read the number out of a file name; None where the name is not of this naming."""
        found = re.fullmatch(f"{re.escape(self.prefix)}([0-9]+){re.escape(self.suffix)}", name)
        if found is None or not (any_padding or self.path(int(found[1])).name == name):
            return None
        return int(found[1])

    def find(self, *, any_padding: bool = False) -> list[tuple[int, Path]]:
        """List the existing images of this naming with their numbers, in the order of the numbers.

        Raises
        ------
        OSError
            The folder cannot be read.
        """
        numbers = ((self.number_in(name, any_padding=any_padding), name) for name in list_files(self.folder))
        return sorted((number, self.folder / name) for number, name in numbers if number is not None)


def order_names(folder: Path, names: Sequence[str]) -> tuple[list[Path], Numbering | None]:
    """Put the files of one sequence in order; names without any number go by the alphabet.

    Parameters
    ----------
    folder : Path
    names : sequence of str
        At least one.

    Returns
    -------
    list of Path, Numbering or None
        The files in order, and how they are named; None where the names have no numbers.

    Raises
    ------
    InputError
        Several sequences, numbers of different widths, or a gap.
    OSError
        The folder cannot be read.
    """
    groups, plain = _group_names(names)
    plain_types = {f"*{os.path.splitext(name)[1]}" for name in plain}
    if len(groups) + len(plain_types) > 1:
        raise _several_sequences(folder, groups, plain_types)
    if plain:
        return [folder / name for name in sorted(plain, key=lambda name: (name.casefold(), name))], None
    (prefix, suffix), numbers = groups.popitem()
    numbering = Numbering(folder, prefix, min(map(len, numbers)), suffix)
    for name in names:
        if numbering.number_in(name) is None:
            raise InputError(
                f"{folder} holds numbers of different widths ({numbering.path(int(min(numbers, key=len))).name} and "
                f"{name}); name the frames alike, or choose some with a pattern such as {folder / numbering.pattern}."
            )
    return find_without_gap(numbering), numbering


def find_without_gap(numbering: Numbering) -> list[Path]:
    """List the existing images of a naming in the order of their numbers.

    Raises
    ------
    InputError
        There are none, or one is missing between two others.
    OSError
        The folder cannot be read.
    """
    found = numbering.find()
    if not found:
        raise InputError(f"No image is named like {numbering.folder / numbering.pattern}; check the pattern.")
    for expected, (number, _) in zip(itertools.count(found[0][0]), found, strict=False):
        if number != expected:
            raise InputError(
                f"{numbering.path(expected)} is missing from its sequence; add it, or renumber the images without gaps."
            )
    return [path for _, path in found]


def list_files(folder: Path) -> list[str]:
    """Names of the files in a folder, without folders, by the alphabet.

    Raises
    ------
    OSError
        The folder cannot be read.
    """
    with os.scandir(folder) as entries:
        return sorted(entry.name for entry in entries if entry.is_file())


def _group_names(names: Sequence[str]) -> tuple[dict[tuple[str, str], list[str]], list[str]]:
    """Sort names into sequences: numbers by (prefix, suffix), and the names that have no number.

    Of several numbers in a name the frame number is the only one that changes, else the last:
    ``shot2_0001_v3.png`` next to ``shot2_0002_v3.png``.
    """
    alike: dict[tuple[str, ...], list[list[str]]] = defaultdict(list)
    plain = []
    for name in names:
        stem, extension = os.path.splitext(name)
        parts = re.split("([0-9]+)", stem)
        if len(parts) == 1:
            plain.append(name)
        else:
            parts[-1] += extension
            alike[tuple(parts[::2])].append(parts)
    groups: dict[tuple[str, str], list[str]] = defaultdict(list)
    for rows in alike.values():
        changing = [i for i in range(1, len(rows[0]), 2) if len({row[i] for row in rows}) > 1]
        place = changing[0] if len(changing) == 1 else len(rows[0]) - 2
        for row in rows:
            groups["".join(row[:place]), "".join(row[place + 1 :])].append(row[place])
    return groups, plain


def _several_sequences(folder: Path, groups: dict[tuple[str, str], list[str]], plain: set[str]) -> InputError:
    by_size = sorted(groups, key=lambda key: -len(groups[key]))
    patterns = [Numbering(folder, key[0], min(map(len, groups[key])), key[1]).pattern for key in by_size]
    labels = patterns + sorted(plain)
    listed = ", ".join(labels[:3]) + (f" and {len(labels) - 3} more" if len(labels) > 3 else "")
    advice = f"choose one with a pattern such as {folder / patterns[0]}" if patterns else "keep one type of file"
    return InputError(f"{folder} holds several sequences of images ({listed}); {advice}.")
