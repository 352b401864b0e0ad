"""Detection of static overlays on moving frames: titles, logos, the car that the camera follows."""

from typing import Annotated, NamedTuple

import numpy as np

from fpsboost.kernels.binding import Array, compiled

STATIC, STATIC_CONTRAST = 1, 2


class Frames(NamedTuple):
    """Luma of a pair and of the frames before and after it, all of one type; an overlay is the same in all."""

    image0: Annotated[Array, "uint8|uint16 (height, width)"]
    image1: Annotated[Array, "uint8|uint16 (height, width)"]
    before: Annotated[Array, "uint8|uint16 (height, width)"]
    after: Annotated[Array, "uint8|uint16 (height, width)"]


@compiled
def mark_overlay(
    frames: Frames,
    motion: Annotated[Array, "float32 (rows, columns, 2)"],
    spacing: int,
    shortest: np.float32,
    same: int,
    different: int,
    smallest: Annotated[Array, "uint8|uint16 (width,)"],
    marks: Annotated[Array, "uint8 (height, width)"],
) -> None:
    """Find the pixels that stay the same although their surroundings move.

    - `motion`: of the surroundings of each block of `spacing` pixels, to frame 1
    - `shortest`: motion below which the surroundings count as static, pixels
    - `same`, `different`: difference in code values up to which a pixel is the same, and above which it is different
    - `smallest`: work array of the type of the frames
    - `marks`: out: STATIC where a pixel stays the same, STATIC_CONTRAST where it would also be different if it had
      moved, else 0
    """
