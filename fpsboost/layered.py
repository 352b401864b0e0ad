"""Images with further layers: the passes of a renderer beside the picture.

Motion, scene cuts and duplicates are found on the picture alone; the layers go where it goes, each as what it is.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Literal, Self

import numpy as np
from numpy.typing import NDArray

LayerKind = Literal["linear", "depth", "normals", "nearest"]
"""What the values of a layer are.

``linear``
    Colours, and whatever else may be averaged: light, masks, mist, positions.
``depth``
    Distances from the camera.
``normals``
    Three components of directions.
``nearest``
    What is never averaged: object numbers, Cryptomatte's ranks, motion vectors, texture coordinates.
"""


@dataclass(frozen=True, eq=False)
class Layer:
    """Channels that belong together.

    Parameters
    ----------
    name : str
        As the file has it, ``ViewLayer.DiffCol``.
    kind : {'linear', 'depth', 'normals', 'nearest'}
    planes : mapping of str to (H, W) float16, float32 or uint32
        By the full names of the channels.
    """

    name: str
    kind: LayerKind
    planes: Mapping[str, NDArray[Any]]


@dataclass(frozen=True, eq=False)
class LayeredImage:
    """Image with further layers.

    Parameters
    ----------
    colour : (H, W, C) float32
        The picture.
    layers : tuple of Layer
        All of its size.

    Examples
    --------
    >>> depth = Layer("Depth", "depth", {"Depth.Z": np.ones((4, 6), np.float32)})
    >>> LayeredImage(np.zeros((4, 6, 3), np.float32), (depth,)).shape
    (4, 6, 3)
    """

    colour: NDArray[Any]
    layers: tuple[Layer, ...]

    @property
    def shape(self) -> tuple[int, ...]:
        """Shape of the picture."""
        return self.colour.shape

    @property
    def dtype(self) -> np.dtype[Any]:
        """Type of the picture."""
        return self.colour.dtype

    def copy(self) -> Self:
        """Return a copy with a picture of its own; the layers, which nobody writes to, are shared."""
        return type(self)(self.colour.copy(), self.layers)

    def planes(self) -> dict[str, NDArray[Any]]:
        """Return the planes of all layers by the full names of their channels."""
        return {name: plane for layer in self.layers for name, plane in layer.planes.items()}
