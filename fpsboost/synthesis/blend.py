"""In-between frames without motion: blending and frame repetition."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from typing import ClassVar

import cv2

from fpsboost.frame import Image, Pixels, as_array
from fpsboost.synthesis import FramePair
from fpsboost.ycbcr import YCbCrImage


@dataclass(frozen=True)
class Blend:
    """Blend of the two frames by time, without motion."""

    takes_planes: ClassVar[bool] = True

    def synthesize(self, frame_pair: FramePair, times: Sequence[float]) -> Iterator[Pixels]:
        """Generate blended images, from the frames alone; see `fpsboost.synthesis.Synthesizer.synthesize`."""
        image0, image1 = frame_pair.image0.pixels, frame_pair.image1.pixels
        for t in times:
            if isinstance(image0, YCbCrImage) and isinstance(image1, YCbCrImage):
                yield image0.mapped(partial(_mixed, t), image1)
            else:
                yield _mixed(t, as_array(image0), as_array(image1))


def _mixed(t: float, image0: Image, image1: Image) -> Image:
    return cv2.addWeighted(image0, 1 - t, image1, t, 0).reshape(image0.shape)


@dataclass(frozen=True)
class Nearest:
    """Repetition of the frame that is nearer in time; the earlier one at the middle."""

    takes_planes: ClassVar[bool] = True

    def synthesize(self, frame_pair: FramePair, times: Sequence[float]) -> Iterator[Pixels]:
        """Generate copies of the nearer frame; see `fpsboost.synthesis.Synthesizer.synthesize`."""
        image0, image1 = frame_pair.image0.pixels, frame_pair.image1.pixels
        for t in times:
            yield (image0 if t <= 0.5 else image1).copy()
