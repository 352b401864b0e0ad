"""Scene cuts: pairs of frames that no motion leads across."""

from __future__ import annotations

import math
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
    thumbnail_side : int
        Longer side of the thumbnails, pixels.

    Raises
    ------
    OptionError
        The threshold is out of range.
    """

    threshold: float = 0.48
    thumbnail_side: int = 40

    def __post_init__(self) -> None:
        if not 0 <= self.threshold <= 1:
            raise OptionError(f"--cut-threshold must be 0 (no cuts) to 1 (all cuts), not {self.threshold}.")
        if self.thumbnail_side < 1:
            raise OptionError(f"thumbnail_side must be at least 1 pixel, not {self.thumbnail_side}.")

    def is_cut(self, image0: PreparedImage, image1: PreparedImage) -> bool:
        """Whether a scene ends between the two frames.

        Parameters
        ----------
        image0, image1 : PreparedImage
        """
        return self.threshold == 1 or self.likeness(image0, image1) < self.threshold

    def likeness(self, image0: PreparedImage, image1: PreparedImage) -> float:
        """How much of the frames can be found in each other, 0 to 1: the better of both directions."""
        thumbnails = [contrast_components(image.once(small_copy, self.thumbnail_side)) for image in (image0, image1)]
        reach = math.ceil(self.thumbnail_side / 6)
        fields = search_fused(thumbnails[0], thumbnails[1], reach, 5, "box", 0.06)
        return max(float(field.similarity.mean()) for field in fields)
