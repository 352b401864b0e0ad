"""Motion that a renderer wrote, as an estimator."""

from __future__ import annotations

from dataclasses import dataclass, replace
from fractions import Fraction
from typing import ClassVar

import numpy as np

from fpsboost.errors import OptionError
from fpsboost.frame import check_pair
from fpsboost.frame_cache import FrameCache
from fpsboost.io.vector_folder import VectorFolder
from fpsboost.motion.field import MotionField
from fpsboost.motion.zero import ZeroMotion


@dataclass(frozen=True)
class RenderedMotion:
    """The renderer's motion of each of the two frames, continued in a straight line to the other.

    Vectors go one frame far; those of a pair that lies several frames apart are made that much longer.

    Parameters
    ----------
    vectors : VectorFolder
    """

    needs_every_frame: ClassVar[bool] = True

    vectors: VectorFolder

    def with_vectors(self, vectors: VectorFolder) -> RenderedMotion:
        """See `fpsboost.io.vector_folder.UsesVectors.with_vectors`."""
        return replace(self, vectors=vectors)

    def without_vectors(self) -> ZeroMotion:
        """See `fpsboost.io.vector_folder.UsesVectors.without_vectors`."""
        return ZeroMotion()

    def estimate(self, image0: FrameCache, image1: FrameCache) -> tuple[MotionField, MotionField]:
        """See `fpsboost.motion.MotionEstimator.estimate`.

        Raises
        ------
        OptionError
            The images are not output frames.
        InputError
            They have no vectors, or some of another size.
        """
        check_pair(image0.array, image1.array)
        number0, number1 = frame_number(image0.output_position), frame_number(image1.output_position)
        span = np.float32((number1 - number0) * self.vectors.step)
        forward = self.vectors.for_image(number0, image0.array).forward
        backward = self.vectors.for_image(number1, image1.array).backward
        alike = np.ones(forward.shape[:2], np.float32)
        return MotionField(forward * span, alike), MotionField(backward * span, alike)


def frame_number(place: Fraction | None) -> int:
    """The output frame that an image is.

    Raises
    ------
    OptionError
        It is none of them.
    """
    if place is None or place.denominator != 1:
        raise not_an_output_frame()
    return int(place)


def not_an_output_frame() -> OptionError:
    """What to raise where an image has no vectors because it is none of the output's frames."""
    return OptionError(
        "A renderer's motion vectors need a whole factor, so that every input frame is an output frame too; "
        "give --factor 2 or another whole number."
    )
