"""Weights of the pictures of which a guided frame is mixed, and what its guide shows beyond them."""

from typing import Annotated

from fpsboost.kernels.binding import Array, Float, Scratch, compiled


@compiled
def measure_error(
    guide: Annotated[Array, "float32 (height, width, 3)"],
    shown: Annotated[Array, "float32 (height, width, 3)"],
    side: int,
    variance: Float,
    error: Annotated[Array, "out float32 (height, width)"],
    scratch: Scratch = None,
) -> None:
    """Write the mean squared difference in the square of `side` pixels around each, less a variance; at least 0."""


@compiled
def weigh(
    errors: Annotated[Array, "float32 (count, height, width)"],
    is_own: Annotated[Array, "bool (count,)"],
    usual: Annotated[Array, "float32 (height, width)"],
    motion_error: Annotated[Array, "float32 (height, width)"],
    trust: Annotated[Array, "float32 (height, width)"],
    own_side: int,
    unsure: Float,
    unsure_share: Float,
    own_weight: Float,
    doubling_error: Float,
    shares: Annotated[Array, "out float32 (count, height, width)"],
    scratch: Scratch = None,
) -> None:
    """Weigh pictures by the cubes of the errors that are expected of them: 1 for the best, and less for the others.

    - `errors`: their squared differences from the guide
    - `is_own`: those that were made without the guide, whose errors are means over squares of `own_side` pixels
    - `usual`: squared difference of a right picture
    - `motion_error`: expected error of motion, of all others
    - `trust`: factor on the errors of own ones
    - `unsure`, `unsure_share`: what is added to all errors, and the share of the usual one that is, too
    - `own_weight`, `doubling_error`: factor on the weights of own ones, and the usual error at which it doubles
    """


@compiled
def measure_usual_power(
    difference: Annotated[Array, "float32 (height, width, 3)"],
    shown: Annotated[Array, "float32 (height, width, 3)"],
    use_median: bool,
    usual: Annotated[Array, "out float32 (BANDS, 2, BINS)"],
    scratch: Scratch = None,
) -> None:
    """Find the usual power of differences beside as much detail, in each band of a pyramid, the finest first.

    - `use_median`: of one guide, or the means of two, one below the other
    - `usual`: upper limits of the power of detail in bins that have equally many pixels, and in each the power of
      the difference
    """


@compiled
def keep_excess(
    difference: Annotated[Array, "float32 (height, width, 3)"],
    shown: Annotated[Array, "float32 (height, width, 3)"],
    usual: Annotated[Array, "float32 (BANDS, 2, BINS)"],
    excess: Float,
    kept: Annotated[Array, "out float32 (height, width, 3)"],
    scratch: Scratch = None,
) -> None:
    """Write the part of a difference whose power exceeds the usual one beside as much detail, band by band.

    - `usual`: by `measure_usual_power`
    - `excess`: multiple of the usual power that still is usual
    """
