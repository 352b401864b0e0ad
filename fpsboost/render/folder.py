"""Motion vectors and depth of a renderer, for every frame of the output.

The vectors of a frame lead to the previous and the next output frame; if frames are known by their numbers, from one
number to the next, whatever the step that was rendered with. Renderers write them as

OpenEXR
    Two or four channels in one of the conventions of `fpsboost.render`; `fpsboost.render.fitting` finds out in which.
``.flo``
    ``NAME_backward.flo`` and ``NAME_forward.flo``, to the previous and to the next frame, y down.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence
from copy import copy
from functools import lru_cache
from itertools import chain
from pathlib import Path
from typing import Self

import numpy as np

from fpsboost.errors import InputError, OptionError, explained
from fpsboost.image import Pixels
from fpsboost.io.images.exr import read_exr, read_exr_header
from fpsboost.io.images.sequence import (
    NumberedImages,
    Numbering,
    find_numbered,
    find_placeholder,
    list_files,
    order_names,
)
from fpsboost.io.side.flow import BACKWARD, FORWARD, read_flow
from fpsboost.motion.rendered import FrameVectors
from fpsboost.options import checked
from fpsboost.remarks import Remarks
from fpsboost.render import ConventionName, VectorConvention, conventions

CACHED_FRAMES = 4
"""Number of frames whose vectors are kept in memory: the two frames of a pair, and two between them."""

layer_names = ("vector", "motionvector", "motionvectors", "motion", "velocity", "vrayvelocity", "speed")
"""Last word of the names of layers with two channels of motion, in lower case, as renderers write them."""

_nuke_channels = ("forward.u", "forward.v", "backward.u", "backward.v")
"""Ends of the names of Nuke's channels."""
_second_of = {"R": "G", "X": "Y", "u": "v", "x": "y"}
"""Name of the channel with y by that of the channel with x."""


