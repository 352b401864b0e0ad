"""Images with further layers: the passes of a renderer beside the picture.

Motion, scene cuts and duplicates are found on the picture alone; the layers go where it goes, each as what it is.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import Literal, Self

import numpy as np
from numpy.typing import NDArray

from fpsboost.colour import compared_colours
from fpsboost.image import Image, ImageView, Pixels, Plane, in_type

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
    planes: Mapping[str, Plane]


@dataclass(frozen=True, eq=False)
class LayeredImage(ImageView):
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

    colour: Image
    layers: tuple[Layer, ...]

    def array(self) -> Image:
        return self.colour

    @property
    def compared(self) -> Image:
        """The picture on the scale on which scene-linear colours are compared; see `fpsboost.colour`."""
        return compared_colours(self.colour)

    def planes(self) -> dict[str, Plane]:
        """Return the planes of all layers by the full names of their channels."""
        return {name: plane for layer in self.layers for name, plane in layer.planes.items()}

    def arrays(self) -> list[np.ndarray]:
        return [self.colour, *self.planes().values()]

    def copy(self) -> Self:
        """Return a copy with a picture of its own; the layers, which are never written to, are shared."""
        return replace(self, colour=self.colour.copy())

    def deep_copy(self) -> Self:
        return replace(self, colour=self.colour.copy(), layers=self._with_planes(lambda _, plane: plane.copy()))

    def filled(self, samples: NDArray[np.int64]) -> Self:
        layers = self._with_planes(lambda k, plane: in_type(samples[..., k % 4], plane.dtype))
        return replace(self, colour=super().filled(samples), layers=layers)

    def _with_planes(self, function: Callable[[int, Plane], Plane]) -> tuple[Layer, ...]:
        """Return the layers with other planes, each a function of its place in its layer and of the plane."""
        return tuple(
            replace(each, planes={name: function(k, plane) for k, (name, plane) in enumerate(each.planes.items())})
            for each in self.layers
        )


FrameImage = Pixels | LayeredImage
"""Image data of a frame: pixels, or an array with further layers."""
