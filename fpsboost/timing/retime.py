"""Retime curves as users write them, as points or speeds, converted to time maps at the frame rates of a clip."""

import re
from fractions import Fraction
from pathlib import Path

from fpsboost.errors import OptionError, explained
from fpsboost.media import TimeMap
from fpsboost.timing.position import Position
from fpsboost.timing.schedule import parse_number


def read_curve(text: str, option: str = "`retime`") -> str:
    """Return the text of a curve: `text` itself if it has points, else the content of the file of this name.

    Messages name the option by `option`. Raises `OptionError` if there is no such file.
    """
    if "=" in text or "\n" in text.strip() or not text.strip():
        return text
    with explained(OptionError, "read", text, f"give {option} a file, or points like 0=0 2s=2s 3s=2.25s"):
        return Path(text).read_text("utf-8-sig", errors="replace")


def parse_curve(text: str, output_rate: Fraction, source_rate: Fraction, first_number: int = 1) -> TimeMap:
    """Parse a curve: points on lines of their own, ``3s 2.25s``, or one after another, ``0=0 2s=2s 3s=2.25s``.

    A point is an output position and the position of the source that is shown then: times (2s, 1:30.5) or frames
    (120f). Bare numbers alone are frames as Nuke exports them: the source's first frame is `first_number`, and the last
    point is a frame of the output. The word ``smooth`` makes the speed change smoothly from point to point; ``x1``
    after the last one goes on at this speed to the source's end; ``#`` begins a comment.

    Parameters
    ----------
    text : str
        The curve, as `read_curve` returns it.
    output_rate, source_rate : Fraction
        Frames per second of the output and of the source, by which frame numbers are converted.
    first_number : int
        Number of the source's first frame where bare numbers are frames.

    Returns
    -------
    TimeMap

    Raises
    ------
    OptionError
        A point cannot be read, is not after the one before, or is before the source's first frame.

    Examples
    --------
    >>> curve = parse_curve("0=0 2s=2s 4s=2.5s", Fraction(24), Fraction(24))  # a quarter of the speed from 2 s on
    >>> str(curve.source(Fraction(3))), str(curve.length)
    ('9/4', '4')
    """
    points = list[tuple[Fraction, Fraction]]()
    plain = re.sub("#.*", "", text)
    is_smooth = "smooth" in plain.split()
    ending = re.search(r"\sx(\S+)\s*$", plain)
    onward = None if ending is None else parse_number(ending[1], "`retime`, speed at the end,")
    if onward is not None and onward <= 0:
        raise OptionError(f"`retime` never reaches the source's end with x{onward}; give a speed above 0.")
    plain = plain if ending is None else plain[: ending.start()]
    is_numbered = not re.search(r"\d[sf:]", plain) and re.search("[1-9]", plain) is not None
    is_listed = "\n" in text.strip()
    unit, lines = ("line", plain.splitlines()) if is_listed else ("point", plain.replace(",", " ").split())
    for number, line in enumerate(lines, 1):
        where = f"`retime`, {unit} {number}"
        words = [w for w in re.findall(r"[^\s=,]+", line) if w != "smooth"]
        if not words:
            continue
        lacks_unit = any(re.fullmatch(r"[\d.]+", word) and word.strip("0.") for word in words)
        if len(words) != 2:
            raise OptionError(f"{where}: {line.strip()!r} must be an output time and a source time, such as 3s 2s.")
        if lacks_unit and not is_numbered:
            raise OptionError(f"{where}: {line.strip()!r} has no unit; write seconds as 2s, and frames as 48f.")
        at, source = (Position.parse(word, where, "f" if is_numbered else "s", between=True) for word in words)
        first = first_number / source_rate if is_numbered else 0
        points.append((at.seconds(output_rate), source.seconds(source_rate) - first))
        if len(points) > 1 and points[-1][0] <= points[-2][0]:
            raise OptionError(f"{where}: {words[0]} is not after the point before it; output times must increase.")
        if points[-1][1] < 0:
            raise OptionError(f"{where}: {words[1]} is before Nuke's first frame, {first_number}; write seconds as 2s.")
    if len(points) < 2 - (onward is not None):
        raise OptionError("`retime` needs at least two points; write them like 0=0 2s=2s 3s=2.25s.")
    if is_numbered:
        points.append((points[-1][0] + 1 / output_rate, points[-1][1]))
    return TimeMap.through(points, smooth=is_smooth, onward=onward)


def parse_speeds(text: str, source_rate: Fraction) -> TimeMap:
    """Parse speeds and the parts of the source that have them, in order: ``0.25@1:00-1:05,2@2:00-``; elsewhere it is 1.

    `source_rate` converts frame numbers. Raises `OptionError` for a speed outside 0.001 to 1000, or a part that begins
    before the end of the one before.

    Examples
    --------
    >>> curve = parse_speeds("0.5@1-2", Fraction(24))  # the second from 1 s to 2 s lasts two seconds
    >>> str(curve.source(Fraction(2))), str(curve.source(Fraction(4)))
    ('3/2', '3')
    """
    points = [(Fraction(0), Fraction(0))]
    onward = Fraction(1)
    for word in text.split(","):
        name, _, place = word.partition("@")
        speed = parse_number(name, "`speed`")
        ends = [*place.split("-"), ""][:2]
        begin, end = (Position.parse(each, "`speed`").seconds(source_rate) if each else None for each in ends)
        time, source = points[-1]
        ends_early = end is not None and end <= (begin or 0)
        if not Fraction(1, 1000) <= speed <= 1000:
            raise OptionError(f"`speed` {word!r} must be from 0.001 to 1000; freeze and reverse with `retime`.")
        if onward != 1 or place.count("-") > 1 or (begin or 0) < source or ends_early:
            raise OptionError(f"`speed` {word!r} must be a part after those before it; write it like 0.25@1:00-1:05.")
        if begin is not None and begin > source:
            time = time + begin - source
            source = begin
            points.append((time, source))
        if end is not None:
            points.append((time + (end - source) / speed, end))
        onward = speed if end is None else onward
    return TimeMap.through(points, onward=onward)
