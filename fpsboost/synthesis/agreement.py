"""Confidence of an in-between frame by the agreement of the two frames, for methods that have none of their own.

Agreement is measured along the motion, for any synthesizer. Its measure is that of `fpsboost.kernels.multi_hypothesis`
for a single motion, so that confidences of all methods are on one scale: patches of five by five blocks of two by two
pixels, similarity ``exp(-d / 2 v^2)``, to the eighth power.
"""

import cv2
import numpy as np

from fpsboost.frame_cache import FrameCache
from fpsboost.image import Pixels, view
from fpsboost.kernels.constants import END_WEIGHT
from fpsboost.motion.field import MotionField
from fpsboost.synthesis import FramePair

BANDWIDTH = 0.3
"""Bandwidth v of the similarity, for colours in [0, 1]."""

PATCH = (END_WEIGHT, 1, 1, 1, END_WEIGHT)
"""Weights of the 2x2 blocks of a patch along an axis."""

ITERATIONS = 3
"""Iterations of the search for the motion that leads through a pixel."""


def measure_agreement(frame_pair: FramePair, t: float) -> np.ndarray:
    """Return the confidence of an in-between frame: the agreement of the two frames along the motion between them.

    In each direction, the motion through every pixel is found by the fixed-point search of Yang et al. 2011, and the
    patches at both of its ends are compared. The lower agreement counts: what is mixed along both motions is right only
    where both are.

    Parameters
    ----------
    frame_pair : FramePair
        Two frames and the motion between them.
    t : float
        Time of the in-between frame, in (0, 1).

    Returns
    -------
    (H, W) float32 in [0, 1]
    """
    onward = find_motion(frame_pair.field01, t)
    back = find_motion(frame_pair.field10, 1 - t)
    image0 = frame_pair.image0
    image1 = frame_pair.image1
    agreement01 = measure_agreement_along(image0, image1, -t * onward, (1 - t) * onward)
    return np.asarray(np.minimum(agreement01, measure_agreement_along(image0, image1, t * back, (t - 1) * back)))


def find_motion(field: MotionField, t: float) -> np.ndarray:
    """Return the motion of the points that are at each pixel after a share t of their way, (H, W, 2) float32."""
    motion = flow = field.flow
    for _ in range(ITERATIONS if flow.any() else 0):  # without motion, nothing is to be searched
        motion = sample(flow, -t * motion, cv2.INTER_NEAREST)
    return motion


def measure_agreement_along(
    image0: FrameCache, image1: FrameCache, motion0: np.ndarray, motion1: np.ndarray
) -> np.ndarray:
    """Return the agreement of two frames along the motion from each in-between pixel to either of them.

    Parameters
    ----------
    image0, image1 : FrameCache
        Two frames of one size and type.
    motion0, motion1 : (H, W, 2) float32
        Motion from the in-between frame to frame 0 and to frame 1, pixels.

    Returns
    -------
    (H, W) float32 in [0, 1]
    """
    first, second = (
        sample(image.cached(_comparable), motion, cv2.INTER_CUBIC) if motion.any() else image.cached(_comparable)
        for image, motion in ((image0, motion0), (image1, motion1))
    )
    difference = first - second
    squared = np.einsum("yxc,yxc->yx", difference, difference)
    height, width = squared.shape
    even = cv2.copyMakeBorder(squared, 0, height % 2, 0, width % 2, cv2.BORDER_REPLICATE)
    squares = cv2.resize(even, None, fx=0.5, fy=0.5, interpolation=cv2.INTER_AREA)
    # differences in gray have the same scale for all image types
    squares *= np.float32(-0.5 / BANDWIDTH**2 * view(image0.pixels).gray_weight)
    weights = np.array(PATCH, np.float32) / np.float32(sum(PATCH))
    similarity = cv2.sepFilter2D(np.exp(squares), cv2.CV_32F, weights, weights, borderType=cv2.BORDER_REPLICATE)
    upsampled = cv2.resize(similarity, even.shape[::-1], interpolation=cv2.INTER_LINEAR)[:height, :width]
    return upsampled.clip(0, 1) ** 8


def sample(values: np.ndarray, motion: np.ndarray, interpolation: int) -> np.ndarray:
    """Return the values at the end of the motion from each pixel, in the shape of `values`.

    Edges are repeated. `motion` is (H, W, 2), `interpolation` one of OpenCV's filters such as ``cv2.INTER_CUBIC``.
    """
    height, width = motion.shape[:2]
    y = np.arange(height, dtype=np.float32)[:, np.newaxis]
    x = np.arange(width, dtype=np.float32)
    sampled = cv2.remap(values, x + motion[..., 0], y + motion[..., 1], interpolation, borderMode=cv2.BORDER_REPLICATE)
    return sampled.reshape(values.shape)


def _comparable(image: Pixels) -> np.ndarray:
    """Return an image as the agreement compares it; a function for `FrameCache.cached`."""
    return view(image).comparable()


def mix_by_weight(image: Pixels, other: Pixels, weights: np.ndarray) -> Pixels:
    """Return an image with another one of its kind mixed in by a weight for each pixel.

    Parameters
    ----------
    image, other : array or YCbCrImage
        Of one size and type.
    weights : (H, W) float32
        Weight of the other image, 0 to 1; that of subsampled chroma is the mean of its pixels. Where it is 0, values
        are those of the image to the bit, and where it is 1, those of the other.
    """

    def mixed(first: np.ndarray, second: np.ndarray) -> np.ndarray:
        weight = cv2.resize(weights, first.shape[1::-1], interpolation=cv2.INTER_AREA)
        result = first.copy()
        part = weight > 0
        before = first[part]
        after = second.reshape(first.shape)[part]
        share = weight[part].reshape(-1, *[1] * (first.ndim - 2))
        with np.errstate(invalid="ignore"):  # of infinity and NaN, which images of renderers hold
            values = before + share * (after.astype(np.float32) - before)
        values = values if first.dtype == np.float32 else np.rint(values)
        result[part] = np.where(share < 1, values, after)
        return result

    return view(image).map(mixed, view(other))
