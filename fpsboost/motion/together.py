"""Several estimators' opinions of the same motion."""

from __future__ import annotations

from dataclasses import dataclass, replace

from fpsboost.frame import Image
from fpsboost.motion import MotionEstimator
from fpsboost.motion.field import MotionField


@dataclass(frozen=True)
class Together:
    """The first estimator's fields, with what the others find as alternatives.

    Parameters
    ----------
    first : MotionEstimator
    others : tuple of MotionEstimator
    """

    first: MotionEstimator
    others: tuple[MotionEstimator, ...]

    def estimate(self, image0: Image, image1: Image) -> tuple[MotionField, MotionField]:
        """See `fpsboost.motion.MotionEstimator.estimate`."""
        found = [estimator.estimate(image0, image1) for estimator in (self.first, *self.others)]
        field01, field10 = (
            replace(fields[0], alternatives=tuple(field.flow for field in fields[1:]))
            for fields in zip(*found, strict=True)
        )
        return field01, field10
