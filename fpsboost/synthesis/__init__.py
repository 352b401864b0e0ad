"""In-between frames from two frames and the motion between them.

One contract, `Synthesizer`, and its implementations: `Reproject` (the report's), `TwoSidedBlend` (the default), `Blend`
and `Nearest` (which need no motion).
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Protocol

from fpsboost.frame import Image
from fpsboost.motion.field import MotionField


class Synthesizer(Protocol):
    """Contract: what does the scene look like between two frames?"""

    def synthesize(
        self, image0: Image, image1: Image, field01: MotionField, field10: MotionField, times: Sequence[float]
    ) -> Iterator[Image]:
        """Make one image for every time.

        Parameters
        ----------
        image0, image1 : (H, W, C) uint8, uint16 or float32
            Two frames of one size and type.
        field01, field10 : MotionField
            Motion in both directions.
        times : sequence of float
            Each in (0, 1).

        Yields
        ------
        (H, W, C), dtype of the frames
            New arrays; made one at a time, so that any number of them needs the memory of one.
        """
        ...
