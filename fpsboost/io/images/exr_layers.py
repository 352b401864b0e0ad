"""Layers of OpenEXR files: which one is the picture, and what each of the others is, by its name.

A layer is what stands before the last dot of a channel's name, in a file of several parts with the name of the part
before it: ``ViewLayer.DiffCol.R`` is the channel R of the layer ``ViewLayer.DiffCol``. Channels without a dot that are
no colours are layers of their own, such as ``Z``.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from types import MappingProxyType

from fpsboost.io.images.exr_header import ExrHeader, Precision
from fpsboost.layered import LayerKind

PICTURES = ("combined", "beauty", "rgba", "rgb", "composite")
"""Last words, in small letters, of the layer that is the picture where several have colours."""

VECTORS = frozenset(
    {
        *("vector", "vectors", "motion", "motionvector", "motionvectors", "velocity", "vrayvelocity", "motvec"),
        *("forward", "backward"),
    }
)
"""Words of layers with motion vectors."""

KINDS_BY_WORD: Mapping[str, LayerKind] = MappingProxyType(
    {
        **dict.fromkeys(("depth", "z", "zdepth", "vrayzdepth", "zbuffer", "denoisingdepth"), "depth"),
        **dict.fromkeys(("normal", "normals", "n", "ns", "ng", "vraynormals", "vraybumpnormals"), "normals"),
        **dict.fromkeys(("denoisingnormal", "shnormal", "geonormal", "bumpnormals", "worldnormal"), "normals"),
        **dict.fromkeys(("indexob", "indexma", "objectindex", "materialindex", "id", "objectid", "objid"), "nearest"),
        **dict.fromkeys(("materialid", "matid", "renderid", "nodeid", "instanceid", "partid", "primid"), "nearest"),
        **dict.fromkeys(("shapeindex", "primindex", "uv", "uvs", "st"), "nearest"),
        **dict.fromkeys(VECTORS, "nearest"),
    }
)
"""What a layer is by the last word of its name, in small letters and without spaces, underscores and digits at its end:
names of Blender, Arnold, V-Ray, Redshift, RenderMan and Mitsuba. Any other is linear."""

CRYPTOMATTE = "crypto"
"""Beginning of the last word of Cryptomatte's layers."""


@dataclass(frozen=True)
class LayerNames:
    """A layer by its name.

    Attributes
    ----------
    name : str
        Empty for colours without a layer's name.
    kind : LayerKind
    channels : tuple of str
        Full names, in the order of the file.
    """

    name: str
    kind: LayerKind
    channels: tuple[str, ...]

    def is_called(self, name: str) -> bool:
        """Return whether a user may mean this layer: by its name, also without that of its view layer or part."""
        return name == self.name or self.name.endswith(f".{name}")

    @property
    def has_vectors(self) -> bool:
        """Whether these are motion vectors."""
        return _word_of(self.name) in VECTORS

    def channel(self, letter: str) -> str | None:
        """Return the channel whose name ends in a letter."""
        return next((each for each in self.channels if _letter_of(each) == letter), None)


@dataclass(frozen=True)
class ExrContents:
    """What a file holds.

    Attributes
    ----------
    picture : list of str
        Full names of its channels in the order B, G, R, A or Y, A; empty if there is no picture.
    pictures : list of str
        Names of all layers that may be meant by the picture; the first is taken.
    layers : list of LayerNames
        All others.
    views : frozenset of str
        Names of the eyes of a stereo camera, if the file has several.
    """

    picture: list[str]
    pictures: list[str]
    layers: list[LayerNames]
    views: frozenset[str]


def contents_of(header: ExrHeader) -> ExrContents:
    """Return what a file holds.

    The picture is the layer without a name, or the only one with colours, or that whose last word is one of `PICTURES`;
    of several parts without such a word, the first.
    """
    layers = _layers_of(header)
    found, picture = _find_picture(layers, has_parts=len(header.parts) > 1)
    rest = [replace(each, channels=tuple(name for name in each.channels if name not in picture)) for each in layers]
    return ExrContents(picture, found, [layer for layer in rest if layer.channels], _views(header))


def kind_of(name: str, precisions: Sequence[Precision]) -> LayerKind:
    """Return what a layer is, by its name and by how precise each of its channels is.

    Examples
    --------
    >>> kind_of("ViewLayer.CryptoObject00", ["float"] * 4), kind_of("ViewLayer.Mist", ["half"])
    ('nearest', 'linear')
    """
    word = _word_of(name)
    if "uint" in precisions or word.startswith(CRYPTOMATTE):
        return "nearest"
    kind = KINDS_BY_WORD.get(word, "linear")
    components = {"depth": 1, "normals": 3}.get(kind, len(precisions))
    return kind if len(precisions) == components else "linear"


def _layers_of(header: ExrHeader) -> list[LayerNames]:
    """Return all layers in the order of the file."""
    groups: dict[str, list[str]] = {}
    for name in header.channels:
        groups.setdefault(name.rpartition(".")[0], []).append(name)
    found: dict[str, list[str]] = {}
    for prefix, names in groups.items():
        letters = {_letter_of(name) for name in names}
        own = "RGBA" if {"R", "G", "B"} <= letters else "YA" if "Y" in letters and "X" not in letters else ""
        if prefix and not own:
            found.setdefault(prefix, []).extend(names)
            continue
        vectors = "" if own or not {"X", "Y"} <= letters else "XYZW"
        for name in names:
            layer = prefix if _letter_of(name) in own else vectors if _letter_of(name) in vectors else name
            found.setdefault(layer, []).append(name)
    precisions = header.channels
    return [
        LayerNames(name, kind_of(name, [precisions[each] for each in names]), tuple(names))
        for name, names in found.items()
    ]


def _find_picture(layers: Sequence[LayerNames], *, has_parts: bool) -> tuple[list[str], list[str]]:
    """Return the layers that may be the picture, and the channels of the first."""
    for colours in ("BGR", "Y"):
        whole = [layer for layer in layers if all(layer.channel(each) for each in colours)]
        called = [layer for layer in whole if not layer.name]
        called = called or [layer for layer in whole if _word_of(layer.name) in PICTURES]
        called = called or (whole[:1] if has_parts or len(whole) == 1 else [])
        if called:
            found = [called[0].channel(each) for each in f"{colours}A"]
            return [layer.name for layer in called], [name for name in found if name is not None]
    channels = [name for layer in layers for name in layer.channels]
    return ([layers[0].name], channels) if len(channels) == 1 else ([], [])


def _views(header: ExrHeader) -> frozenset[str]:
    """Return the names of the views, unless there is only one."""
    views = {
        part.attributes["view"].value.decode("utf-8", "replace") for part in header.parts if "view" in part.attributes
    }
    several = header.parts[0].attributes.get("multiView")
    if several is not None:
        views |= set(_texts(several.value))
    return frozenset(views) if len(views) > 1 else frozenset()


def _texts(stored: bytes) -> Iterator[str]:
    """Yield the texts of a vector of texts, each with its length before it."""
    place = 0
    while place + 4 <= len(stored):
        length = max(int.from_bytes(stored[place : place + 4], "little", signed=True), 0)
        yield stored[place + 4 : place + 4 + length].decode("utf-8", "replace")
        place += 4 + length


def _letter_of(channel: str) -> str:
    return channel.rpartition(".")[2]


def _word_of(layer: str) -> str:
    """Return the last word of a layer's name as `KINDS_BY_WORD` has it."""
    return re.sub(r"[\s_-]", "", layer.rpartition(".")[2]).lower().rstrip("0123456789")