class VectorFolder:
    """Folder with motion vectors for every frame at the output rate.

    The first file is for the first frame, unless `matched` has found the frames' numbers in the names of the files.

    Parameters
    ----------
    path : str or Path
        Motion vectors: a folder with one sequence of OpenEXR files, or of pairs of ``.flo`` files; or a pattern of
        OpenEXR files (``Vector####.exr``) where the folder holds others too.
    depth : str or Path, optional
        Depth of the same frames, in any unit. The files, which may be those of the vectors, have one channel, or one
        named Z, Depth, V or Y, or Blender's ``Depth.Z``.
    convention : str
        ``auto``, which is decided by the names of the channels and by comparing frames, or the convention in which the
        vectors are stored: ``blender``, ``nuke``...

    Attributes
    ----------
    convention : VectorConvention or None
        The convention; None as long as only the names of the channels suggest one, see `fpsboost.render.fitting`.
    step : int
        Number of vectors from one output frame to the next: the difference of their numbers, or 1.
    files : list of Path
        All files that may be read.
    remarks : Remarks
        What was assumed.

    Raises
    ------
    InputError, OptionError
        There are no vectors, or the convention does not suit them.

    Examples
    --------
    >>> VectorFolder("vectors/", depth="depth/")  # doctest: +SKIP
    VectorFolder('vectors', depth='depth')
    """

    @checked
    def __init__(self, path: str | Path, depth: str | Path | None = None, convention: ConventionName = "auto") -> None:
        self.path = Path(path)
        self.depth_path = None if depth is None else Path(depth)
        self.convention = None if convention == "auto" else conventions[convention]
        self._convention_name = convention
        self._vectors = _find_files(self.path, "motion vectors", ".exr", ".flo")
        if self.is_flow and convention != "auto":
            raise OptionError(
                f"{self.path} contains .flo files, which have one convention; leave `vector_convention` out."
            )
        self._depth = None if self.depth_path is None else _find_files(self.depth_path, "depth", ".exr")
        depth_files = [] if self._depth is None else self._depth.files
        self.files = [*chain.from_iterable(map(_partners, self._vectors.files)), *depth_files]
        self.step = 1
        self.remarks = Remarks()
        self._numbers: Sequence[int] | None = None
        self._cached = lru_cache(CACHED_FRAMES)(self._read)

    def __reduce__(self) -> tuple[type[Self], tuple[Path, Path | None, ConventionName]]:
        """Pickle the arguments of the constructor with absolute paths; results of `matched` are found again."""
        depth = None if self.depth_path is None else self.depth_path.absolute()
        return type(self), (self.path.absolute(), depth, self._convention_name)

    def __copy__(self) -> Self:
        """Copy everything, unlike pickling, but the cache."""
        copied = object.__new__(type(self))
        copied.__dict__.update(self.__dict__)
        copied._cached = lru_cache(CACHED_FRAMES)(copied._read)
        return copied

    def __repr__(self) -> str:
        depth = None if self.depth_path is None else str(self.depth_path)
        convention = "" if self._convention_name == "auto" else f", convention={self._convention_name!r}"
        return f"VectorFolder({str(self.path)!r}, depth={depth!r}{convention})"

    @property
    def is_flow(self) -> bool:
        """Whether the vectors are pairs of ``.flo`` files."""
        return self._vectors.files[0].suffix.lower() == ".flo"

    def matched(self, numbers: Sequence[int], *, must_match: bool) -> VectorFolder:
        """Return the same vectors for frames that are known by their numbers, which are equidistant.

        Parameters
        ----------
        numbers : sequence of int
            Numbers of all output frames.
        must_match : bool
            Whether a missing file is an error when it is read, because the renderer has numbered the frames.

        Returns
        -------
        VectorFolder
            A frame takes the files with its number if the files have numbers, and those of all frames are there. If
            they have no numbers, or others, the first file remains that of the first frame.
        """
        folder = copy(self)
        folder.remarks = Remarks()
        file_numbers = [files.numbers for files in (self._vectors, self._depth) if files is not None]
        if not all(file_numbers):
            return folder
        if must_match or all(set(numbers) <= set(files) for files in file_numbers):
            folder._numbers = numbers
            folder.step = numbers[1] - numbers[0] if len(numbers) > 1 else 1
            there = len(set(numbers).intersection(self._vectors.numbers))
            if there < len(numbers):
                folder.remarks.add("vectors-missing", name=self.path, there=there, frames=len(numbers))
        elif self._vectors.numbers[0] != numbers[0] and len(self._vectors.numbers) != len(numbers):
            first = self._vectors.numbers[0]
            folder.remarks.add("vectors-in-order", name=self.path, first=first, number=numbers[0])
        return folder

    def has(self, number: int) -> bool:
        """Return whether there is a file for an output frame, counted from 0."""
        return self._place_of(self._vectors, number) is not None

    def channels_at(self, number: int) -> tuple[np.ndarray, VectorConvention]:
        """Return the channels of an output frame's vectors, (H, W, 2 or 4) float32, and their usual convention.

        Raises `InputError` if there are none, or they are not finite numbers.
        """
        file = self._file_of(self._vectors, number, self.path, "vectors")
        names = list(read_exr_header(file).channels)
        found = find_vector_channels(names, of_any_layer=self.convention is not None)
        if found is None:
            raise InputError(
                f"{file} has no motion vectors among its channels ({', '.join(names)}); save a vector pass, with X, Y, "
                "Z and W in one layer, or give their meaning with `vector_convention`."
            )
        channels = np.dstack(list(read_exr(file, found[0]).values()))
        _check_numbers(file, channels)
        return channels, conventions[found[1]]

    def at(self, number: int) -> FrameVectors:
        """Return the vectors of an output frame, counted from 0.

        Raises `InputError` if there are none, they are not finite numbers, or differ from the depth in size.
        """
        return self._cached(number)

    def for_image(self, number: int, image: Pixels) -> FrameVectors:
        """Return the vectors of an output frame like `at`, or raise `InputError` if the image is of another size."""
        vectors = self.at(number)
        self.check_size(vectors.backward, image)
        return vectors

    def check_size(self, vectors: np.ndarray, image: Pixels) -> None:
        """Raise `InputError` if vectors are of another size than an image."""
        height, width = vectors.shape[:2]
        if vectors.shape[:2] != image.shape[:2]:
            raise InputError(
                f"{self.path} has vectors for {width}x{height} pixels, and the frames have "
                f"{image.shape[1]}x{image.shape[0]}; render both in one size."
            )

    def _read(self, number: int) -> FrameVectors:
        """Return the vectors and the depth of an output frame."""
        if self.is_flow:
            files = _partners(self._file_of(self._vectors, number, self.path, "vectors"))
            backward, forward = map(read_flow, files)
            if backward.shape != forward.shape:
                raise InputError(f"{files[0]} and {files[1].name} differ in size; write both for the same frame.")
            _check_numbers(files[0], backward)
            _check_numbers(files[1], forward)
        else:
            channels, usual = self.channels_at(number)
            convention = self.convention or usual
            if channels.shape[2] != 2 * len(convention.pairs):
                raise InputError(
                    f"{self.path} has {channels.shape[2]} channels of motion, and the vector convention "
                    f"{2 * len(convention.pairs)}; choose another `vector_convention`."
                )
            backward, forward = convention.read(channels)
        if self._depth is None or self.depth_path is None:
            return FrameVectors(backward, forward, None)
        file = self._file_of(self._depth, number, self.depth_path, "depth")
        depth = _read_depth(file)
        if depth.shape != backward.shape[:2]:
            height, width = backward.shape[:2]
            raise InputError(
                f"{file} has {depth.shape[1]}x{depth.shape[0]} pixels, and the vectors have {width}x{height}; "
                "render both in one size."
            )
        return FrameVectors(backward, forward, depth)

    def _file_of(self, files: NumberedImages, number: int, path: Path, what: str) -> Path:
        """Return the file of an output frame, counted from 0."""
        place = self._place_of(files, number)
        if self._numbers is None or files.numbering is None:
            files.check_complete(1, "render it, too")
            if place is None:
                raise InputError(
                    f"{path} has no {what} for output frame {number}; render one file for every frame of the output, "
                    f"from frame 0 on ({len(files.files)} are there)."
                )
        elif place is None:
            wanted = self._numbers[0] + number * self.step
            raise InputError(
                f"{files.numbering.path(wanted)} is missing, the {what} of output frame {wanted}; render it too."
            )
        return files.files[place]

    def _place_of(self, files: NumberedImages, number: int) -> int | None:
        """Return the index of an output frame's file; None if it has none."""
        if self._numbers is None or files.numbering is None:
            return number if 0 <= number < len(files.files) else None
        wanted = self._numbers[0] + number * self.step
        return files.numbers.index(wanted) if wanted in files.numbers else None


