"""Gaps: places in a clip of constant rate where the camera or the capture dropped frames, so that motion jumps.

They are found where nearly all that moves goes a whole multiple of its usual way from one frame to the next. That holds
for motion of the camera; a thing that moves in front of a still background covers too little of the picture to tell.
"""

from collections.abc import Iterable
from itertools import pairwise

import cv2
import numpy as np

from fpsboost.frame_cache import FrameCache
from fpsboost.motion.components import small_copy
from fpsboost.motion.field import MotionField
from fpsboost.motion.opencv import Dis

SIDE = 320  # longer side of the thumbnails in which motion is found, pixels; larger frames are reduced
MOVING = 0.05
"""Least share of the picture that moves."""
STEADY = 0.5
"""Least share of the moving area that moves alike before and after the gap."""
JUMPING = 0.6
"""Least share of that area which moves by a multiple in the gap itself."""


def find_gaps(frames: Iterable[FrameCache]) -> dict[int, int]:
    """Return how many frames are missing behind frames of a clip, by their numbers; reads a clip of any length.

    Nothing is found behind the first frame and before the last one, and where motion begins, ends or changes: the pairs
    before and after must show the same motion. So no gap is found next to another one.
    """
    thumbnails = (FrameCache(small_copy(each.pixels, min(SIDE, max(each.pixels.shape[:2])))) for each in frames)
    fields = (Dis().estimate(*pair) for pair in pairwise(thumbnails))
    return {
        number: missing
        for number, (((_, back), (forward, _)), (_, (onward, _))) in enumerate(pairwise(pairwise(fields)), 1)
        if (missing := _missing_between(back, forward, onward))
    }


def _missing_between(back: MotionField, forward: MotionField, onward: MotionField) -> int:
    """Return how many frames are missing between two frames, by their motion and that of the pairs around them.

    `back` leads from the first one to the frame before, `forward` to the second one, and `onward` from there to the
    next. Usual is the mean motion of the pairs around, where both agree within 35 % and it is at least a pixel.
    """
    x, y = np.indices(forward.shape, np.float32)[::-1] + np.moveaxis(forward.flow, -1, 0)
    after = cv2.remap(onward.flow, x, y, cv2.INTER_LINEAR, borderMode=cv2.BORDER_CONSTANT, borderValue=np.nan)
    usual = (after - back.flow) / 2
    length = np.hypot(usual[..., 0], usual[..., 1])
    moving = length >= 1  # and not NaN, beyond the edge
    is_steady = moving & (np.hypot(*np.moveaxis(after + back.flow, -1, 0)) <= 0.35 * length)
    steps = (forward.flow * usual).sum(axis=-1)[is_steady] / length[is_steady] ** 2
    step = np.median(steps) if len(steps) >= max(50, STEADY * moving.sum()) else 0
    whole = round(float(step))
    is_jump = 2 <= whole <= 9 and abs(step - whole) <= 0.25 and np.mean(abs(steps - whole) < 0.3) >= JUMPING
    return whole - 1 if is_jump and moving.mean() >= MOVING else 0
