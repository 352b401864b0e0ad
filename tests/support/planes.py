"""Frames as the kernels of the search take them, and parts of kernels by themselves."""

import numpy as np
from numpy.typing import NDArray

from fpsboost.kernels.constants import LANES
from fpsboost.kernels.planes import PlanePair


def plane_pair(image0: NDArray, image1: NDArray, padding: int, most: int) -> PlanePair:
    """Planes of both frames, (H, W, C), with repeated edges."""
    sides = (0, 0), (padding, padding), (padding, padding + LANES)
    padded = [np.pad(image.transpose(2, 0, 1), sides, "edge") for image in (image0, image1)]
    return PlanePair(*map(np.ascontiguousarray, padded), padding, *image0.shape[:2], np.uint8(most))


def points(size: tuple[int, int], step: int) -> tuple[int, int]:
    """How many points there are, down and across."""
    return -(-size[0] // step), -(-size[1] // step)
