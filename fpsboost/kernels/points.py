"""Kernels on the vectors of points several pixels apart: forward-backward error, gradients and accelerations."""

from typing import Annotated, NamedTuple

from fpsboost.kernels.binding import Array, Float, compiled


@compiled
def find_gradients(
    vectors: Annotated[Array, "float32 (rows, columns, 2)"],
    spacing: Float,
    gradients: Annotated[Array, "out float32 (rows, columns, 2, 2)"],
) -> None:
    """Write the gradients of vectors along both axes, using the minmod limiter; 0 at the ends of an axis.

    - `vectors`: `spacing` pixels apart
    - `gradients`: of dx and dy along x, then along y, pixels per pixel, out
    """


@compiled
def measure_forward_backward_errors(
    vectors: Annotated[Array, "float32 (rows, columns, 2)"],
    y: Annotated[Array, "int64 (rows,)"],
    x: Annotated[Array, "int64 (columns,)"],
    back: Annotated[Array, "float32 (down == -(-height // spacing), across == -(-width // spacing), 2)"],
    spacing: int,
    height: int,
    width: int,
    distance: Annotated[Array, "out float32 (rows, columns)"],
) -> None:
    """Measure the forward-backward error of vectors.

    - `vectors`: motion of the pixels in rows `y` and columns `x`
    - `back`: motion of the other frame, one vector for `spacing` x `spacing` pixels; its edges are repeated
    - `distance`: pixels, out
    """


class RoundTrip(NamedTuple):
    """Motion to another frame and back."""

    forward: Annotated[Array, "float32 (down == -(-height // spacing), across == -(-width // spacing), 2)"]
    backward: Annotated[Array, "float32 (down, across, 2)"]


class FieldLayout(NamedTuple):
    """Layout of motion fields that have one vector for `spacing` x `spacing` pixels of a frame."""

    spacing: int
    height: int
    width: int


@compiled
def find_accelerations(
    onward: RoundTrip,
    away: RoundTrip,
    layout: FieldLayout,
    y: Annotated[Array, "int64 (rows,)"],
    x: Annotated[Array, "int64 (columns,)"],
    ratio: float,
    consistent: Float,
    changes: Annotated[Array, "out float32 (rows, columns, 3)"],
) -> None:
    """Estimate the acceleration at the frame that two neighbouring pairs share.

    - `onward`, `away`: motion from the shared frame to the other frame of the pair, and to that of the neighbouring
      pair
    - `y`, `x`: rows and columns of the points
    - `ratio`: duration of the neighbouring pair divided by that of the pair
    - `consistent`: maximum forward-backward error of a valid vector, pixels; a valid vector also ends within the frame
    - `changes`: 1 where both vectors are valid, and the acceleration, pixels per interval squared; else 0; out
    """
