"""Remarks on properties of a clip that its target does not hold."""

from __future__ import annotations

from collections.abc import Sequence
from fractions import Fraction


def interlaced_remark(name: str, which: str = "", advice: str = "deinterlace it first") -> str:
    """Return the remark on an interlaced clip; `which` may restrict it: `` in 2 of 10 frames``."""
    return f"{name} is interlaced{which} and its fields were taken as whole pictures; {advice} for smooth motion."


def lost_alpha_remark(name: str) -> str:
    """Return the remark on alpha that the target cannot hold, with the targets that can."""
    return (
        f"{name} has an alpha channel, which was left out; a .webm, images as .png, or `codec='prores_ks'` in a .mov "
        "keep it."
    )


def lost_companions_remark(name: str, companions: Sequence[str], target: str) -> str:
    """Return the remark on audio and subtitles that a type of target cannot hold."""
    return f"{name} has {' and '.join(companions)}, which {target} cannot hold; left out."


def lost_shape_remark(name: str, aspect: Fraction | None) -> str:
    """Return the remark on non-square pixels where images are written."""
    return f"{name} has pixels of the shape {aspect}, which images cannot say; they come out unscaled."


def not_held_remark(name: str, what: str, keeping: Sequence[str]) -> str:
    """Return the remark on a stream that is left out; `keeping` holds the suffixes of containers that keep it."""
    way = f"write {' or '.join(keeping)} to keep it" if keeping else "none of the containers written here does"
    return f"{name} does not hold {what} of its source; {way}."
