"""In-between frames from two frames and the motion between them.

One contract, `Synthesizer`, and its implementations: `Fuse` (the default), `Reproject` (the report's), `Blend` and
`Nearest` (which need no motion).
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any, Protocol

from numpy.typing import NDArray

from fpsboost.frame import Image
from fpsboost.motion.field import MotionField


class Synthesizer(Protocol):
    """Contract: what does the scene look like between two frames?"""

    def synthesize(
        self,
        image0: Image,
        image1: Image,
        field01: MotionField,
        field10: MotionField,
        times: Sequence[float],
        acceleration: NDArray[Any] | None = None,
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
        acceleration : (rows, columns, 2) float32, optional
            How the motion through each cell changes; see `fpsboost.motion.trajectory`. Constant speed without it.

        Yields
        ------
        (H, W, C), dtype of the frames
            New arrays; made one at a time, so that any number of them needs the memory of one.
        """
        ...
