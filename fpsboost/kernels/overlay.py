"""Detection of static overlays on moving frames: titles, logos, the car that the camera follows."""

from typing import Annotated, NamedTuple

from fpsboost.kernels.binding import Array, Float, Scratch, compiled


class FourFrames(NamedTuple):
    """Luma of a pair and of the frames before and after it; an overlay is the same in all."""

    image0: Annotated[Array, "pixel: uint8|uint16 (height, width)"]
    image1: Annotated[Array, "pixel: uint8|uint16 (height, width)"]
    before: Annotated[Array, "pixel: uint8|uint16 (height, width)"]
    after: Annotated[Array, "pixel: uint8|uint16 (height, width)"]


@compiled
def mark_overlay(
    frames: FourFrames,
    motion: Annotated[Array, "float32 (rows >= -(-height // spacing), columns >= -(-width // spacing), 2)"],
    spacing: int,
    points: Annotated[Array, "float32 (down >= -(-height // point_spacing), across >= -(-width // point_spacing), 2)"],
    point_spacing: int,
    shortest: Float,
    same: int,
    different: int,
    marks: Annotated[Array, "out uint8 (height, width)"],
    scratch: Scratch = None,
) -> None:
    """Find the pixels that stay the same although their surroundings move.

    - `motion`: of the surroundings of each block of `spacing` pixels, to frame 1
    - `points`: motion of the points themselves, of which each has `point_spacing` pixels along x and y, to frame 1
    - `shortest`: motion below which surroundings and points count as static, pixels
    - `same`, `different`: difference in code values up to which a pixel is the same, and above which it is different
    - `marks`: out: STATIC where a pixel stays the same, STATIC_CONTRAST where it would also be different if it had
      moved, else 0; no pixel of a block has STATIC_CONTRAST if of those that would, in it and in the blocks around it,
      more than MOVING_SHARE are seen where their point moves to
    """
