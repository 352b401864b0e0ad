"""Motion vectors written by a renderer: the contract of their readers, and a motion estimator.

A renderer knows the exact motion of its surfaces, but not that of shadows, reflections and refractions.
`MultiHypothesis` therefore takes the vectors as one hypothesis among others, and `ExhaustiveSearch` as a bound of its
search; `RenderedMotion` and `SceneAssisted` follow them everywhere.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from fractions import Fraction
from typing import Any, ClassVar, NamedTuple, Protocol, runtime_checkable

import numpy as np

from fpsboost.errors import OptionError
from fpsboost.frame_cache import FrameCache
from fpsboost.image import Pixels
from fpsboost.image_checks import check_pair
from fpsboost.motion.field import MotionField, ZeroMotion


class FrameVectors(NamedTuple):
    """Motion vectors and depth of one output frame."""

    backward: np.ndarray
    """(H, W, 2) float32, to the previous output frame, y down."""
    forward: np.ndarray
    """(H, W, 2) float32, to the next output frame, y down."""
    depth: np.ndarray | None
    """(H, W) float32, distance from the camera in any unit, infinite where nothing is; None if it is not known."""


@runtime_checkable
class RenderedVectors(Protocol):
    """Contract: motion vectors for every frame at the output rate, such as `fpsboost.render.folder.VectorFolder`.

    Any object with these members may be passed as `vectors`, for instance one that generates them.
    """

    step: int
    """Number of vectors from one output frame to the next."""

    @property
    def remarks(self) -> Sequence[str]:
        """Remarks on what was assumed, such as a convention found by comparing frames."""

    def has(self, number: int) -> bool:
        """Return whether there are vectors for an output frame, counted from 0."""

    def for_image(self, number: int, image: Pixels) -> FrameVectors:
        """Return the vectors of an output frame, counted from 0, which must have the size of the image.

        Raises
        ------
        InputError
            The frame has no vectors, they cannot be read, or they are of another size.
        """


@runtime_checkable
class UsesVectors(Protocol):
    """Contract: an estimator or synthesizer, a dataclass, that may read a renderer's motion vectors.

    `vectors` is None where it does not read any.
    """

    needs_every_frame: bool
    """Whether it has motion only from each frame to the very next one, so that no frame may be left out."""

    @property
    def vectors(self) -> RenderedVectors | None: ...

    def without_vectors(self) -> Any:
        """Return the nearest equivalent that reads no vectors, for clips that have none."""


@dataclass(frozen=True)
class RenderedMotion:
    """A renderer's motion vectors of each of the two frames, extrapolated linearly to the other frame.

    Vectors span one output frame; for a pair that is several frames apart, they are multiplied by the distance.

    Parameters
    ----------
    vectors : RenderedVectors
        Motion vectors of every output frame.
    """

    needs_every_frame: ClassVar[bool] = True

    vectors: RenderedVectors

    def without_vectors(self) -> ZeroMotion:
        """Return zero motion, as there is nothing else to estimate it from."""
        return ZeroMotion()

    def estimate(self, image0: FrameCache, image1: FrameCache) -> tuple[MotionField, MotionField]:
        """Return the motion in both directions; see `fpsboost.motion.MotionEstimator.estimate`.

        Raises
        ------
        OptionError
            The images are not output frames, because the factor is no whole number.
        InputError
            The images have no vectors of their size.
        """
        check_pair(image0.array, image1.array)
        number0 = frame_number(image0.output_position)
        number1 = frame_number(image1.output_position)
        span = np.float32((number1 - number0) * self.vectors.step)
        forward = self.vectors.for_image(number0, image0.array).forward
        backward = self.vectors.for_image(number1, image1.array).backward
        return MotionField(forward * span), MotionField(backward * span)


def frame_number(place: Fraction | None) -> int:
    """Return the number of the output frame at a position; raises `OptionError` if no frame lies there."""
    if place is None or place.denominator != 1:
        raise OptionError(
            "A renderer's motion vectors need a whole factor, so that every input frame is an output frame too; "
            "give `factor=2` or another whole number."
        )
    return int(place)


def output_frame_between(place0: Fraction | None, place1: Fraction | None, t: float) -> int:
    """Return the number of the output frame at time t between two positions.

    Raises `OptionError` if no output frame lies there.
    """
    if place0 is None or place1 is None:
        return frame_number(None)  # which raises
    place = place0 + Fraction(t) * (place1 - place0)
    nearest = round(place)
    return frame_number(Fraction(nearest) if abs(place - nearest) < 1e-6 else place)
