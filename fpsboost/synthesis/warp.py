"""Methods that follow one motion for each pixel: the usual backward warp, and the forward splatting of video coding."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Annotated

import cv2
import numpy as np

from fpsboost.colour import premultiplied
from fpsboost.image import Image, as_image, rounding_offset
from fpsboost.kernels.reproject import fetch_both, splat
from fpsboost.options import Checked, Range
from fpsboost.synthesis import FramePair
from fpsboost.synthesis.agreement import sample


@dataclass(frozen=True)
class Warp:
    """Blend of backward warps, ``(1 - t) image0(x - t flow01(x)) + t image1(x - (1 - t) flow10(x))``.

    Sampling is bilinear, with repeated edges. This is the usual warp along an optical flow. The motion is read at the
    target pixel, although it belongs to another one: around moving objects the background is dragged along, and pixels
    that are occluded in one frame are blended in.
    """

    def synthesize(self, frame_pair: FramePair, times: Sequence[float]) -> Iterator[Image]:
        """Generate images with linear trajectories; see `fpsboost.synthesis.Synthesizer.synthesize`."""
        for t in times:
            mean = (1 - t) * _backward_warp(frame_pair.image0.cached(premultiplied), frame_pair.field01.flow, t)
            mean += t * _backward_warp(frame_pair.image1.cached(premultiplied), frame_pair.field10.flow, 1 - t)
            yield as_image(mean, frame_pair.image0.array, frame_pair.image1.array, t)


@dataclass(frozen=True)
class Extrapolate:
    """Extrapolation of each frame along its own motion up to the middle, for scene cuts without motion across.

    The fields of the pair are each frame's own continuation: `field01` leads to where the pixels of frame 0 are going,
    `field10` to where those of frame 1 have come from, reversed in time.
    """

    def synthesize(self, frame_pair: FramePair, times: Sequence[float]) -> Iterator[Image]:
        """Extrapolate the nearer frame, at the middle the earlier; see `fpsboost.synthesis.Synthesizer.synthesize`."""
        for t in times:
            image, field, time = (
                (frame_pair.image0, frame_pair.field01, t)
                if t <= 0.5
                else (frame_pair.image1, frame_pair.field10, 1 - t)
            )
            fetched = _backward_warp(image.cached(premultiplied), field.flow, time)
            yield as_image(fetched, frame_pair.image0.array, frame_pair.image1.array, float(t > 0.5))


def _backward_warp(values: np.ndarray, flow: np.ndarray, t: float) -> np.ndarray:
    """Return each pixel's value at the place that it has come from, bilinearly."""
    return sample(values, -np.float32(t) * flow, cv2.INTER_LINEAR)


@dataclass(frozen=True)
class Splat(Checked):
    """Forward splatting of the pixels of frame 0 to time t (forward reprojection, section 2.1 of the report).

    A pixel of sufficient similarity lands on the nearest target, with the colours of both ends blended in time. Where
    several land, the most similar one is shown, and of several such pixels the first in raster order. Where none lands,
    the frames are blended unchanged.

    Parameters
    ----------
    least_similarity : float
        Minimum similarity of a pixel that is splatted, from 0 to 1.
    """

    least_similarity: Annotated[float, Range(0, 1)] = 0.9

    def synthesize(self, frame_pair: FramePair, times: Sequence[float]) -> Iterator[Image]:
        """Generate images with the linear motion of frame 0 only; see `fpsboost.synthesis.Synthesizer.synthesize`."""
        image0, image1 = (np.ascontiguousarray(image.array) for image in (frame_pair.image0, frame_pair.image1))
        flow = frame_pair.field01.flow
        similarity = frame_pair.field01.similarity
        valid = np.ones(similarity.shape, np.bool_)  # so that colours are always blended
        for t in times:
            source0 = np.empty(similarity.shape, np.int32)
            source1 = np.empty(similarity.shape, np.int32)
            splat(flow, similarity, self.least_similarity, t, source0, source1)
            out = np.empty_like(image0)
            fetch_both(image0, image1, t, rounding_offset(image0), source0, valid, source1, valid, out)
            yield out
