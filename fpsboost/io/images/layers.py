"""Layers of OpenEXR files: which one is the picture, the kinds of the others, and images read and written with them.

A layer is what stands before the last dot of a channel's name, in a file of several parts with the name of the part
before it: ``ViewLayer.DiffCol.R`` is the channel R of the layer ``ViewLayer.DiffCol``. Channels without a dot that are
no colours are layers of their own, such as ``Z``.
"""

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Self

import numpy as np

from fpsboost.errors import InputError
from fpsboost.image import Image, view
from fpsboost.io.images.exr import ExrHeader, Precision, encode_exr_like, read_channels, read_exr_header
from fpsboost.layered import FrameImage, Layer, LayeredImage, LayerKind
from fpsboost.memory import MemoryLimit
from fpsboost.remarks import Remarks

ALL = "all"
"""Word for all passes."""
BEAUTY = "beauty"
"""Word for the picture without passes."""

PICTURES = ("combined", "beauty", "rgba", "rgb", "composite")
"""Last words, in small letters, of the layer that is the picture where several have colours."""

_vectors = "vector vectors motion motionvector motionvectors velocity vrayvelocity motvec forward backward"
VECTORS = _vectors.split()  # words of layers with motion vectors

_words: Mapping[LayerKind, str] = {
    "depth": "depth z zdepth vrayzdepth zbuffer denoisingdepth",
    "normals": "normal normals n ns ng vraynormals vraybumpnormals denoisingnormal shnormal geonormal bumpnormals "
    "worldnormal",
    "nearest": "indexob indexma objectindex materialindex id objectid objid materialid matid renderid nodeid "
    "instanceid partid primid shapeindex primindex uv uvs st",
}
KINDS_BY_WORD: Mapping[str, LayerKind] = {
    **{word: kind for kind, words in _words.items() for word in words.split()},
    **dict.fromkeys(VECTORS, "nearest"),
}
"""Kind of a layer by the last word of its name, in small letters and without spaces, underscores and digits at its end:
names of Blender, Arnold, V-Ray, Redshift, RenderMan and Mitsuba. Any other is linear."""

CRYPTOMATTE = "crypto"  # beginning of the last word of Cryptomatte's layers


@dataclass(frozen=True)
class LayerNames:
    """Layer of an OpenEXR file, without its pixels.

    Parameters
    ----------
    name : str
        Name of the layer; empty for colours without one.
    kind : LayerKind
        Kind of its values, which determines how they are interpolated.
    channels : Mapping
        Types of its channels by their full names, in the order of the file.
    """

    name: str
    kind: LayerKind
    channels: Mapping[str, Precision]

    @property
    def has_vectors(self) -> bool:
        """Whether the layer holds motion vectors, by its name."""
        return _word_of(self.name) in VECTORS

    def channel(self, letter: str) -> str | None:
        """Return the full name of the channel with a letter, such as R; None if there is none."""
        return next((name for name in self.channels if _letter_of(name) == letter), None)


@dataclass(frozen=True)
class ExrContents:
    """Layers of a file, and which of them is the picture.

    Parameters
    ----------
    picture : list of str
        Full names of the picture's channels, in the order B, G, R, A or Y, A; empty if there is no picture.
    pictures : list of str
        Names of all layers that may be the picture, the first of which is taken.
    layers : list of LayerNames
        All other layers.
    views : frozenset of str
        Views of the eyes of a stereo camera, if the file has several.
    """

    picture: list[str]
    pictures: list[str]
    layers: list[LayerNames]
    views: frozenset[str]


def contents_of(header: ExrHeader) -> ExrContents:
    """Return the layers of a file, and which of them is the picture.

    The picture is the layer without a name, or the only one with colours, or that whose last word is one of `PICTURES`;
    of several parts without such a word, the first.
    """
    layers = _layers_of(header)
    pictures, picture = _find_picture(layers, has_parts=len(header.parts) > 1)
    rest = [
        replace(layer, channels={name: kind for name, kind in layer.channels.items() if name not in picture})
        for layer in layers
    ]
    views = {part.attributes["view"] for part in header.parts if "view" in part.attributes}
    views.update(header.parts[0].attributes.get("multiView", ()))
    several = frozenset(views) if len(views) > 1 else frozenset[str]()
    return ExrContents(picture, pictures, [layer for layer in rest if layer.channels], several)


