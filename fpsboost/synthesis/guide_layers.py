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
        weighted = (
            weight * _along(planes[one.source][name].astype(np.float32), one.flow, cv2.INTER_LINEAR)
            for one, weight in zip(fused.candidates, fused.weights, strict=True)
        )
        return np.asarray(sum(weighted) / total)

    def chosen(name: str) -> np.ndarray:
        kind = planes[0][name].dtype
        bits = [
            _along(planes[one.source][name].view(f"i{kind.itemsize}"), one.flow, cv2.INTER_NEAREST)
            for one in fused.candidates
        ]
        return np.asarray(np.choose(best, bits)).view(kind)

    layers = []
    for layer in images[0].layers:
        made = mixed if layer.kind == "linear" else chosen
        filled = {name: made(name).astype(plane.dtype) for name, plane in layer.planes.items()}
        layers.append(replace(layer, planes=filled))
    return tuple(layers)


def _along(plane: np.ndarray, flow: np.ndarray | None, interpolation: int) -> np.ndarray:
    return plane if flow is None else sample(plane, flow, interpolation)
