"""Convert timecodes, which count frames and so depend on the frame rate."""

from __future__ import annotations

import re
from collections.abc import Mapping
from fractions import Fraction

MAX_TIMECODE_RATE = 255
"""Maximum frames per second of a timecode track, which stores them in one byte."""

TIMECODE_PATTERN = re.compile(r"(\d{1,2}):(\d{2}):(\d{2})([:;.])(\d{1,3})")


def find_timecode(*tags: Mapping[str, str]) -> str | None:
    """Return the first timecode in the tags of a stream or a file, or None; the case of tag names is ignored."""
    return next((value for each in tags for key, value in each.items() if key.lower() == "timecode"), None)


def at_rate(timecode: str, old: Fraction, new: Fraction) -> str | None:
    """Convert a timecode to another frame rate.

    Parameters
    ----------
    timecode : str
        ``01:02:03:12``; a semicolon before the frames denotes drop-frame timecode, for 29.97 frames per second.
    old, new : Fraction
        Frames per second.

    Returns
    -------
    str or None
        None if the timecode cannot be parsed, or the new rate is too high or has no drop-frame timecode.

    Examples
    --------
    >>> at_rate("01:02:03:12", Fraction(24), Fraction(60))
    '01:02:03:30'
    """
    found = TIMECODE_PATTERN.fullmatch(timecode.strip())
    before, after = round(old), round(new)
    if found is None or not before or not 1 <= after <= MAX_TIMECODE_RATE:
        return None
    *moment, separator, frames = found.groups()
    if int(frames) >= before or (separator != ":" and after % 30):
        return None
    return f"{':'.join(moment)}{separator}{int(frames) * after // before:02d}"


def frames_later(timecode: str, rate: Fraction, count: int) -> str:
    """Return the timecode `count` frames later, modulo 24 hours; return it unchanged if it cannot be parsed.

    Examples
    --------
    >>> frames_later("00:00:59;29", Fraction(30000, 1001), 1)
    '00:01:00;02'
    """
    found, per_second = TIMECODE_PATTERN.fullmatch(timecode.strip()), round(rate)
    if found is None or not per_second or not count:
        return timecode
    hours, minutes, seconds, frames = (int(found[group]) for group in (1, 2, 3, 5))
    minutes += 60 * hours
    dropped = 0 if found[4] == ":" else per_second // 15  # frame numbers skipped in each minute but every tenth
    number = (60 * minutes + seconds) * per_second + frames - dropped * (minutes - minutes // 10) + count
    tens, rest = divmod(number, 600 * per_second - 9 * dropped)
    number += dropped * (9 * tens + max(0, rest - dropped) // (60 * per_second - dropped))
    seconds, frames = divmod(number, per_second)
    return f"{seconds // 3600 % 24:02d}:{seconds // 60 % 60:02d}:{seconds % 60:02d}{found[4]}{frames:02d}"
