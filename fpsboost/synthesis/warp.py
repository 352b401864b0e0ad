"""The plain warp: frames fetched along the motion at the target pixel; both mixed, or each by itself."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from fpsboost.frame import Image
from fpsboost.synthesis import FramePair
from fpsboost.synthesis.rounding import as_image, premultiplied


@dataclass(frozen=True)
class Warp:
    """``(1 - t) image0(x - t flow01(x)) + t image1(x - (1 - t) flow10(x))``, bilinear, edges repeated.

    That is what people usually write around an optical flow. The motion is read at the target pixel, though it belongs
    to another one: around what moves, the background is pulled along, and what is hidden in one frame is mixed in.
    """

    def synthesize(self, frame_pair: FramePair, times: Sequence[float]) -> Iterator[Image]:
        """See `fpsboost.synthesis.Synthesizer.synthesize`; paths are straight."""
        for t in times:
            mean = (1 - t) * _fetched(frame_pair.image0.cached(premultiplied), frame_pair.field01.flow, t)
            mean += t * _fetched(frame_pair.image1.cached(premultiplied), frame_pair.field10.flow, 1 - t)
            yield as_image(mean, frame_pair.image0.array, frame_pair.image1.array, t)


@dataclass(frozen=True)
class Extrapolate:
    """Each frame alone, moved on along its own motion up to the middle: for scene cuts, where no way leads across.

    The transition's fields are how each frame would go on: `field01` where the pixels of frame 0 are going, `field10`
    where those of frame 1 have come from, reversed in time.
    """

    def synthesize(self, frame_pair: FramePair, times: Sequence[float]) -> Iterator[Image]:
        """See `fpsboost.synthesis.Synthesizer.synthesize`; the earlier frame has the middle."""
        for t in times:
            image, field, time = (
                (frame_pair.image0, frame_pair.field01, t)
                if t <= 0.5
                else (frame_pair.image1, frame_pair.field10, 1 - t)
            )
            fetched = _fetched(image.cached(premultiplied), field.flow, time)
            yield as_image(fetched, frame_pair.image0.array, frame_pair.image1.array, float(t > 0.5))


def _fetched(values: NDArray[Any], flow: NDArray[Any], t: float) -> NDArray[Any]:
    """What lies t of the motion behind every pixel."""
    height, width = flow.shape[:2]
    y, x = np.arange(height, dtype=np.float32)[:, np.newaxis], np.arange(width, dtype=np.float32)
    time = np.float32(t)
    fetched = cv2.remap(
        values,
        x - time * flow[..., 0],
        y - time * flow[..., 1],
        cv2.INTER_LINEAR,
        borderMode=cv2.BORDER_REPLICATE,
    )
    return fetched.reshape(values.shape)
