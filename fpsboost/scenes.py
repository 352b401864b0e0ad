"""Scene cuts: pairs of frames that no motion leads across."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

from fpsboost.errors import OptionError
from fpsboost.motion.colour import contrast_components, small_copy
from fpsboost.motion.exhaustive import search_fused
from fpsboost.prepared import PreparedImage


@dataclass(frozen=True)
class CutDetector:
    """A cut is where hardly anything of one frame can be found in the other.

    Both frames are reduced to thumbnails, and every patch of one is searched for in the other with the similarity of
    the method itself; the mean over all pixels of the best similarity is high under any motion and low across a cut.

    Parameters
    ----------
    threshold : float
        Pairs whose similarity lies below it are cuts, 0 (none) to 1 (all). Of 18 rendered and filmed clips, pairs
        up to four frames apart stayed above 0.54, and cuts between clips below 0.45; the default lies between.
    drop : float
        Between other pairs, a cut has at most this share of the likeness of the better neighbour: where all pairs are
        hard to follow, behind turning glass or in a hail of confetti, no scene ends. Of the same clips and three more,
        all cuts lay below 0.7, and pairs within a scene above 0.8.
    thumbnail_side : int
        Longer side of the thumbnails, pixels.

    Raises
    ------
    OptionError
        The threshold is out of range.
    """

    threshold: float = 0.48
    drop: float = 0.75
    thumbnail_side: int = 40

    def __post_init__(self) -> None:
        if not 0 <= self.threshold <= 1:
            raise OptionError(f"--cut-threshold must be 0 (no cuts) to 1 (all cuts), not {self.threshold}.")
        if not 0 < self.drop <= 1:
            raise OptionError(f"drop must be above 0 and at most 1, not {self.drop}.")
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
        if self.threshold == 1:
            return True
        return likeness < self.threshold and not (neighbours and likeness > self.drop * max(neighbours))

    def find_cuts(self, likenesses: Sequence[float]) -> list[bool]:
        """`is_cut` for each of the pairs of a sequence."""
        around = [0.0, *likenesses, 0.0]
        return [self.is_cut(each, *around[k : k + 3 : 2]) for k, each in enumerate(likenesses)]

    def likeness(self, image0: PreparedImage, image1: PreparedImage) -> float:
        """How much of the frames can be found in each other, 0 to 1: the better of both directions."""
        thumbnails = [contrast_components(image.once(small_copy, self.thumbnail_side)) for image in (image0, image1)]
        reach = math.ceil(self.thumbnail_side / 6)
        fields = search_fused(thumbnails[0], thumbnails[1], reach, 5, "box", 0.06)
        return max(float(field.similarity.mean()) for field in fields)
