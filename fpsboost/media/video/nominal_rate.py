"""How fast a video plays, and how long, as its file says it."""

from __future__ import annotations

import statistics
from fractions import Fraction
from itertools import islice, pairwise
from typing import Any

import av

HIGHEST_RATE = 1000
ASSUMED_RATE = Fraction(25)
LARGEST_DRIFT = Fraction(1, 8)
"""Frames by which the end of a clip may miss its rate."""
LARGEST_DENOMINATOR = 10_000
FRAMES_LOOKED_AT = 10_000
"""Entries of a file's index that its usual rate is taken from."""


def nominal_rate(stream: av.VideoStream) -> tuple[Fraction, bool]:
    """The rate that a stream has or, where it varies, most of it; and whether that is more than a guess."""
    average, guessed = as_fraction(stream.average_rate), as_fraction(stream.guessed_rate)
    sane = [rate for rate in (average, guessed) if rate is not None and 0 < rate <= HIGHEST_RATE]
    if len(sane) < 2:
        return (sane[0], True) if sane else (ASSUMED_RATE, False)
    if stream.start_time is None:  # without times, the codec's own headers say
        return sane[1], True
    if abs(sane[0] - sane[1]) * 100 < sane[1]:
        return _without_drift(stream, sane[1]), True
    usual = _usual_rate(stream) or sane[0]
    return next((rate for rate in sane if abs(rate - usual) * 100 < usual), usual), True


def _usual_rate(stream: av.VideoStream) -> Fraction | None:
    """The rate by the usual distance between frames, where the file lists them all."""
    if not stream.frames or len(stream.index_entries) != stream.frames or stream.time_base is None:
        return None
    listed = [entry.timestamp for entry in islice(stream.index_entries, FRAMES_LOOKED_AT)]
    usual = statistics.median_low([after - before for before, after in pairwise(listed) if after > before] or [0])
    rate = 1 / (usual * Fraction(stream.time_base)) if usual else Fraction(0)
    return rate if 0 < rate <= HIGHEST_RATE else None


def _without_drift(stream: av.VideoStream, rate: Fraction) -> Fraction:
    """A rate, or the mean one where a clock runs a little fast or slow, as those of phones do.

    Frames that lie where a constant rate has them need not be made, so the rate must be right to the end of the clip.
    """
    if not stream.frames or len(stream.index_entries) != stream.frames or stream.time_base is None:
        return rate
    entries = stream.index_entries
    lasts = (entries[len(entries) - 1].timestamp - entries[0].timestamp) * Fraction(stream.time_base)
    intervals = stream.frames - 1
    if lasts <= 0 or abs(lasts * rate - intervals) < LARGEST_DRIFT:
        return rate
    return (intervals / lasts).limit_denominator(LARGEST_DENOMINATOR)


def declared_duration(stream: av.VideoStream) -> Fraction | None:
    """Seconds that the header promises, if it does."""
    if stream.duration is None or stream.time_base is None or stream.duration <= 0:
        return None
    return stream.duration * Fraction(stream.time_base)


def assumed_rate_remark(name: str) -> str:
    """What to say of a clip that does not tell its rate."""
    return f"{name} does not say its frame rate; {ASSUMED_RATE} frames per second assumed."


def as_fraction(value: Any) -> Fraction | None:
    """An exact Fraction of FFmpeg's rational, which may also be absent, 0/1 or 1/0."""
    if not value:
        return None
    return Fraction(value.numerator, value.denominator)
