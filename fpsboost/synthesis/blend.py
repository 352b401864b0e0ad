"""In-between frames that need no motion."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import cv2

from fpsboost.frame import Image
from fpsboost.synthesis import Transition


@dataclass(frozen=True)
class Blend:
    """Mix the two frames in time, without motion."""

    def synthesize(self, transition: Transition, times: Sequence[float]) -> Iterator[Image]:
        """See `fpsboost.synthesis.Synthesizer.synthesize`; only the frames are looked at."""
        image0, image1 = transition.image0.pixels, transition.image1.pixels
        for t in times:
            mixed = cv2.addWeighted(image0, 1 - t, image1, t, 0)
            yield mixed.reshape(image0.shape)


@dataclass(frozen=True)
class Nearest:
    """Repeat the frame that is nearer in time; the earlier one at the middle."""

    def synthesize(self, transition: Transition, times: Sequence[float]) -> Iterator[Image]:
        """See `fpsboost.synthesis.Synthesizer.synthesize`; only the frames are looked at."""
        image0, image1 = transition.image0.pixels, transition.image1.pixels
        for t in times:
            yield (image0 if t <= 0.5 else image1).copy()
