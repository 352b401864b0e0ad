"""Candidates of which a guided frame is mixed, and the further layers of one, which have the weights of its picture."""

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from fpsboost.kernels.smooth_motion import SmoothMotion, sample_along
from fpsboost.layered import Layer, LayeredImage
from fpsboost.synthesis.guide_calibration import Rendition


class Candidate(NamedTuple):
    """Picture of which a guided frame is mixed."""

    source: int
    """0 or 1 for a frame, 2 for the frame that is made without a guide."""
    motion: SmoothMotion | None
    """Motion to its source; None if there is none."""
    error: np.ndarray
    """Squared difference from the guide around each pixel of it, square levels."""
    warped_guide: np.ndarray | None
    """The guide of its frame along the same motion, levels, if light or shading is another one."""


class Fused(NamedTuple):
    """Mean of candidates."""

    values: np.ndarray
    """(H, W, C) float32; see `Colours.values`."""
    error: np.ndarray
    """Squared difference of the best candidate from the guide around each pixel of it, square levels."""
    candidates: list[Candidate]
    shares: np.ndarray
    """Weight of each at every pixel of the guide, (count, h, w); their sum is not 1."""
    mix: Callable[[Sequence[np.ndarray]], np.ndarray]
    """Function that returns the mean of the candidates, with these weights, for other values of their sources."""


def mixed_layers(fused: Fused, rendition: Rendition, images: Sequence[LayeredImage]) -> tuple[Layer, ...]:
    """Return further layers with the weights of the picture: linear ones mixed, the others from the best candidate.

    Nothing of the guide is added to them.
    """
    planes = [image.planes() for image in images]
    best = np.argmax([rendition.raised(share) for share in fused.shares], axis=0)
    pixels = np.ascontiguousarray(np.moveaxis(np.indices(best.shape, np.float32), 0, 2))
    ends = [np.rint(sampled(pixels, each.motion)).astype(np.intp) for each in fused.candidates]

    def mixed(name: str) -> np.ndarray:
        return fused.mix([each[name].astype(np.float32)[..., np.newaxis] for each in planes])[..., 0]

    def chosen(name: str) -> np.ndarray:
        found = [
            planes[each.source][name][end[..., 0], end[..., 1]]
            for each, end in zip(fused.candidates, ends, strict=True)
        ]
        return np.asarray(np.choose(best, found))

    layers = []
    for layer in images[0].layers:
        made = mixed if layer.kind == "linear" else chosen
        filled = {name: made(name).astype(plane.dtype) for name, plane in layer.planes.items()}
        layers.append(replace(layer, planes=filled))
    return tuple(layers)


def sampled(picture: np.ndarray, motion: SmoothMotion | None) -> np.ndarray:
    """Return a picture along a motion; itself without one."""
    if motion is None:
        return picture
    found = np.empty_like(picture)
    sample_along(picture, motion, found)
    return found
