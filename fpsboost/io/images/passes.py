"""Passes of a renderer: further layers of OpenEXR files that are read beside the picture, and written with it."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any, Self

from numpy.typing import NDArray

from fpsboost.errors import InputError
from fpsboost.image import as_array
from fpsboost.io.images.exr import decode_channels, encode_exr_like
from fpsboost.io.images.exr_header import ExrHeader, Precision, parse_exr_header
from fpsboost.io.images.exr_layers import ExrContents, LayerNames, contents_of
from fpsboost.io.images.files import picture_channels, picture_of
from fpsboost.io.memory_limit import MemoryLimit
from fpsboost.layered import FrameImage, Layer, LayeredImage

ALL, BEAUTY = "all", "beauty"
"""Which passes are made, unless some are named."""


@dataclass(frozen=True)
class Passes:
    """The layers of a sequence that are read beside its picture.

    Attributes
    ----------
    first : Path
        The file that all others must be like.
    layers : tuple of LayerNames
    precisions : tuple of Precision
        Of the layers' channels, one after the other.
    are_all : bool
        Whether no file may have more.
    pictures : tuple of str
        Names of all layers that may be meant by the picture; the first is taken.
    """

    first: Path
    layers: tuple[LayerNames, ...]
    precisions: tuple[Precision, ...]
    are_all: bool
    pictures: tuple[str, ...] = ()

    @classmethod
    def chosen(cls, path: Path, data: bytes, names: str) -> Self:
        """Return the layers that a user has named.

        Parameters
        ----------
        path : Path
            An OpenEXR file, the first of its sequence.
        data : bytes
            Its content.
        names : str
            ``all``, ``beauty``, or names of layers with commas between them, each with its view layer or without.

        Raises
        ------
        InputError
            There is no such layer, or the layers show the views of a stereo camera.
        """
        header = parse_exr_header(path, data)
        contents = contents_of(header)
        layers = tuple(_named(path, contents, names))
        if layers and contents.views:
            raise InputError(
                f"{path} holds several views ({', '.join(sorted(contents.views))}), which move differently; save each "
                "as a file of its own, or give `passes='beauty'`."
            )
        return cls(path, layers, _precisions(header, layers), names == ALL, tuple(contents.pictures))

    def decode(self, path: Path, data: bytes, limit: MemoryLimit | None) -> LayeredImage:
        """Read the picture of a file and these layers.

        Raises
        ------
        InputError
            It cannot be read, or has other layers than the first file.
        """
        header = parse_exr_header(path, data)
        picture = picture_channels(path, header)
        self._check_alike(path, header)
        names = [*picture, *(name for layer in self.layers for name in layer.channels)]
        planes = decode_channels(path, data, header, names, limit)
        layers = [
            Layer(layer.name, layer.kind, {name: planes[name] for name in layer.channels}) for layer in self.layers
        ]
        return LayeredImage(picture_of({name: planes[name] for name in picture}), tuple(layers))

    def _check_alike(self, path: Path, header: ExrHeader) -> None:
        there = {layer.name: layer for layer in contents_of(header).layers}
        missing = [layer.name for layer in self.layers if layer.name not in there]
        other = [layer.name for layer in self.layers if there.get(layer.name, layer).channels != layer.channels]
        more = [name for name in there if name not in {layer.name for layer in self.layers}] if self.are_all else []
        advice = "render all frames with the same passes, or give `passes='beauty'`."
        if missing:
            raise InputError(f"{path} has no layer {missing[0]}, which {self.first} has; {advice}")
        if other:
            raise InputError(f"{path} has other channels in the layer {other[0]} than {self.first}; {advice}")
        if more:
            raise InputError(f"{path} has a layer {more[0]}, which {self.first} has not; {advice}")
        found = _precisions(header, self.layers)
        if found != self.precisions:
            names = [name for layer in self.layers for name in layer.channels]
            place = next(i for i, pair in enumerate(zip(found, self.precisions, strict=True)) if pair[0] != pair[1])
            raise InputError(
                f"{path} has {names[place]} as {found[place]}, and {self.first} as {self.precisions[place]}; {advice}"
            )


def encode_like(header: ExrHeader, image: FrameImage) -> bytes:
    """Turn an image into the content of a file that says the same as another one; see `encode_exr_like`.

    Parameters
    ----------
    header : ExrHeader
        Of a file with such a picture and at least these layers.
    image : (H, W, C) float32, or LayeredImage
    """
    colour = as_array(image)
    channels = contents_of(header).picture
    places = (0, 3) if len(channels) == 2 else range(len(channels))
    planes: dict[str, NDArray[Any]] = {name: colour[..., i] for name, i in zip(channels, places, strict=True)}
    if isinstance(image, LayeredImage):  # an array has no names of channels
        planes |= image.planes()
    return encode_exr_like(header, planes)


def losses_like(header: ExrHeader) -> list[str]:
    """Say what a file made like another one does not have, each as the end of a sentence about the other one."""
    lost = []
    if any(part.data != part.display for part in header.parts):
        lost.append("have pixels elsewhere than in the display window, where those of the frames between are")
    if any(part.is_tiled and part.attributes["tiles"].value[8] & 15 for part in header.parts):
        lost.append("hold smaller copies of their images, which the frames between do not")
    return lost


def _named(path: Path, contents: ExrContents, names: str) -> list[LayerNames]:
    """Return the layers that are named, without the picture."""
    if names in (ALL, BEAUTY):
        return contents.layers if names == ALL else []
    wanted = list[str]()
    for name in (each.strip() for each in names.split(",")):
        found = [layer.name for layer in contents.layers if layer.is_called(name)]
        is_picture = any(picture in (name,) or picture.endswith(f".{name}") for picture in contents.pictures[:1])
        if not found and not is_picture and name != BEAUTY:
            known = ", ".join(layer.name for layer in contents.layers) or "none"
            raise InputError(f"{path} has no layer {name!r} beside its picture; choose from those it has: {known}.")
        wanted += found
    return [layer for layer in contents.layers if layer.name in wanted]


def _precisions(header: ExrHeader, layers: tuple[LayerNames, ...]) -> tuple[Precision, ...]:
    return tuple(header.channels[name] for layer in layers for name in layer.channels)
