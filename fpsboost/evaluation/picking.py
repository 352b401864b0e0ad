"""Single hidden frames, made once more as in a comparison."""

from __future__ import annotations

from collections.abc import Sequence
from fractions import Fraction
from typing import NamedTuple

from fpsboost.evaluation.hiding import Hidden, Hiding, Interval
from fpsboost.evaluation.making import Maker
from fpsboost.frame import Image


class Picked(NamedTuple):
    """A hidden frame with as much of the clip around it as methods look at."""

    hidden: Hidden
    window: list[Interval]
    """Its interval, the one before and the one after."""

    def make(self, maker: Maker) -> Image:
        """Make it once more, exactly as in a comparison unless the method looks farther than the window."""
        (made,) = maker.make(self.window, {self.hidden.number})
        return made.image


def pick(path: str, hiding: Hiding, numbers: Sequence[int], input_fps: Fraction | None = None) -> list[Picked]:
    """Read some of the hidden frames with their surroundings.

    Parameters
    ----------
    path, hiding, input_fps
        As for `compare`.
    numbers : sequence of int
        Of the frames, in any order.

    Returns
    -------
    list of Picked
        In the order of `numbers`.
    """
    found: dict[int, Picked] = {}
    before: Interval | None = None
    unfinished: list[Picked] = []
    for interval in hiding.intervals(path, input_fps):
        for picked in unfinished:
            picked.window.append(interval)
        window = [interval] if before is None else [before, interval]
        unfinished = [Picked(hidden, [*window]) for hidden in interval.hidden if hidden.number in numbers]
        found.update((picked.hidden.number, picked) for picked in unfinished)
        before = interval
    return [found[number] for number in numbers]


def make_some(
    path: str, hiding: Hiding, numbers: Sequence[int], maker: Maker, input_fps: Fraction | None = None
) -> dict[int, Image]:
    """Make some of the hidden frames once more, exactly as in a comparison, by running a method over the whole clip.

    `Picked.make` is quicker, and enough for a method that does not look far.

    Parameters
    ----------
    path, hiding, numbers, input_fps
        As for `pick`.
    maker : Maker

    Returns
    -------
    dict of int to image
        By number.
    """
    return {made.number: made.image for made in maker.make(hiding.intervals(path, input_fps), numbers)}
