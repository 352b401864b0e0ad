"""In-between frames without motion: blending and frame repetition.

They are baselines, and what other methods fall back to.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from typing import ClassVar

import cv2
import numpy as np

from fpsboost.image import Pixels, view
from fpsboost.layered import LayeredImage
from fpsboost.synthesis import FramePair
from fpsboost.synthesis.layers import Mixed, Planes, Sources, mix_layers


@dataclass(frozen=True)
class Blend:
    """Blend of the two frames by time, without motion.

    Examples
    --------
    >>> from fpsboost import FrameCache
    >>> from fpsboost.motion.field import ZeroMotion
    >>> black, white = (FrameCache(np.full((8, 8, 3), level, np.uint8)) for level in (0, 200))
    >>> pair = FramePair(black, white, *ZeroMotion().estimate(black, white))
    >>> [int(image[0, 0, 0]) for image in Blend().synthesize(pair, [0.25, 0.5])]
    [50, 100]
    """

    takes_planes: ClassVar[bool] = True

    def synthesize(self, frame_pair: FramePair, times: Sequence[float]) -> Iterator[Pixels]:
        """Generate mixtures of both frames by time; see `fpsboost.synthesis.Synthesizer.synthesize`."""
        image0 = frame_pair.image0.pixels
        image1 = frame_pair.image1.pixels
        for t in times:
            yield view(image0).mix(view(image1), t)

    def synthesize_layers(
        self, frame_pair: FramePair, layered: tuple[LayeredImage, LayeredImage], times: Sequence[float]
    ) -> Iterator[LayeredImage]:
        """Generate blended images with all layers; see `fpsboost.synthesis.layers.MixesLayers`."""
        for t in times:
            yield mix_layers(layered, partial(_mix_planes, t), partial(_at_rest, layered[0].shape, t))


def _at_rest(shape: tuple[int, ...], t: float) -> Sources:
    """Return each pixel's own place in both frames, taken from the frame that is nearer in time."""
    y, x = np.indices(shape[:2])
    return Sources((y, x), (y, x), np.full(shape[:2], t > 0.5), np.zeros(shape[:2], bool), t)


def _mix_planes(t: float, planes0: Planes, planes1: Planes) -> Mixed:
    """Return planes of both frames mixed by time; without motion, there is no spline that could overshoot."""
    mixed = np.stack(
        [cv2.addWeighted(plane0, 1 - t, plane1, t, 0) for plane0, plane1 in zip(planes0, planes1, strict=True)]
    )
    return Mixed(mixed, mixed)


@dataclass(frozen=True)
class Nearest:
    """Repetition of the frame that is nearer in time; the earlier one at the middle.

    Copies are yielded, so that a caller may change them.
    """

    takes_planes: ClassVar[bool] = True

    def synthesize(self, frame_pair: FramePair, times: Sequence[float]) -> Iterator[Pixels]:
        """Generate copies of the nearer frame; see `fpsboost.synthesis.Synthesizer.synthesize`."""
        image0 = frame_pair.image0.pixels
        image1 = frame_pair.image1.pixels
        for t in times:
            yield (image0 if t <= 0.5 else image1).copy()

    def synthesize_layers(
        self, frame_pair: FramePair, layered: tuple[LayeredImage, LayeredImage], times: Sequence[float]
    ) -> Iterator[LayeredImage]:
        """Generate copies of the nearer frame with all layers; see `fpsboost.synthesis.layers.MixesLayers`."""
        for t in times:
            yield layered[0 if t <= 0.5 else 1].copy()
