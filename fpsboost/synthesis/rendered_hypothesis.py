"""A renderer's motion as one more hypothesis beside those that are found in the images.

Surfaces move by the renderer's vectors; shadows, reflections and objects behind glass move as the images show. Neither
is known to hold at a pixel, so both in-between images are generated, and weighted there by how well the two frames
agree along each motion: by the same measure that weights the candidate motions of `MultiHypothesis`.
"""

from typing import NamedTuple

import cv2
import numpy as np

from fpsboost.frame_cache import FrameCache
from fpsboost.kernels.spline import Source, mix_along
from fpsboost.motion.field import MotionField, ends_inside, forward_backward_error
from fpsboost.motion.rendered import FrameVectors, RenderedVectors, frame_number, output_frame_between
from fpsboost.synthesis.reproject import Reproject

CONSISTENCY_TOLERANCE = 1.5
"""Maximum forward-backward error of a surface that both frames show, in pixels for each output frame between them:
vectors that span several frames are extrapolated."""

PATCH_SIZE = 9
"""Side of the patches over which agreement is averaged, pixels, about that of the patches of `MultiHypothesis`."""


class SurfaceMotion(NamedTuple):
    """Motion of the surfaces of an in-between frame to both frames, each as `_seen_from` returns it."""

    to_frame0: tuple[np.ndarray, np.ndarray]
    """Motion, (H, W, 2) float32, and whether frame 0 shows the surface, (H, W) bool."""
    to_frame1: tuple[np.ndarray, np.ndarray]
    """The same for frame 1."""
    t: float
    """Time of the in-between frame, 0 to 1."""

    def mix(self, coefficients0: np.ndarray, coefficients1: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Mix planes of both frames along the motion, given their spline coefficients; see `fpsboost.kernels.spline`.

        Returns
        -------
        mixed : (C, H, W) float32
            Mixed planes.
        squared : (H, W) float32
            Squared difference of the frames, summed over the planes; 0 where one of them does not show the surface.
        """
        height, width = self.to_frame0[1].shape
        mixed = np.empty((coefficients0.shape[0], height, width), np.float32)
        squared = np.empty((height, width), np.float32)
        sources = Source(coefficients0, *self.to_frame0), Source(coefficients1, *self.to_frame1)
        mix_along(*sources, self.t, mixed, squared)
        return mixed, squared

    def similarity(self, squared: np.ndarray, scale: float) -> np.ndarray:
        """Return the similarity of the frames around each pixel, (H, W), 0 to 1.

        `squared` is the squared difference of `mix`; `scale` is 1 / 2 v squared, as in the similarity of candidates.
        Where neither frame shows the surface, it is 0.
        """
        alike = np.exp(cv2.blur(squared, (2, 2)) * np.float32(-scale))
        similarity: np.ndarray = cv2.blur(alike, (PATCH_SIZE, PATCH_SIZE))
        similarity[~(self.to_frame0[1] | self.to_frame1[1])] = 0
        return similarity


def find_surface_motion(image0: FrameCache, image1: FrameCache, t: float, vectors: RenderedVectors) -> SurfaceMotion:
    """Return the motion of the surfaces of an in-between frame, as a renderer's vectors give it.

    The in-between frame's own vectors lead from each of its pixels to both frames. Without them, each pixel is searched
    in both frames among those that their vectors lead to it (Yang et al. 2011, image-based; see `Reproject`).

    Raises
    ------
    OptionError
        The three are not output frames.
    InputError
        One of the two frames has no vectors, or vectors are of another size.
    """
    number = output_frame_between(image0.output_position, image1.output_position, t)
    found = []
    for image in (image0, image1):
        other = frame_number(image.output_position)
        there = vectors.for_image(other, image.pixels)
        distance = (other - number) * vectors.step
        found.append(
            _seen_from(vectors.for_image(number, image.pixels), there, distance)
            if vectors.has(number)
            else _landed(there, -distance)
        )
    return SurfaceMotion(found[0], found[1], t)


def _seen_from(here: FrameVectors, there: FrameVectors, distance: int) -> tuple[np.ndarray, np.ndarray]:
    """Return the motion of the in-between frame's pixels over `distance` vectors, and where the other frame shows them.

    The distance is negative for an earlier frame. A surface is visible if its motion there and back ends where it
    began.
    """
    motion = _displacement(here, distance)
    back = _displacement(there, -distance)
    height, width = motion.shape[:2]
    error = forward_backward_error(motion, np.arange(height), np.arange(width), MotionField(back))
    return motion, (error <= CONSISTENCY_TOLERANCE * abs(distance)) & ends_inside(motion)


def _landed(there: FrameVectors, distance: int) -> tuple[np.ndarray, np.ndarray]:
    """Return the same without vectors of the in-between frame, from the pixels of the other frame that land there."""
    flow = _displacement(there, distance)
    source, is_visible = Reproject().find_sources(flow, 1)
    return -flow.reshape(-1, 2)[source], is_visible


def _displacement(vectors: FrameVectors, distance: int) -> np.ndarray:
    """Return the displacement over several vectors, (H, W, 2) float32, at constant acceleration."""
    far = np.float32(distance)
    velocity = (vectors.forward - vectors.backward) / 2
    return np.ascontiguousarray(far * velocity + far * far / 2 * (vectors.forward + vectors.backward))
