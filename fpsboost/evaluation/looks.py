"""What stands for a method in every figure: a colour that hangs on its name alone, a mark and a kind of line.

A page is read beside others, so a method has the same colour in all of them, whoever else takes part. Those that are
compared most have colours that are told apart with any colour vision; any other method, one with options or another
tool gets one of many by a checksum of its name. Colours are not enough, as two of many may be alike: up to nine methods
of a page have marks of their own, and lines are solid for methods as they are, dashed for those with options, and
dashed and dotted for other tools.
"""

from __future__ import annotations

import math
import re
import zlib
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from fpsboost.evaluation.making import known_methods

MARKERS = ("o", "s", "^", "D", "v", "p", "h", "*", "X")
"""Matplotlib's names; the page has the same shapes under the same numbers."""

SOLID: Any = "solid"
DASHED: Any = (0, (5, 2))
DASH_DOTTED: Any = (0, (5, 1.6, 1, 1.6))

NAMED = {
    "nlm": ("#1e3f97", "#75cdff"),
    "nlm-fast": ("#e17312", "#de6f10"),
    "dis": ("#5d9563", "#78b17d"),
    "minterpolate": ("#ae548d", "#be6199"),
    "blend": ("#604b08", "#f3d078"),
    "nlm-exhaustive": ("#399dba", "#46a5c5"),
    "nlm-brute-force": ("#673225", "#a37f4e"),
    "nearest": ("#464153", "#bbcfd7"),
}
"""Colours on light and on dark paper of the methods that are compared most.

Found by a search for those that differ most in CIELAB, with full colour vision and without any one kind of cone: by 26
and more among the first five, which are compared by default, and by 15 and more among all.
"""

HUES = 12
LIGHTNESSES = ((0.44, 0.86), (0.53, 0.77), (0.62, 0.68))
"""Of the colours for all others, in OKLCH, on light and on dark paper: each with a contrast of 3 at least."""

COLOURS = HUES * len(LIGHTNESSES)

CHROMA = 0.13

MAX_LINE = 16
"""Letters of a long name that stand side by side where there is little room."""


class Look(NamedTuple):
    """How a method is drawn."""

    on_light: str
    on_dark: str
    """Colours, ``#rrggbb``."""
    mark: int
    """Place in `MARKERS`."""
    line: Any
    """Matplotlib's line style."""


def looks_of(names: Sequence[str]) -> list[Look]:
    """Return how each of the methods of a page is drawn.

    Examples
    --------
    >>> looks_of(["nlm", "dis"])[1] == looks_of(["blend", "nearest", "dis"])[2]
    True
    """
    known = known_methods()
    taken: list[int] = []
    looks = []
    for name in names:
        base, options, _ = name.partition(":")
        line = DASH_DOTTED if base not in known else DASHED if options else SOLID
        place = [*NAMED].index(name) if name in NAMED else _checksum(name) // COLOURS
        free = [mark for mark in range(len(MARKERS)) if mark not in taken] or list(range(len(MARKERS)))
        mark = place % len(MARKERS)
        if mark not in free:
            mark = free[place % len(free)]
        taken.append(mark)
        looks.append(Look(*colours_of(name), mark, line))
    return looks


def break_name(name: str) -> list[str]:
    """Break a long name into lines behind its punctuation.

    Examples
    --------
    >>> break_name("nlm-exhaustive:patch-radius=9,v=0.05")
    ['nlm-exhaustive:', 'patch-radius=9,', 'v=0.05']
    """
    lines = [""]
    for part in re.findall(r"[^:,]*[:,]|[^:,]+", name):
        if lines[-1] and len(lines[-1]) + len(part) > MAX_LINE:
            lines.append("")
        lines[-1] += part
    return lines


def colours_of(name: str) -> tuple[str, str]:
    """Return the colours of a method on light and on dark paper."""
    if name in NAMED:
        return NAMED[name]
    lightness, hue = divmod(_checksum(name) % COLOURS, HUES)
    on_light, on_dark = (from_oklch(each, CHROMA, 2 * math.pi * hue / HUES) for each in LIGHTNESSES[lightness])
    return on_light, on_dark


def _checksum(name: str) -> int:
    """Return a checksum that does not depend on the order of the options."""
    base, colon, options = name.partition(":")
    return zlib.crc32(f"{base}{colon}{','.join(sorted(options.split(',')))}".encode())


def from_oklch(lightness: float, chroma: float, hue: float) -> str:
    """Convert a colour of OKLCH (Ottosson 2020) to sRGB, with less chroma where sRGB has not as much.

    Parameters
    ----------
    lightness : float
        0 to 1.
    chroma : float
    hue : float
        Radians.

    Examples
    --------
    >>> from_oklch(1, 0, 0), from_oklch(0, 0, 0)
    ('#ffffff', '#000000')
    """
    lab = np.array([lightness, chroma * math.cos(hue), chroma * math.sin(hue)])
    to_cones = np.array(
        [[1, 0.3963377774, 0.2158037573], [1, -0.1055613458, -0.0638541728], [1, -0.0894841775, -1.291485548]]
    )
    to_linear = np.array(
        [
            [4.0767416621, -3.3077115913, 0.2309699292],
            [-1.2684380046, 2.6097574011, -0.3413193965],
            [-0.0041960863, -0.7034186147, 1.707614701],
        ]
    )
    linear = to_linear @ (to_cones @ lab) ** 3
    if chroma > 0 and (linear.min() < 0 or linear.max() > 1):
        return from_oklch(lightness, max(0.0, chroma - 0.005), hue)
    linear = linear.clip(0, 1)
    values = np.where(linear <= 0.0031308, 12.92 * linear, 1.055 * linear ** (1 / 2.4) - 0.055)
    return "#" + "".join(f"{round(255 * float(value)):02x}" for value in values)
