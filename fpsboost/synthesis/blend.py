"""In-between frames that need no motion."""

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
    """Mix the two frames in time, without motion."""

    takes_planes: ClassVar[bool] = True

    def synthesize(self, frame_pair: FramePair, times: Sequence[float]) -> Iterator[Pixels]:
        """See `fpsboost.synthesis.Synthesizer.synthesize`; only the frames are looked at."""
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
    """Repeat the frame that is nearer in time; the earlier one at the middle."""

    takes_planes: ClassVar[bool] = True

    def synthesize(self, frame_pair: FramePair, times: Sequence[float]) -> Iterator[Pixels]:
        """See `fpsboost.synthesis.Synthesizer.synthesize`; only the frames are looked at."""
        image0, image1 = frame_pair.image0.pixels, frame_pair.image1.pixels
        for t in times:
            yield (image0 if t <= 0.5 else image1).copy()
