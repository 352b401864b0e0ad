"""Sequences of numbered files: which files of a folder belong together, and in which order.

A sequence is one naming, ``prefix + number + suffix``, whose numbers rise by a constant step: 1, or that of a renderer.
"""

import math
import os
import re
from collections import defaultdict
from collections.abc import Sequence
from dataclasses import dataclass, field
from fractions import Fraction
from itertools import pairwise
from pathlib import Path
from typing import Self

from fpsboost.errors import InputError, OptionError
from fpsboost.io.images.layers import LayerNames


def find_placeholder(name: str) -> re.Match[str] | None:
    """Find the last placeholder, so that ``shot #2_####.png`` works; ``%`` takes precedence over ``#``."""
    places = list(re.finditer("%(?:0[0-9]+)?d", name)) or list(re.finditer("#+", name))
    return places[-1] if places else None


@dataclass(frozen=True, slots=True)
class Numbering:
    """Naming of the images of one sequence.

    Parameters
    ----------
    folder : Path
        Folder of the images.
    prefix : str
        Beginning of the names.
    digits : int
        Digits to which numbers are padded with zeros, and beyond which they grow; 1 for no padding.
    suffix : str
        End of the names, with the file type.
    """

    folder: Path
    prefix: str
    digits: int
    suffix: str

    @classmethod
    def parse(cls, pattern: str) -> Self:
        """Read a pattern, ``shot_%04d.png`` or ``shot_####.png``; `OptionError` without a place for a number."""
        folder = Path(pattern).parent
        name = Path(pattern).name
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
        """Return the path of the image with a number."""
        return self.folder / f"{self.prefix}{number:0{self.digits}d}{self.suffix}"

    def number_in(self, name: str, *, any_padding: bool = False) -> int | None:
        """Read the number out of a file name; None where the name is not of this naming."""
        match = re.fullmatch(f"{re.escape(self.prefix)}([0-9]+){re.escape(self.suffix)}", name)
        is_ours = match is not None and (any_padding or self.path(int(match[1])).name == name)
        return int(match[1]) if match is not None and is_ours else None

    def find(self, *, any_padding: bool = False) -> list[tuple[int, Path]]:
        """Return the files of this naming in the folder, with their numbers, in order."""
        numbers = ((self.number_in(name, any_padding=any_padding), name) for name in list_files(self.folder))
        return sorted((number, self.folder / name) for number, name in numbers if number is not None)


@dataclass(frozen=True)
class NumberedImages:
    """Files of one sequence, or those of them that are read as a clip.

    Parameters
    ----------
    files : list of Path
        Files in order, at least one.
    numbering : Numbering, optional
        Naming of the files; None if names have no numbers.
    numbers : list of int
        Their numbers, rising; empty if names have none.
    step : int
        Difference of successive numbers, where some are missing the largest that leads to all of them; 1 for a single
        image, and with `fills_gaps`.
    first_number : int
        Number of the first image of the whole sequence.
    skipped : int
        Images of the whole sequence before these.
    fills_gaps : bool
        Whether numbers are the clock, so that images may be missing.
    layers : tuple of LayerNames
        Layers of OpenEXR files that are read beside the picture.
    """

    files: list[Path]
    numbering: Numbering | None = None
    numbers: list[int] = field(default_factory=list)
    step: int = 1
    first_number: int = 1
    skipped: int = 0
    fills_gaps: bool = False
    layers: tuple[LayerNames, ...] = ()

    @classmethod
    def numbered(cls, numbering: Numbering, files: Sequence[tuple[int, Path]]) -> Self:
        """Return a whole sequence of files, at least one, of a naming with their numbers in order."""
        numbers = [number for number, _ in files]
        step = math.gcd(*(later - earlier for earlier, later in pairwise(numbers))) or 1
        return cls([path for _, path in files], numbering, numbers, step, numbers[0])

    def missing(self, step: int) -> int:
        """Return the number of files that are missing between others at a step."""
        return sum((later - earlier) // step - 1 for earlier, later in pairwise(self.numbers))

    def check_complete(self, step: int, advice: str) -> None:
        """Raise `InputError` if a file is missing; the message names the first one, and ends with `advice`."""
        missing = self.missing(step)
        if self.numbering is None or not missing:
            return
        gap = next(earlier for earlier, later in pairwise(self.numbers) if later - earlier > step)
        steps = f" (in steps of {step})" if step > 1 else ""
        more = f", and {missing - 1} more are" if missing > 1 else ""
        raise InputError(f"{self.numbering.path(gap + step)} is missing from its sequence{steps}{more}; {advice}.")

    @property
    def planes(self) -> int:
        """Number of channels of the layers that are read beside the picture."""
        return sum(len(layer.channels) for layer in self.layers)

    def numbers_for(self, factor: Fraction) -> tuple[int, int] | None:
        """Return first number and step of the output if images keep their numbers.

        `factor` is output frames per image, or per number where gaps are filled. None where they are numbered anew: the
        images have no numbers, theirs leave no room, or `factor` does not divide their step.
        """
        step = self.step / factor
        if not self.numbers or (self.step == 1 and not self.fills_gaps) or step.denominator > 1:
            return None
        return self.numbers[0], int(step)

    def output_numbers(self, factor: Fraction | None) -> tuple[int, int]:
        """Return first number and step of the output of the whole sequence; `factor` is None if none are kept."""
        kept = None if factor is None else self.numbers_for(factor)
        return kept or (self.first_number + int(self.skipped * (factor or 0)), 1)


def order_names(folder: Path, names: Sequence[str]) -> NumberedImages:
    """Put the files of one sequence, at least one, in order; names without any number go by the alphabet.

    Some numbers may be missing. `InputError` if there are several sequences, or numbers of different widths.
    """
    groups, plain = _group_names(names)
    plain_types = {f"*{os.path.splitext(name)[1]}" for name in plain}
    if len(groups) + len(plain_types) > 1:
        by_size = sorted(groups, key=lambda key: -len(groups[key]))
        patterns = [Numbering(folder, key[0], min(map(len, groups[key])), key[1]).pattern for key in by_size]
        labels = patterns + sorted(plain_types)
        listed = ", ".join(labels[:3]) + (f" and {len(labels) - 3} more" if len(labels) > 3 else "")
        advice = f"choose one with a pattern such as {folder / patterns[0]}" if patterns else "keep one type of file"
        raise InputError(f"{folder} holds several sequences of images ({listed}); {advice}.")
    if plain:
        return NumberedImages([folder / name for name in sorted(plain, key=lambda name: (name.casefold(), name))])
    (prefix, suffix), numbers = groups.popitem()
    numbering = Numbering(folder, prefix, min(map(len, numbers)), suffix)
    for name in names:
        if numbering.number_in(name) is None:
            raise InputError(
                f"{folder} holds numbers of different widths ({numbering.path(int(min(numbers, key=len))).name} and "
                f"{name}); name the frames alike, or choose some with a pattern such as {folder / numbering.pattern}."
            )
    return find_numbered(numbering)


def find_numbered(numbering: Numbering) -> NumberedImages:
    """List the existing files of a naming in the order of their numbers; `InputError` if there are none."""
    files = numbering.find()
    if not files:
        raise InputError(f"No image is named like {numbering.folder / numbering.pattern}; check the pattern.")
    return NumberedImages.numbered(numbering, files)


def list_files(folder: Path) -> list[str]:
    """Return names of the files in a folder, without folders, by the alphabet."""
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