def _find_files(path: Path, what: str, *suffixes: str) -> NumberedImages:
    """Return the file of each frame, of a pair of ``.flo`` files the one with backward vectors.

    `what` names the content in messages, `suffixes` are the types of files that are taken.
    """
    if not path.is_dir() and (find_placeholder(path.name) is None or path.suffix.lower() != ".exr"):
        raise InputError(f"{path} is not a folder with {what}; name a folder, or a pattern such as Vector####.exr.")
    with explained(InputError, "read", path, "check that it exists and that you may read it"):
        if not path.is_dir():
            return find_numbered(Numbering.parse(str(path)))
        kinds = {name: Path(name).suffix.lower() for name in list_files(path) if not name.startswith(".")}
    names = [name for name, kind in kinds.items() if kind in suffixes]
    if not names:
        raise InputError(f"{path} contains no {what} ({' or '.join(suffixes)}); name a folder that does.")
    if len({kinds[name] for name in names}) > 1:
        raise InputError(f"{path} contains both .exr and .flo files; keep one kind of motion vectors in it.")
    if kinds[names[0]] == ".flo":
        for name in names:
            ending, other = (BACKWARD, FORWARD) if name.endswith(BACKWARD) else (FORWARD, BACKWARD)
            partner = name.removesuffix(ending) + other
            if not name.endswith((BACKWARD, FORWARD)):
                raise InputError(f"{path / name} is neither a *{BACKWARD} nor a *{FORWARD}; rename or remove it.")
            if partner not in names:
                raise InputError(f"{path / name} has no partner {partner}; write both directions for every frame.")
        names = [name for name in names if name.endswith(BACKWARD)]
    return order_names(path, names)


