"""Candidates of which a guided frame is mixed, and the further layers of one, which have the weights of its picture."""

from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import cv2
import numpy as np

from fpsboost.layered import Layer, LayeredImage
from fpsboost.synthesis.agreement import sample


class Candidate(NamedTuple):
    """Picture of which a guided frame is mixed."""

    values: np.ndarray
    """(H, W, C); see `Colours.values`."""
    error: np.ndarray
    """Squared difference from the guide around each pixel of it, square levels."""
    source: int
    """0 or 1 for a frame, 2 for the frame that is made without a guide."""
    flow: np.ndarray | None
    """Motion from each pixel to its source, (H, W, 2) float32; None if there is none."""
    warped_guide: np.ndarray | None = None
    """The guide of its frame along the same motion, levels, if light or shading is another one."""


class Fused(NamedTuple):
    """Mean of candidates."""

    values: np.ndarray
    """(H, W, C) float32."""
    error: np.ndarray
    """Squared difference of the best candidate from the guide around each pixel of it, square levels."""
    candidates: list[Candidate]
    weights: list[np.ndarray]
    """Weight of each at every pixel of the frame, (H, W) float32; their sum is not 1."""


def mixed_layers(fused: Fused, images: Sequence[LayeredImage]) -> tuple[Layer, ...]:
    """Return further layers with the weights of the picture: linear ones mixed, the others from the best candidate.

    Nothing of the guide is added to them.
    """
    planes = [image.planes() for image in images]
    best = np.argmax(fused.weights, axis=0)
    total = np.sum(fused.weights, axis=0)

    def mixed(name: str) -> np.ndarray:
        each = zip(fused.candidates, fused.weights, strict=True)
        weighted = (weight * _sampled(planes[one.source][name], one.flow) for one, weight in each)
        return np.asarray(sum(weighted) / total)

    def chosen(name: str) -> np.ndarray:
        return np.asarray(np.choose(best, [_nearest(planes[one.source][name], one.flow) for one in fused.candidates]))

    layers = []
    for layer in images[0].layers:
        made = mixed if layer.kind == "linear" else chosen
        filled = {name: made(name).astype(plane.dtype, copy=False) for name, plane in layer.planes.items()}
        layers.append(replace(layer, planes=filled))
    return tuple(layers)


def _sampled(plane: np.ndarray, flow: np.ndarray | None) -> np.ndarray:
    values = plane.astype(np.float32)
    return values if flow is None else sample(values, flow, cv2.INTER_LINEAR)


def _nearest(plane: np.ndarray, flow: np.ndarray | None) -> np.ndarray:
    """Return the values of the pixels nearest to the end of the motion, unmixed."""
    if flow is None:
        return plane
    places = np.arange(plane.size, dtype=np.float64).reshape(plane.shape)
    return np.asarray(plane.ravel()[sample(places, flow, cv2.INTER_NEAREST).astype(np.intp)])
