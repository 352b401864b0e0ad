"""Which parts of a layer stand still though they change, such as digits of a counter, and which move, such as a ticker.

Strokes of one digit resemble those of the next, so that an estimator finds motion between them, a different one for
each stroke. What moves follows one motion as a whole: each part of the layer that changes is tested for that.
"""

import cv2
import numpy as np

from fpsboost.frame_cache import FrameCache
from fpsboost.motion.components import gray
from fpsboost.motion.field import MotionField

CHANGED = 8
"""Difference in luma, blurred against noise, beyond which pixels count as changed, levels of 255."""

JOINED = 1 / 80
"""Distance below which changed pixels belong to one part, as a share of the frame's longer side."""

MAX_UNEXPLAINED = 0.35
"""Largest share of its change that the motion of a part may leave."""

LONGEST_WAY = 1 / 4
"""Longest motion of a part, as a share of its longer side: a digit that appears next to one like it does not move."""


def find_still_parts(image0: FrameCache, image1: FrameCache, field01: MotionField) -> np.ndarray:
    """Find the parts of a layer that stand still, whether they change or not.

    Parameters
    ----------
    image0, image1 : FrameCache
        Two frames of the layer, (H, W, 4), with the same alpha.
    field01 : MotionField
        Motion from frame 0 to frame 1.

    Returns
    -------
    (H, W) float32
        0 in the rectangles around parts that move as a whole, and 1 elsewhere.
    """
    layer0, layer1 = (cv2.blur(image.cached(gray).astype(np.float32), (3, 3)) for image in (image0, image1))
    change = cv2.absdiff(layer0, layer1)
    is_changed = change > CHANGED
    reach = max(3, round(JOINED * max(change.shape)))
    joined = cv2.dilate(is_changed.astype(np.uint8), np.ones((reach, reach), np.uint8))
    _, labels, boxes, _ = cv2.connectedComponentsWithStats(joined)
    still = np.ones_like(change)
    for number, (left, top, width, height, _) in enumerate(boxes[1:], 1):
        box = np.s_[top : top + height, left : left + width]
        is_part = labels[box] == number
        shift = np.median(field01.flow[box][is_part & is_changed[box]], axis=0)
        middle = left + (width - 1) / 2, top + (height - 1) / 2
        unexplained = max(
            np.abs(cv2.getRectSubPix(other, (width, height), place) - layer[box])[is_part].sum()
            for layer, other, place in ((layer0, layer1, middle + shift), (layer1, layer0, middle - shift))
        )
        is_near = np.abs(shift).max() < LONGEST_WAY * max(width, height)
        if is_near and unexplained < MAX_UNEXPLAINED * change[box][is_part].sum():
            still[box][is_part | (labels[box] == 0)] = 0
    return still
