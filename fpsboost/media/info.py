"""Size, frame rate and length of a clip, and rate and time base of an output, as plain data."""

from __future__ import annotations

from dataclasses import dataclass
from fractions import Fraction

MAX_DISPLAY_RATE = 300
"""Frame rate above which no display shows frames, and no camera films without keeping its rate; frames per second."""
MAX_RATE_RATIO = 10
"""Ratio of the nominal to the mean rate above which nearly all frames would be made where nothing moves."""


@dataclass(frozen=True, slots=True)
class ClipInfo:
    """Properties of a clip that are known before its first frame is read."""

    name: str
    """The path or pattern as the user gave it."""
    height: int
    """Rows of pixels, as stored (a rotation tag is not applied)."""
    width: int
    """Columns of pixels, likewise."""
    rate: Fraction
    """Nominal frames per second."""
    time_base: Fraction
    """Seconds per tick: every frame time is a multiple of it."""
    frame_count: int | None
    """Number of frames that the source declares; None if it does not."""
    duration: Fraction | None = None
    """Duration in seconds that the source declares; None if it does not."""
    mean_rate: Fraction | None = None
    """Frames per second over all frames whose times are known beforehand, pauses included; None if none are."""


@dataclass(frozen=True)
class OutputTiming:
    """Rate and time base of an output, which encoders and containers are set to."""

    rate: Fraction
    """Nominal frames per second."""
    time_base: Fraction
    """Seconds per tick; frame times are multiples of it (or rounded to it where the container is coarser)."""


def is_implausible(rate: Fraction, mean_rate: Fraction) -> bool:
    """Return whether a rate is higher than that of any display, and far higher than the mean rate of the frames."""
    return rate > MAX_DISPLAY_RATE and rate > MAX_RATE_RATIO * mean_rate
