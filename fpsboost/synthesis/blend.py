"""In-between frames that need no motion."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import cv2
from numpy.typing import NDArray

from fpsboost.frame import Image
from fpsboost.motion.field import MotionField


@dataclass(frozen=True)
class Blend:
    """Mix the two frames in time, without motion."""

    def synthesize(
        self,
        image0: Image,
        image1: Image,
        field01: MotionField,
        field10: MotionField,
        times: Sequence[float],
        acceleration: NDArray[Any] | None = None,
    ) -> Iterator[Image]:
        """See `fpsboost.synthesis.Synthesizer.synthesize`; neither the fields nor the acceleration are looked at."""
        for t in times:
            mixed = cv2.addWeighted(image0, 1 - t, image1, t, 0)
            yield mixed.reshape(image0.shape)


@dataclass(frozen=True)
class Nearest:
    """Repeat the frame that is nearer in time; the earlier one at the middle."""

    def synthesize(
        self,
        image0: Image,
        image1: Image,
        field01: MotionField,
        field10: MotionField,
        times: Sequence[float],
        acceleration: NDArray[Any] | None = None,
    ) -> Iterator[Image]:
        """See `fpsboost.synthesis.Synthesizer.synthesize`; neither the fields nor the acceleration are looked at."""
        for t in times:
            yield (image0 if t <= 0.5 else image1).copy()