def _partners(path: Path) -> list[Path]:
    """Return all files of a frame, given the first of them."""
    if not path.name.endswith(BACKWARD):
        return [path]
    return [path, path.with_name(path.name.removesuffix(BACKWARD) + FORWARD)]


def _check_numbers(path: Path, flow: np.ndarray) -> None:
    """Raise `InputError` if vectors are not finite."""
    count = int((~np.isfinite(flow)).any(axis=-1).sum())
    if count:
        raise InputError(f"{path} has {count} motion vectors that are unknown, infinite or NaN; render it again.")


def _read_depth(path: Path) -> np.ndarray:
    """Return the depth, (H, W) float32; infinite where it is not a number."""
    names = list(read_exr_header(path).channels)
    layers = [name for name in names if name.endswith(("Depth.Z", "Depth.V"))]
    taken = "XYZW" if _find_layer(names) == "" else ""  # used by vectors in the same file
    plain = [name for name in ("Z", "Depth", "V", "Y") if name in names and name not in taken]
    chosen = next((found for found in (layers, names, plain[:1]) if len(found) == 1), None)
    if chosen is None:
        raise InputError(
            f"{path} has no depth among its channels ({', '.join(names)}); save one channel, named Z, Depth, V or Y."
        )
    (depth,) = read_exr(path, chosen).values()
    return np.where(np.isnan(depth), np.float32(np.inf), depth)


def find_vector_channels(names: Collection[str], *, of_any_layer: bool = False) -> tuple[list[str], str] | None:
    """Return the channels of motion vectors among a file's, and the name of their convention; None if there are none.

    With `of_any_layer`, the two channels of a layer whose name does not suggest motion are taken too, if there is only
    one such layer.

    Examples
    --------
    >>> find_vector_channels(["R", "G", "B", "ViewLayer.Vector.X", "ViewLayer.Vector.Y", "ViewLayer.Vector.Z",
    ...     "ViewLayer.Vector.W"])
    (['ViewLayer.Vector.X', 'ViewLayer.Vector.Y', 'ViewLayer.Vector.Z', 'ViewLayer.Vector.W'], 'blender')
    """
    layer = _find_layer(names)
    if layer is not None:
        return [layer + channel for channel in "XYZW"], "blender"
    four = [next((name for name in names if name.endswith(end)), "") for end in _nuke_channels]
    if all(four):
        return four, "nuke"
    pairs = [
        [name, name[:-1] + _second_of[name[-1]]]
        for name in sorted(names)
        if name[-1] in _second_of and name[:-1] + _second_of[name[-1]] in names
    ]
    named = [pair for pair in pairs if pair[0][:-2].rpartition(".")[2].lower() in layer_names]
    if named:
        return named[0], "forward-up"
    return (pairs[0], "forward-up") if of_any_layer and len(pairs) == 1 else None


def _find_layer(names: Collection[str]) -> str | None:
    """Return the prefix of X, Y, Z and W: empty, or that of the only layer with these, or of the only one "Vector"."""
    prefixes = {name[:-1] for name in names if name == "X" or name.endswith(".X")}
    whole = sorted(prefix for prefix in prefixes if all(prefix + letter in names for letter in "XYZW"))
    if "" in whole:
        return ""
    choices = [prefix for prefix in whole if prefix.split(".")[-2] == "Vector"] or whole
    return choices[0] if len(choices) == 1 else None
