"""Timecodes, which count frames and so change with the frame rate."""

from __future__ import annotations

import re
from collections.abc import Mapping
from fractions import Fraction

MOST_FRAMES = 255
"""Frames per second that a timecode track counts, in one byte."""


def find_timecode(*tags: Mapping[str, str]) -> str | None:
    """The first timecode in the tags of a stream or a file, whatever the case of its name."""
    return next((value for each in tags for key, value in each.items() if key.lower() == "timecode"), None)


def at_rate(timecode: str, old: Fraction, new: Fraction) -> str | None:
    """The same moment, counted at another frame rate.

    Parameters
    ----------
    timecode : str
        ``01:02:03:12``; a semicolon before the frames means that numbers are dropped to keep up with 29.97.
    old, new : Fraction
        Frames per second.

    Returns
    -------
    str or None
        None where there is none: it cannot be read, or the new rate is too high or has no drop-frame count.

    Examples
    --------
    >>> at_rate("01:02:03:12", Fraction(24), Fraction(60))
    '01:02:03:30'
    """
    found = re.fullmatch(r"(\d{1,2}:\d{2}:\d{2})([:;.])(\d{1,3})", timecode.strip())
    before, after = round(old), round(new)
    if found is None or not before or not 1 <= after <= MOST_FRAMES:
        return None
    moment, separator, frames = found[1], found[2], int(found[3])
    if frames >= before or (separator != ":" and after % 30):
        return None
    return f"{moment}{separator}{frames * after // before:02d}"
