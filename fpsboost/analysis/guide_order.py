"""Do guides show the frames that they are taken for, or those beside them?

Brightness, contrast and an offset do not count, since guides may have others than the frames; nor do small differences,
as those of pictures that hardly move.
"""

import cv2
import numpy as np

from fpsboost.analysis.duplicates import brightness
from fpsboost.frame_cache import FrameCache
from fpsboost.layered import FrameImage

CLEAR = 0.75
"""Ratio of misfits below which one guide clearly fits better than another."""

SIZE = (192, 108)
"""Width and height at which pictures are compared; of any shape, as it is the same for both."""

REACH = 6
"""Largest offset that does not count, in these pixels."""


def relative_misfit(frame: FrameCache, other: FrameImage | None) -> float:
    """Return how much less a frame fits another guide than its own, as a ratio; 1 without two guides.

    What is compared is the share of a guide's variance that the frame does not explain; a thousandth means nothing.
    """
    if frame.guide is None or other is None or other is frame.guide:
        return 1.0
    shown, own, beside = (
        cv2.resize(brightness(each).astype(np.float32), SIZE, interpolation=cv2.INTER_AREA)
        for each in (frame, FrameCache(frame.guide), FrameCache(other))
    )
    fit, fit_beside = (
        cv2.matchTemplate(shown, each[REACH:-REACH, REACH:-REACH], cv2.TM_CCOEFF_NORMED) for each in (own, beside)
    )
    return float((1.001 - (fit_beside**2).max()) / (1.001 - (fit**2).max()))