def kind_of(name: str, precisions: Sequence[Precision]) -> LayerKind:
    """Return the kind of a layer, by its name and the types of its channels."""
    word = _word_of(name)
    if "uint" in precisions or word.startswith(CRYPTOMATTE):
        return "nearest"
    kind = KINDS_BY_WORD.get(word, "linear")
    return kind if len(precisions) == {"depth": 1, "normals": 3}.get(kind, len(precisions)) else "linear"


def _layers_of(header: ExrHeader) -> list[LayerNames]:
    """Group the channels of a file to layers, by their names."""
    groups: dict[str, list[str]] = {}
    for name in header.channels:
        groups.setdefault(name.rpartition(".")[0], []).append(name)
    layers: dict[str, dict[str, Precision]] = {}
    for prefix, names in groups.items():
        letters = {_letter_of(name) for name in names}
        own = "RGBA" if {"R", "G", "B"} <= letters else "YA" if "Y" in letters and "X" not in letters else ""
        if prefix and not own:
            layers.setdefault(prefix, {}).update((name, header.channels[name]) for name in names)
            continue
        vectors = "" if own or not {"X", "Y"} <= letters else "XYZW"
        for name in names:
            layer = prefix if _letter_of(name) in own else vectors if _letter_of(name) in vectors else name
            layers.setdefault(layer, {})[name] = header.channels[name]
    return [LayerNames(name, kind_of(name, list(channels.values())), channels) for name, channels in layers.items()]


def _find_picture(layers: Sequence[LayerNames], *, has_parts: bool) -> tuple[list[str], list[str]]:
    """Return the layers that may be the picture, and the channels of the first."""
    for colours in ("BGR", "Y"):
        whole = [layer for layer in layers if all(layer.channel(letter) for letter in colours)]
        called = [layer for layer in whole if not layer.name]
        called = called or [layer for layer in whole if _word_of(layer.name) in PICTURES]
        called = called or (whole[:1] if has_parts or len(whole) == 1 else [])
        if called:
            picture = [called[0].channel(letter) for letter in f"{colours}A"]
            return [layer.name for layer in called], [name for name in picture if name is not None]
    channels = [name for layer in layers for name in layer.channels]
    return ([layers[0].name], channels) if len(channels) == 1 else ([], [])


def _letter_of(channel: str) -> str:
    """Return the part of a channel's name after its last dot."""
    return channel.rpartition(".")[2]


def _word_of(layer: str) -> str:
    """Return the last word of a layer's name as `KINDS_BY_WORD` has it."""
    return re.sub(r"[\s_-]", "", layer.rpartition(".")[2]).lower().rstrip("0123456789")


def _picture_channels(path: Path, header: ExrHeader) -> list[str]:
    """Return the channels of the picture, in the order B, G, R, A or Y, A; raise `InputError` if there is none."""
    chosen = contents_of(header).picture
    if not chosen:
        raise InputError(
            f"{path} has no colours among its channels ({', '.join(header.channels)}); save R, G and B, or Y, in one "
            "layer."
        )
    return chosen


def _picture_of(channels: Mapping[str, np.ndarray]) -> Image:
    """Return the channels of a picture as an image, (H, W, C) float32; gray with alpha becomes BGRA."""
    planes = [plane.astype(np.float32) for plane in channels.values()]
    if len(planes) == 2:
        planes = [planes[0]] * 3 + planes[1:]
    return np.stack(planes, axis=-1)


def read_picture(path: Path, limit: MemoryLimit | None = None) -> Image:
    """Read the picture of an OpenEXR file alone; see `fpsboost.io.images.files.read_image`."""
    header = read_exr_header(path)
    return _picture_of(read_channels(path, header, _picture_channels(path, header), limit))


