"""Where time stands still or breaks off: frames shown again, and pairs that no motion leads across."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from fractions import Fraction
from typing import Protocol

import cv2
import numpy as np
from numpy.lib.stride_tricks import sliding_window_view

from fpsboost.errors import OptionError
from fpsboost.frame import Pixels
from fpsboost.motion.colour import Components, colour_components, contrast_components, gray, small_copy
from fpsboost.motion.field import MotionField, round_trip
from fpsboost.motion.full_search import search_fused
from fpsboost.prepared import PreparedImage
from fpsboost.ycbcr import YCbCrImage

NOTHING_ALIKE = 0.3
"""Share of the threshold below which a pair is a cut whatever its neighbours are like, or if it has none."""

MUCH_ALIKE = 1.5
"""Multiple of the threshold below which a pair is a cut if it is far more unlike than both its neighbours."""

GRADUAL = 0.55
"""Share of a pair's likeness below which that of frames farther apart tells a change that takes time from a cut. Chosen
on nine constructed sets of 581 cuts and 4,800 other pairs: 0.993 of what is found are cuts, 0.979 of them are found."""

REACH = 1 / 3
"""Largest motion that is looked for, as a share of the longer side; a pan that is faster shows another scene anyway."""

V = 0.1
"""Width of the similarity of thumbnails: what blurs or glitters from frame to frame still counts for something."""

PRICE = 0.002
"""What a pixel of motion costs in units of similarity: among patches that are equally alike, as those of a wall, the
nearest is found, in both directions the same one."""

FOUND_BACK = 1.5
"""Pixels of a thumbnail by which a way there and back may miss its beginning: one in x and one in y, as zooms do."""

SAME_V = 0.04
"""Width of the similarity where a way there and back ends elsewhere: only what looks nearly the same, as places of one
wall or of a black frame do, is as good as the beginning."""

PATCH_RADIUS = 5
"""A quarter of a thumbnail's width a patch: smaller ones find something alike in any picture."""


class CutPolicy(Protocol):
    """Contract: says where scenes end, pair by pair. `CutDetector` finds out, `fpsboost.cut_list.CutList` knows."""

    def likeness(self, image0: PreparedImage, image1: PreparedImage) -> float:
        """How much of two frames that follow each other speaks for one scene, 0 to 1."""
        ...

    def is_cut(self, likeness: float, *neighbours: float) -> bool:
        """Whether a scene ends in a pair, given its likeness and those of the pairs before and after."""
        ...

    def is_gradual(self, likeness: float, *across: float) -> bool:
        """Whether a pair that is unlike belongs to a change that takes time, given how alike frames beyond it are."""
        ...

    def is_flash(self, likeness: float, across: float, *neighbours: float) -> bool:
        """Whether the scene goes on behind a frame that hides it, given how alike the frames around that one are."""
        ...


