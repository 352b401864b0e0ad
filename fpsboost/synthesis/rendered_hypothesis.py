"""A renderer's motion as one more hypothesis beside those that are found in the images.

Surfaces move as the renderer says, and what is seen in them or through them as the images say. Neither is known to hold
at a pixel, so both in-between images are made, and weighted there by how well the two frames agree along each motion:
by the same measure that weights the candidate motions of `MultiHypothesis`.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from fpsboost.frame_cache import FrameCache
from fpsboost.io.vector_folder import FrameVectors, VectorFolder
from fpsboost.kernels.rendered import Source, mix_along
from fpsboost.kernels.reproject import search_iteratively
from fpsboost.motion.field import MotionField, forward_backward_error
from fpsboost.motion.rendered import frame_number, output_frame_between

CONSISTENCY_TOLERANCE = 1.5
"""Maximum forward-backward error of a surface that both frames show, in pixels for each output frame between them:
vectors that span several frames are extrapolated."""

MAX_ITERATIONS = 10
"""Maximum number of iterations of the search for the pixel that lands on another, as in `Reproject`."""

PATCH_SIZE = 9
"""Side of the patches over which agreement is averaged, pixels, about that of the patches of `MultiHypothesis`."""


class SurfaceHypothesis(NamedTuple):
    """In-between image along the renderer's motion."""

    image: NDArray[Any]
    """Colours in units of the spline coefficients, (H, W, C) float32."""
    similarity: NDArray[Any]
    """Agreement of the two frames around each pixel, (H, W) float32 in [0, 1]; 0 where neither shows the surface."""


def follow_surfaces(
    images: tuple[FrameCache, FrameCache],
    coefficients: tuple[NDArray[Any], NDArray[Any]],
    t: float,
    vectors: VectorFolder,
    scale: float,
) -> SurfaceHypothesis:
    """Make the in-between image along the renderer's vectors.

    The in-between frame's own vectors lead from each of its pixels to both frames. Without them, each pixel is searched
    in both frames among those that their vectors lead to it (Yang et al. 2011, image-based; see `Reproject`).

    Parameters
    ----------
    images : tuple of FrameCache
        The two frames, which are output frames.
    coefficients : tuple of (C, rows, columns) float32
        Their spline coefficients; see `fpsboost.kernels.spline`.
    t : float
        Time between them, that of an output frame.
    vectors : VectorFolder
        Of both frames, and of the in-between frame if it was rendered too.
    scale : float
        Factor on squared differences of colours, summed over the channels.

    Raises
    ------
    OptionError
        The three are not output frames.
    InputError
        One of the two frames has no vectors, or vectors are of another size.
    """
    number = output_frame_between(images[0].output_position, images[1].output_position, t)
    numbers = [frame_number(image.output_position) for image in images]
    ends = [vectors.for_image(other, image.pixels) for other, image in zip(numbers, images, strict=True)]
    distances = [(other - number) * vectors.step for other in numbers]
    if vectors.has(number):
        here = vectors.for_image(number, images[0].pixels)
        seen = [_seen_from(here, there, distance) for there, distance in zip(ends, distances, strict=True)]
    else:
        seen = [_landed(there, -distance) for there, distance in zip(ends, distances, strict=True)]
    sources = [Source(planes, *each) for planes, each in zip(coefficients, seen, strict=True)]
    height, width = images[0].pixels.shape[:2]
    mixed = np.empty((coefficients[0].shape[0], height, width), np.float32)
    squared = np.empty((height, width), np.float32)
    mix_along(*sources, np.float32(t), mixed, squared)
    alike = np.exp(cv2.blur(squared, (2, 2)) * np.float32(-scale))
    similarity = cv2.blur(alike, (PATCH_SIZE, PATCH_SIZE))
    similarity[~(sources[0].is_visible | sources[1].is_visible)] = 0
    return SurfaceHypothesis(mixed.transpose(1, 2, 0), similarity)


def _seen_from(here: FrameVectors, there: FrameVectors, distance: int) -> tuple[NDArray[Any], NDArray[Any]]:
    """Return the motion of the in-between frame's pixels to another frame, and which of them that frame shows.

    Parameters
    ----------
    here, there : FrameVectors
        Those of the in-between and of the other frame.
    distance : int
        Number of vectors to the other frame; negative if it is the earlier one.
    """
    motion, back = _displacement(here, distance), _displacement(there, -distance)
    height, width = motion.shape[:2]
    rows, columns = np.arange(height), np.arange(width)
    error = forward_backward_error(motion, rows, columns, MotionField(back, back[..., 0]))
    y, x = motion[..., 1] + rows[:, np.newaxis].astype(np.float32), motion[..., 0] + columns.astype(np.float32)
    is_visible = error <= CONSISTENCY_TOLERANCE * abs(distance)
    is_visible &= (x >= -0.5) & (x <= width - 0.5) & (y >= -0.5) & (y <= height - 0.5)
    return motion, is_visible


def _landed(there: FrameVectors, distance: int) -> tuple[NDArray[Any], NDArray[Any]]:
    """Return the same without vectors of the in-between frame, from the pixels of the other frame that land there."""
    flow = _displacement(there, distance)
    height, width = flow.shape[:2]
    source, is_visible = np.empty((height, width), np.int32), np.empty((height, width), np.bool_)
    search_iteratively(flow, np.float32(1), MAX_ITERATIONS, source, is_visible)
    return -flow.reshape(-1, 2)[source], is_visible


def _displacement(vectors: FrameVectors, distance: int) -> NDArray[Any]:
    """Return the displacement over several vectors, (H, W, 2) float32, at constant acceleration."""
    far, velocity = np.float32(distance), (vectors.forward - vectors.backward) / 2
    displacement: NDArray[Any] = far * velocity + far * far / 2 * (vectors.forward + vectors.backward)
    return displacement
