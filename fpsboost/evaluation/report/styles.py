"""Colour, marker and line of a method in every figure.

Pages are compared with each other, so a method has the same colour in all of them, whichever others take part. Methods
that are compared most have colours that can be distinguished with any colour vision; any other method, one with options
or another tool gets one of many by a checksum of its name. Colours are not enough, as two of many may be alike: up to
nine methods of a page have markers of their own, and lines are solid for methods with default options, dashed for those
with other options, and dash-dotted for other tools.
"""

import re
import zlib
from collections.abc import Sequence
from typing import NamedTuple

from fpsboost.evaluation.compared_methods import method_names

MARKS = 9
"""Number of shapes of marks, which the page defines as ``#mark-0`` and so on."""

SOLID = "none"
DASHED = "8 3.2"
"""Value of ``stroke-dasharray`` in SVG."""
DASH_DOTTED = "8 2.6 1.6 2.6"
"""Value of ``stroke-dasharray`` in SVG."""

NAMED = {
    "nlm": ("#1e3f97", "#75cdff"),
    "nlm-fast": ("#e17312", "#de6f10"),
    "dis": ("#5d9563", "#78b17d"),
    "minterpolate": ("#ae548d", "#be6199"),
    "blend": ("#604b08", "#f3d078"),
    "nlm-exhaustive": ("#399dba", "#46a5c5"),
    "nlm-brute-force": ("#673225", "#a37f4e"),
    "nearest": ("#464153", "#bbcfd7"),
    "block": ("#8a20e6", "#8c3cf0"),
}
"""Colours on light and on dark background of the methods that are compared most.

Found by a search for those that differ most in CIELAB, with full colour vision and without any one kind of cone: by 25
and more among those that are compared by default, and by 15 and more among all."""

OTHER_COLOURS = """
882c50 febccf  8c2e23 febfb4  7a4306 fdc495  65500b f2cd64  4c5a09 c6de78  03642b 90e9a3
0f6054 5aedd4  045d69 57e7fe  025884 a4d8fe  374b99 c0d0fd  5f3d8e d9c6fe  783274 feb4f7
a54769 f78fb1  aa493c fc9382  9d580c f09f58  83680b d4b045  637502 aac05b  218041 73cb87
067d6e 30cfb7  087988 1acae2  0573aa 5cbefe  4f65b6 98b0fe  7857ab c1a0fb  944c8f e395dc
c46183 d87495  c86556 dd7767  be7125 d2833b  a38207 b79420  7c9128 8ea43d  429c5a 56ae6c
0f9b89 16b09b  0e97a9 13abbf  248fcc 3ca2e0  6880d4 7993e8  9372c8 a584dc  b167ab c579be
"""
"""Colours on light and on dark background for all others: 12 hues and 3 lightnesses of OKLCH (Ottosson 2020).

The chroma is 0.13, or the largest in sRGB; each has a contrast of at least 3 with its background."""

COLOURS = 36
"""Number of these pairs."""

MAX_LINE = 16
"""Number of letters of a long name in one line where there is little room."""


class Style(NamedTuple):
    """Style of a method."""

    on_light: str
    """Colour on a light background, ``#rrggbb``."""
    on_dark: str
    """Colour on a dark background, ``#rrggbb``."""
    mark: int
    """Number of the mark, below `MARKS`."""
    line: str
    """``stroke-dasharray`` of the line."""


def styles_of(names: Sequence[str]) -> list[Style]:
    """Return the styles of the methods of a page, by their names in order."""
    ours = method_names()
    styles = list[Style]()
    for name in names:
        base, options, _ = name.replace("+guide", ":guide").partition(":")
        line = DASH_DOTTED if base not in ours else DASHED if options else SOLID
        place = [*NAMED].index(name) if name in NAMED else _checksum(name) // COLOURS
        taken = {style.mark for style in styles}
        free = [mark for mark in range(MARKS) if mark not in taken] or list(range(MARKS))
        mark = place % MARKS
        if mark not in free:
            mark = free[place % len(free)]
        styles.append(Style(*colours_of(name), mark, line))
    return styles


def break_name(name: str) -> list[str]:
    """Break a long name into lines after its punctuation."""
    lines = [""]
    for part in re.findall(r"[^:,]*[:,]|[^:,]+", name):
        if lines[-1] and len(lines[-1]) + len(part) > MAX_LINE:
            lines.append("")
        lines[-1] += part
    return lines


def colours_of(name: str) -> tuple[str, str]:
    """Return the colours of a method on light and on dark background."""
    if name in NAMED:
        return NAMED[name]
    place = 2 * (_checksum(name) % COLOURS)
    on_light, on_dark = OTHER_COLOURS.split()[place : place + 2]
    return f"#{on_light}", f"#{on_dark}"


def _checksum(name: str) -> int:
    """Return a checksum that does not depend on the order of the options."""
    base, colon, options = name.partition(":")
    return zlib.crc32(f"{base}{colon}{','.join(sorted(options.split(',')))}".encode())