@dataclass(frozen=True)
class CutDetector:
    """A cut is where hardly anything can be followed from one frame to the other and back.

    Both frames are reduced to thumbnails, and every patch of either is searched for in the other with the similarity of
    the method itself. By chance, something alike is often found; but from a patch that has moved the way back leads
    to where it was, and from one that is alike by chance it leads to something else. The mean over all pixels of how
    alike both ends of the way there and of the way there and back are is high under any motion and low across a cut.
    What moves fast, is blurred or is hidden for a moment makes it lower in the pairs around, too: a cut must stand out.

    Parameters
    ----------
    threshold : float
        Pairs whose likeness lies below it are cuts if they stand out, 0 (none) to 1 (all).
    drop : float
        A cut has at most this share of the likeness of the better neighbour: where all pairs are hard to follow, behind
        turning glass or among trees that rush past, no scene ends.
    times : float
        If a pair is so many times as unlike as the worse of both neighbours, it is a cut even where it is more alike
        than the threshold: slides and rooms in the same colours are. A figure that strikes another pose in an animation
        differs less from what it does around.
    thumbnail_side : int
        Longer side of the thumbnails, pixels.

    Raises
    ------
    OptionError
        A value is out of range.
    """

    threshold: float = 0.5
    drop: float = 0.6
    times: float = 8.0
    thumbnail_side: int = 40

    def __post_init__(self) -> None:
        if not 0 <= self.threshold <= 1:
            raise OptionError(f"--cut-threshold must be 0 (no cuts) to 1 (all cuts), not {self.threshold}.")
        if not 0 < self.drop <= 1:
            raise OptionError(f"drop must be above 0 and at most 1, not {self.drop}.")
        if not self.times >= 1:
            raise OptionError(f"times must be at least 1, not {self.times}.")
        if self.thumbnail_side < 1:
            raise OptionError(f"thumbnail_side must be at least 1 pixel, not {self.thumbnail_side}.")

    def is_cut(self, likeness: float, *neighbours: float) -> bool:
        """Whether a scene ends in a pair.

        Alone, a pair is a cut only if nothing is alike: how much of a scene can be followed at all is known from the
        pairs around, and what is interpolated in vain does less harm than motion that stops.

        Parameters
        ----------
        likeness : float
            Of its frames; see `likeness`.
        *neighbours : float
            The same for the pairs before and after, where they are known.
        """
        if self.threshold == 1 or likeness < NOTHING_ALIKE * self.threshold:
            return self.threshold > 0
        if not neighbours:
            return False
        drops = likeness < self.threshold and likeness <= self.drop * max(neighbours)
        # one neighbour may be a moment's rest before motion goes on
        far_out = len(neighbours) > 1 and 1 - likeness >= self.times * (1 - min(neighbours))
        return drops or (far_out and likeness < MUCH_ALIKE * self.threshold)

    def is_gradual(self, likeness: float, *across: float) -> bool:
        """Whether a pair that is unlike belongs to a change that takes time, as the end of a fade.

        A cut is as great from the frame before, and to the frame after; in such a change, frames farther apart are more
        unlike still. What has nothing alike is a cut all the same.

        Parameters
        ----------
        likeness : float
            Of the pair.
        *across : float
            Of each of its frames and the one beyond the other, where they are known.
        """
        some_alike = NOTHING_ALIKE * self.threshold <= likeness and self.threshold < 1
        return some_alike and min(across, default=1.0) < GRADUAL * likeness

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
        goes_on = across >= self.threshold and not self.is_cut(across, *neighbours)
        return goes_on and self.is_cut(likeness, across)

    def likeness(self, image0: PreparedImage, image1: PreparedImage) -> float:
        """How much of the frames can be followed there and back, 0 to 1: the worse of both directions.

        A picture in which little is to be seen can be found in nearly any other, but not the other in it.
        """
        thumbnails = [contrast_components(image.once(small_copy, self.thumbnail_side)) for image in (image0, image1)]
        reach = math.ceil(REACH * self.thumbnail_side)
        field01, field10 = search_fused(thumbnails[0], thumbnails[1], reach, PATCH_RADIUS, "box", V, PRICE)
        return min(_followed(thumbnails[0], field01, field10), _followed(thumbnails[1], field10, field01))


def _followed(thumbnail: Components, there: MotionField, back: MotionField) -> float:
    """Mean similarity of the pixels of a frame to where they are found, times that to where the way back ends."""
    height, width = there.similarity.shape
    y, x = np.mgrid[:height, :width]
    end_y, end_x = y, x
    for field in (there, back):
        dx, dy = np.moveaxis(field.flow[end_y, end_x].astype(np.intp), -1, 0)
        end_y, end_x = end_y + dy, end_x + dx
    looks_the_same = np.ones((height, width), np.float32)
    elsewhere = round_trip(there.flow, y[:, 0], x[0], back) >= FOUND_BACK
    padded = cv2.copyMakeBorder(thumbnail, *(PATCH_RADIUS,) * 4, cv2.BORDER_REPLICATE)
    patches = sliding_window_view(padded, (2 * PATCH_RADIUS + 1,) * 2, axis=(0, 1))
    samples = patches[..., ::PATCH_RADIUS, ::PATCH_RADIUS]  # centre, corners and edges are enough to tell patches apart
    apart = np.square(samples[end_y[elsewhere], end_x[elsewhere]] - samples[elsewhere]).sum(axis=1)
    looks_the_same[elsewhere] = np.exp(-apart / (2 * SAME_V**2)).mean(axis=(1, 2))
    return float((there.similarity * looks_the_same).mean())


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


def brightness(image: Pixels) -> Components:
    """Levels of 8 bits; whole ones for images of 8 bits, exact and beyond white for others."""
    if image.dtype == np.uint8:
        return gray(image)
    if isinstance(image, YCbCrImage):
        black, span, _, _ = image.coding.levels
        return (image.planes[0].astype(np.float32) - np.float32(black)) * np.float32(255 / span)
    colours = colour_components(image)
    luma = colours[..., 0] if image.shape[2] < 3 else cv2.cvtColor(colours, cv2.COLOR_BGR2GRAY)
    return np.asarray(luma * np.float32(255))
