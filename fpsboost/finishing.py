"""Last steps of an in-between image: illumination, grain, overlays, and the frames themselves where it is unsure."""

from collections.abc import Iterator, Sequence

import cv2
import numpy as np

from fpsboost.analysis.grain import match_grain
from fpsboost.analysis.overlay import find_overlay, keep_overlay
from fpsboost.frame_cache import FrameCache
from fpsboost.image import Pixels, view
from fpsboost.options import Uncertain
from fpsboost.pair import Pair, as_bgr
from fpsboost.synthesis import InterpolatedImage
from fpsboost.synthesis.agreement import mix_by_weight

RAMP = 0.1
"""Difference of confidence from the limit at which the weight of the fallback reaches 0 or 1."""

SOFTNESS = 1 / 80  # standard deviation of the blur of confidence, as a fraction of the frame's longer side

MAX_UNSURE = 0.2
"""Largest share of uncertain pixels of a frame that is not held."""


def finish(
    images: Iterator[InterpolatedImage], times: Sequence[float], pair: Pair, *, overlays: bool, grain: bool
) -> Iterator[InterpolatedImage]:
    """Yield images with the illumination of their time, with grain, and with overlays as they are in the frames.

    Parameters
    ----------
    images : iterator of InterpolatedImage
        Images along the motion of the pair, under the illumination of its first frame.
    times : sequence of float
        Their times, each in (0, 1).
    pair : Pair
        The two frames, with their neighbours.
    overlays, grain : bool
        Whether overlays are kept, and grain is matched; see `fpsboost.Interpolator`.
    """
    illumination = pair.illumination
    overlay = _overlay(pair) if overlays else None
    position = pair.image0.source_position
    number = 0 if position is None else position.number
    for (synthesized, confidence), t in zip(images, times, strict=True):
        image = synthesized
        if illumination is not None:
            image = illumination.apply(view(image).array(), t, pair.image0.pixels.dtype)
        if grain:
            image = match_grain(view(image).picture, pair.grain, t, (number, int(np.float64(t).view(np.uint64))))
        if overlay is not None:
            picture = view(image).picture
            keep_overlay(picture, _like(picture, pair.image0), _like(picture, pair.image1), t, overlay)
            if confidence is not None:  # found still over four frames
                confidence[overlay] = 1
        yield InterpolatedImage(image, confidence)


def _overlay(pair: Pair) -> np.ndarray | None:
    """Return where static overlays are, (H, W) bool; None without any, or if no neighbour of the pair is known."""
    illumination = pair.illumination
    # a change of all light changes overlays, too
    if not (pair.before or pair.after) or not (illumination is None or illumination.is_local):
        return None
    return find_overlay(
        pair.image0, pair.image1, (pair.before or pair).image0, (pair.after or pair).image1, pair.fields[0]
    )


def measure_uncertainty(confidence: np.ndarray, below: float, uncertain: Uncertain) -> np.ndarray:
    """Return the weight of the fallback at each pixel, (H, W) float32, 0 to 1.

    It is continuous in place and in confidence, so that no edges and no flicker appear; with ``hold``, it is 0 or 1
    everywhere.

    Parameters
    ----------
    confidence : (H, W) float32
        Confidence of the frame in the middle of a pair, whose fallback all frames of the pair share.
    below : float
        Confidence below which a pixel is uncertain.
    uncertain : {'keep', 'blend', 'nearest', 'hold'}
        Kind of fallback.
    """
    blurred = cv2.GaussianBlur(confidence, (0, 0), SOFTNESS * max(confidence.shape))
    uncertainty = ((below + RAMP - blurred) / np.float32(2 * RAMP)).clip(0, 1)
    return uncertainty if uncertain != "hold" else np.full_like(uncertainty, uncertainty.mean() > MAX_UNSURE)


def replace_unsure(
    images: Iterator[InterpolatedImage], times: Sequence[float], pair: Pair, weights: np.ndarray, *, mix: bool
) -> Iterator[InterpolatedImage]:
    """Yield images in which the two frames replace uncertain pixels.

    Parameters
    ----------
    images : iterator of InterpolatedImage
        Images of the pair; their confidence stays.
    times : sequence of float
        Their times, each in (0, 1).
    pair : Pair
        The two frames.
    weights : (H, W) float32
        Weight of the frames, see `measure_uncertainty`; pixels of weight 0 keep their value to the bit.
    mix : bool
        Whether the two frames are mixed by time, or the one that is nearer in time is shown.
    """
    for (image, confidence), t in zip(images, times, strict=True):
        picture = view(image).picture
        image0 = _like(picture, pair.image0)
        image1 = _like(picture, pair.image1)
        nearer = image0 if t <= 0.5 else image1
        fallback = view(image0).mix(view(image1), t) if mix else nearer
        yield InterpolatedImage(mix_by_weight(picture, fallback, weights), confidence)


def _like(picture: Pixels, frame: FrameCache) -> Pixels:
    """Return a frame in the form of an image made of it, which is BGR where the illumination changes."""
    return view((frame if view(picture).coding else as_bgr(frame)).image).picture
