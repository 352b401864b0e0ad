"""Where time stands still or breaks off: frames shown again, and pairs that no motion leads across."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol

import cv2
import numpy as np
from numpy.lib.stride_tricks import sliding_window_view

from fpsboost.errors import OptionError
from fpsboost.frame_cache import FrameCache
from fpsboost.motion.colour import Components, contrast_components, small_copy
from fpsboost.motion.field import MotionField, forward_backward_error
from fpsboost.motion.full_search import search_fused

CERTAIN_CUT = 0.3
"""Share of the threshold below which a pair is a cut whatever its neighbours are like, or if it has none."""

ISOLATED_CUT = 1.5
"""Multiple of the threshold below which a pair is a cut if it is far more unlike than both its neighbours."""

GRADUAL_CHANGE = 0.55
"""Share of a pair's likeness below which that of frames farther apart tells a change that takes time from a cut. Chosen
on nine constructed sets of 581 cuts and 4,800 other pairs: 0.993 of what is found are cuts, 0.979 of them are found."""

SEARCH_RANGE = 1 / 3
"""Largest motion that is looked for, as a share of the longer side; a pan that is faster shows another scene anyway."""

BANDWIDTH = 0.1
"""Width of the similarity of thumbnails: what blurs or glitters from frame to frame still counts for something."""

MOTION_PENALTY = 0.002
"""What a pixel of motion costs in units of similarity: among patches that are equally alike, as those of a wall, the
nearest is found, in both directions the same one."""

CONSISTENCY_TOLERANCE = 1.5
"""Pixels of a thumbnail by which a way there and back may miss its beginning: one in x and one in y, as zooms do."""

STRICT_BANDWIDTH = 0.04
"""Width of the similarity where a way there and back ends elsewhere: only what looks nearly the same, as places of one
wall or of a black frame do, is as good as the beginning."""

PATCH_RADIUS = 5
"""A quarter of a thumbnail's width a patch: smaller ones find something alike in any picture."""


class CutPolicy(Protocol):
    """Contract: says where scenes end, pair by pair.

    `CutDetector` finds out, `fpsboost.analysis.cut_list.CutList` knows.
    """

    def match_score(self, image0: FrameCache, image1: FrameCache) -> float:
        """How much of two frames that follow each other speaks for one scene, 0 to 1."""
        ...

    def is_cut(self, match_score: float, *neighbours: float) -> bool:
        """Whether a scene ends in a pair, given its likeness and those of the pairs before and after."""
        ...

    def is_gradual(self, match_score: float, *across: float) -> bool:
        """Whether a pair that is unlike belongs to a change that takes time, given how alike frames beyond it are."""
        ...

    def is_flash(self, match_score: float, across: float, *neighbours: float) -> bool:
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

    def is_cut(self, match_score: float, *neighbours: float) -> bool:
        """Whether a scene ends in a pair.

        Alone, a pair is a cut only if nothing is alike: how much of a scene can be followed at all is known from the
        pairs around, and what is interpolated in vain does less harm than motion that stops.

        Parameters
        ----------
        match_score : float
            Of its frames; see `match_score`.
        *neighbours : float
            The same for the pairs before and after, where they are known.
        """
        if self.threshold == 1 or match_score < CERTAIN_CUT * self.threshold:
            return self.threshold > 0
        if not neighbours:
            return False
        drops = match_score < self.threshold and match_score <= self.drop * max(neighbours)
        # one neighbour may be a moment's rest before motion goes on
        far_out = len(neighbours) > 1 and 1 - match_score >= self.times * (1 - min(neighbours))
        return drops or (far_out and match_score < ISOLATED_CUT * self.threshold)

    def is_gradual(self, match_score: float, *across: float) -> bool:
        """Whether a pair that is unlike belongs to a change that takes time, as the end of a fade.

        A cut is as great from the frame before, and to the frame after; in such a change, frames farther apart are more
        unlike still. What has nothing alike is a cut all the same.

        Parameters
        ----------
        match_score : float
            Of the pair.
        *across : float
            Of each of its frames and the one beyond the other, where they are known.
        """
        some_alike = CERTAIN_CUT * self.threshold <= match_score and self.threshold < 1
        return some_alike and min(across, default=1.0) < GRADUAL_CHANGE * match_score

    def find_cuts(self, match_scores: Sequence[float]) -> list[bool]:
        """`is_cut` for each of the pairs of a sequence."""
        neighbours = (
            [*match_scores[max(k - 1, 0) : k], *match_scores[k + 1 : k + 2]] for k in range(len(match_scores))
        )
        return [self.is_cut(each, *around) for each, around in zip(match_scores, neighbours, strict=True)]

    def is_flash(self, match_score: float, across: float, *neighbours: float) -> bool:
        """Whether a frame that is unlike the one beside it hides a scene that goes on behind it.

        Parameters
        ----------
        match_score : float
            Of the frame and the one beside it.
        across : float
            Of the frames on both of its sides.
        *neighbours : float
            Of the pairs before and after, where they are known.
        """
        goes_on = across >= self.threshold and not self.is_cut(across, *neighbours)
        return goes_on and self.is_cut(match_score, across)

    def match_score(self, image0: FrameCache, image1: FrameCache) -> float:
        """How much of the frames can be followed there and back, 0 to 1: the worse of both directions.

        A picture in which little is to be seen can be found in nearly any other, but not the other in it.
        """
        thumbnails = [contrast_components(image.cached(small_copy, self.thumbnail_side)) for image in (image0, image1)]
        search_radius = math.ceil(SEARCH_RANGE * self.thumbnail_side)
        field01, field10 = search_fused(
            thumbnails[0], thumbnails[1], search_radius, PATCH_RADIUS, "box", BANDWIDTH, MOTION_PENALTY
        )
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
    elsewhere = forward_backward_error(there.flow, y[:, 0], x[0], back) >= CONSISTENCY_TOLERANCE
    padded = cv2.copyMakeBorder(thumbnail, *(PATCH_RADIUS,) * 4, cv2.BORDER_REPLICATE)
    patches = sliding_window_view(padded, (2 * PATCH_RADIUS + 1,) * 2, axis=(0, 1))
    samples = patches[..., ::PATCH_RADIUS, ::PATCH_RADIUS]  # centre, corners and edges are enough to tell patches apart
    apart = np.square(samples[end_y[elsewhere], end_x[elsewhere]] - samples[elsewhere]).sum(axis=1)
    looks_the_same[elsewhere] = np.exp(-apart / (2 * STRICT_BANDWIDTH**2)).mean(axis=(1, 2))
    return float((there.similarity * looks_the_same).mean())
