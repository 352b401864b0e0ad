"""Where time stands still or breaks off: frames shown again, and pairs that no motion leads across."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from fractions import Fraction
from typing import Protocol

import cv2
import numpy as np

from fpsboost.errors import OptionError
from fpsboost.frame import Image
from fpsboost.motion.colour import Components, colour_components, contrast_components, gray, small_copy
from fpsboost.motion.full_search import search_fused
from fpsboost.prepared import PreparedImage

NOTHING_ALIKE = 0.25
"""Share of the threshold below which a pair is a cut whatever its neighbours are like."""

SLIGHTLY_ALIKE, MUCH_ALIKE = 1.1, 5 / 3
"""Multiples of the threshold below which a pair is a cut if it stands out, and if it is far out."""


class CutPolicy(Protocol):
    """Contract: says where scenes end, pair by pair. `CutDetector` finds out, `fpsboost.cut_list.CutList` knows."""

    def likeness(self, image0: PreparedImage, image1: PreparedImage) -> float:
        """How much of two frames that follow each other speaks for one scene, 0 to 1."""
        ...

    def is_cut(self, likeness: float, *neighbours: float) -> bool:
        """Whether a scene ends in a pair, given its likeness and those of the pairs before and after."""
        ...

    def is_flash(self, likeness: float, across: float, *neighbours: float) -> bool:
        """Whether the scene goes on behind a frame that hides it, given how alike the frames around that one are."""
        ...


@dataclass(frozen=True)
class CutDetector:
    """A cut is where hardly anything of one frame can be found in the other, or much less than before and after.

    Both frames are reduced to thumbnails, and every patch of one is searched for in the other with the similarity of
    the method itself; the mean over all pixels of the best similarity is high under any motion and low across a cut.
    Where scenes have much in common, as slides, fog and rooms in the same colours do, it is lower than its neighbours.

    Parameters
    ----------
    threshold : float
        Pairs whose similarity lies below it are cuts, 0 (none) to 1 (all). Of 18 rendered and filmed clips, pairs
        up to four frames apart stayed above 0.52, and cuts between clips below 0.42; the default lies between.
    drop : float
        Between other pairs, a cut has at most this share of the likeness of the better neighbour: where all pairs are
        hard to follow, behind turning glass or in a hail of confetti, no scene ends. Of the same clips and three more,
        all cuts lay below 0.45, and pairs within a scene above 0.8.
    fall : float
        A pair that lies below both its neighbours by as much may be a little more alike than the threshold: of
        constructed clips, nine of ten cuts lie lower by as much, and 98 of 100 pairs within a scene by at most 0.12.
    times : float
        If it is so many times as unlike as the worse neighbour, it may be much more alike: slides and rooms in the same
        colours are cuts. A figure that strikes another pose in an animation differs less from what it does around.
    thumbnail_side : int
        Longer side of the thumbnails, pixels.

    Raises
    ------
    OptionError
        The threshold is out of range.
    """

    threshold: float = 0.48
    drop: float = 0.6
    fall: float = 0.15
    times: float = 3.0
    thumbnail_side: int = 40

    def __post_init__(self) -> None:
        if not 0 <= self.threshold <= 1:
            raise OptionError(f"--cut-threshold must be 0 (no cuts) to 1 (all cuts), not {self.threshold}.")
        for name in ("drop", "fall"):
            if not 0 < getattr(self, name) <= 1:
                raise OptionError(f"{name} must be above 0 and at most 1, not {getattr(self, name)}.")
        if not self.times >= 1:
            raise OptionError(f"times must be at least 1, not {self.times}.")
        if self.thumbnail_side < 1:
            raise OptionError(f"thumbnail_side must be at least 1 pixel, not {self.thumbnail_side}.")

    def is_cut(self, likeness: float, *neighbours: float) -> bool:
        """Whether a scene ends in a pair.

        Parameters
        ----------
        likeness : float
            Of its frames; see `likeness`.
        *neighbours : float
            The same for the pairs before and after, where they are known.
        """
        if self.threshold == 1 or not neighbours:
            return self.threshold == 1 or likeness < self.threshold
        if likeness < NOTHING_ALIKE * self.threshold:
            return True
        if likeness < self.threshold and likeness <= self.drop * max(neighbours):
            return True
        stands_out = likeness <= min(neighbours) - self.fall
        far_out = 1 - likeness >= self.times * (1 - min(neighbours))
        return stands_out and likeness < self.threshold * (MUCH_ALIKE if far_out else SLIGHTLY_ALIKE)

    def find_cuts(self, likenesses: Sequence[float]) -> list[bool]:
        """`is_cut` for each of the pairs of a sequence."""
        neighbours = ([*likenesses[max(k - 1, 0) : k], *likenesses[k + 1 : k + 2]] for k in range(len(likenesses)))
        return [self.is_cut(each, *around) for each, around in zip(likenesses, neighbours, strict=True)]

    def is_flash(self, likeness: float, across: float, *neighbours: float) -> bool:
        """Whether a frame that is unlike the one beside it hides a scene that goes on behind it.

        Parameters
        ----------
        likeness : float
            Of the frame and the one beside it.
        across : float
            Of the frames on both of its sides.
        *neighbours : float
            Of the pairs before and after, where they are known.
        """
        goes_on = not self.is_cut(across) and not self.is_cut(across, *neighbours)
        return goes_on and self.is_cut(likeness, across)

    def likeness(self, image0: PreparedImage, image1: PreparedImage) -> float:
        """How much of the frames can be found in each other, 0 to 1: the worse of both directions.

        A picture in which little is to be seen can be found in nearly any other, but not the other in it.
        """
        thumbnails = [contrast_components(image.once(small_copy, self.thumbnail_side)) for image in (image0, image1)]
        reach = math.ceil(self.thumbnail_side / 6)
        fields = search_fused(thumbnails[0], thumbnails[1], reach, 5, "box", 0.06)
        return min(float(field.similarity.mean()) for field in fields)


@dataclass(frozen=True)
class DuplicateDetector:
    """A duplicate is a frame that shows the same as one before, up to the noise of an encoder.

    Two frames differ by as much as their most different block does, so that a mouth that moves in a still picture
    counts. What encoders do to a repeated frame reaches a few levels there and is not to be told from a slow fade by
    itself; but where a picture is held between moves, those are several times as large.

    Parameters
    ----------
    noise : float
        Largest difference of a duplicate, in levels of 8 bits. Of the duplicates of two clips found in the wild,
        the noisiest differed by 5 levels, and pairs in motion by 10 and more.
    share : float
        Largest difference of a duplicate, as a share of the steps before and after it. Same clips: below 0.1.
    smallest_step : float
        Levels by which a picture that moves on differs at least; below it, nobody sees the difference.
    block : int
        Side of the blocks, pixels.
    longest : Fraction
        Seconds that a held picture may last; one that lasts longer is a still. Animation on fours lasts 1/6.
    most : int
        Frames that a held picture may consist of; so many are kept in memory.

    Raises
    ------
    OptionError
        A value is out of range.
    """

    noise: float = 6.0
    share: float = 0.25
    smallest_step: float = 3.0
    block: int = 16
    longest: Fraction = Fraction(1, 4)
    most: int = 8

    def __post_init__(self) -> None:
        if not 0 <= self.noise <= 255:
            raise OptionError(f"noise must be 0 to 255 levels, not {self.noise}.")
        if not 0 <= self.share < 1:
            raise OptionError(f"share must be at least 0 and below 1, not {self.share}.")
        if not 0 < self.smallest_step <= 255:
            raise OptionError(f"smallest_step must be above 0 and at most 255 levels, not {self.smallest_step}.")
        if self.block < 1 or self.most < 1 or self.longest < 0:
            raise OptionError("block and most must be at least 1, and longest not below 0; change the detector.")

    def difference(self, image0: PreparedImage, image1: PreparedImage) -> float:
        """Mean difference of brightness in the block where it is largest, in levels of 8 bits."""
        difference = cv2.absdiff(image0.once(brightness), image1.once(brightness))
        return float(cv2.boxFilter(difference, cv2.CV_32F, (self.block, self.block)).max())

    def is_held(self, noise: float, before: float, after: float) -> bool:
        """Whether frames show one picture that was held.

        Parameters
        ----------
        noise : float
            The largest difference of one of them from the first; see `difference`.
        before, after : float
            The differences to where the picture came from, and to where it moves on.
        """
        return noise <= self.noise and noise <= self.share * min(before, after) and self.smallest_step <= after

    def repeats_still(self, noise: float, before: float) -> bool:
        """Whether frames that go on to differ little repeat one picture; in slow motion they differ as little.

        Parameters
        ----------
        noise : float
            The largest difference of one of them from the first; see `difference`.
        before : float
            The difference to where the picture came from; infinite where the clip begins with it.
        """
        return noise <= (self.smallest_step if math.isinf(before) else min(self.noise, self.share * before))


def brightness(image: Image) -> Components:
    """Levels of 8 bits; whole ones for images of 8 bits, exact and beyond white for others."""
    if image.dtype == np.uint8:
        return gray(image)
    colours = colour_components(image)
    luma = colours[..., 0] if image.shape[2] < 3 else cv2.cvtColor(colours, cv2.COLOR_BGR2GRAY)
    return np.asarray(luma * np.float32(255))