@dataclass(frozen=True)
class Passes:
    """Layers of a sequence that are read beside its picture, which every file must have like the first.

    Parameters
    ----------
    first : Path
        First file of the sequence, for messages.
    layers : tuple of LayerNames
        Layers to read.
    are_all : bool
        Whether a file with further layers is an error.
    pictures : tuple of str
        Names of the layers that may be the picture; see `ExrContents`.
    left_out : tuple of str
        Channels that belong neither to the picture nor to these layers.
    """

    first: Path
    layers: tuple[LayerNames, ...] = ()
    are_all: bool = False
    pictures: tuple[str, ...] = ()
    left_out: tuple[str, ...] = ()

    @classmethod
    def chosen(cls, path: Path, names: str) -> Self:
        """Return the layers that a user has named: ``all``, ``beauty``, or names with commas between them.

        `path` is the first file of the sequence. A name may leave out its view layer. `InputError` if there is no such
        layer, or the layers show the views of a stereo camera.
        """
        header = read_exr_header(path)
        contents = contents_of(header)
        layers = tuple(_named(path, contents, names))
        if layers and contents.views:
            raise InputError(
                f"{path} holds several views ({', '.join(sorted(contents.views))}), which move differently; save each "
                "as a file of its own, or give `passes='beauty'`."
            )
        taken = {*contents.picture, *(name for layer in layers for name in layer.channels)}
        left_out = tuple(name for name in header.channels if name not in taken)
        return cls(path, layers, names == ALL, tuple(contents.pictures), left_out)

    def read(self, path: Path, limit: MemoryLimit | None) -> LayeredImage:
        """Read the picture of a file and these layers; `InputError` if it has other layers than the first file."""
        header = read_exr_header(path)
        picture = _picture_channels(path, header)
        self._check_alike(path, header)
        names = [*picture, *(name for layer in self.layers for name in layer.channels)]
        planes = read_channels(path, header, names, limit)
        layers = [
            Layer(layer.name, layer.kind, {name: planes[name] for name in layer.channels}) for layer in self.layers
        ]
        return LayeredImage(_picture_of({name: planes[name] for name in picture}), tuple(layers))

    def _check_alike(self, path: Path, header: ExrHeader) -> None:
        """Raise `InputError` unless a file has these layers, with the same channels and types, as the first."""
        there = {layer.name: layer.channels for layer in contents_of(header).layers}
        advice = "render all frames with the same passes, or give `passes='beauty'`."
        for layer in self.layers:
            if list(there.pop(layer.name, {}).items()) != list(layer.channels.items()):
                raise InputError(
                    f"{path} has no layer {layer.name} with the channels and types of {self.first}; {advice}"
                )
        if self.are_all and there:
            raise InputError(f"{path} has a layer {next(iter(there))}, which {self.first} has not; {advice}")


def encode_like(header: ExrHeader, image: FrameImage) -> bytes:
    """Turn an image into the content of a file like another one, with that picture and at least these layers."""
    colour = view(image).array()
    channels = contents_of(header).picture
    places = (0, 3) if len(channels) == 2 else range(len(channels))
    planes: dict[str, np.ndarray] = {name: colour[..., i] for name, i in zip(channels, places, strict=True)}
    if isinstance(image, LayeredImage):  # an array has no names of channels
        planes |= image.planes()
    return encode_exr_like(header, planes)


def remark_on_losses(remarks: Remarks, header: ExrHeader, layers: Sequence[LayerNames], *, anew: bool) -> None:
    """Add remarks on what frames encoded like an original lack.

    These are pixels outside of the display window, smaller copies of the images (mipmaps), layers that are left out,
    and motion vectors.

    Parameters
    ----------
    remarks : Remarks
        Remarks to add to.
    header : ExrHeader
        Header of the original.
    layers : sequence of LayerNames
        Layers that the frames have beside their picture.
    anew : bool
        Whether frames are numbered anew, so that motion vectors lead to other numbers.
    """
    interpolated = {name for layer in layers for name in layer.channels}
    if any(part.data != part.display for part in header.parts):
        remarks.add("pixels-elsewhere")
    if any("tiles" in part.attributes and part.attributes["tiles"].mode.value for part in header.parts):
        remarks.add("no-smaller-copies")
    if any(not interpolated.issuperset(layer.channels) for layer in contents_of(header).layers):
        remarks.add("fewer-layers")
    if anew and any(layer.has_vectors for layer in layers):
        remarks.add("vectors-of-originals")


def _named(path: Path, contents: ExrContents, names: str) -> list[LayerNames]:
    """Return the layers that a user has named; raise `InputError` for a name that no layer has."""
    if names in (ALL, BEAUTY):
        return contents.layers if names == ALL else []
    wanted = set[str]()
    for name in (word.strip() for word in names.split(",")):
        layers = {layer.name for layer in contents.layers if _is_called(layer.name, name)}
        if not layers and name != BEAUTY and not any(_is_called(picture, name) for picture in contents.pictures[:1]):
            choices = ", ".join(layer.name for layer in contents.layers) or "none"
            raise InputError(f"{path} has no layer {name!r} beside its picture; choose from those it has: {choices}.")
        wanted |= layers
    return [layer for layer in contents.layers if layer.name in wanted]


def _is_called(layer: str, name: str) -> bool:
    """Return whether a user may mean a layer: by its name, also without that of its view layer or part."""
    return name == layer or layer.endswith(f".{name}")
