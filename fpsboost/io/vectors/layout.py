"""How renderers store motion vectors in OpenEXR: channel names, directions, and signs; see `convention`."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import Any, Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from fpsboost.io.images.exr import find_layer

Direction = Literal["forward", "backward"]


class StoredVectors(NamedTuple):
    """Meaning of two channels: where their vectors lead, and the factors that make them point there, y down."""

    direction: Direction
    x_sign: int
    y_sign: int

    def read(self, channels: NDArray[Any]) -> NDArray[Any]:
        """Return the vectors, (H, W, 2) float32, y down, of the two channels, (H, W, 2)."""
        return channels * np.array([self.x_sign, self.y_sign], np.float32)


@dataclass(frozen=True)
class VectorConvention:
    """Meaning of the channels of a vector pass.

    Attributes
    ----------
    pairs : tuple of StoredVectors
        Meaning of the first two channels, and of the next two if there are four.
    """

    pairs: tuple[StoredVectors, ...]

    def read(self, channels: NDArray[Any]) -> tuple[NDArray[Any], NDArray[Any]]:
        """Return the vectors to the previous and to the next frame.

        Parameters
        ----------
        channels : (H, W, 2 or 4) float32
            As stored.

        Returns
        -------
        backward, forward : (H, W, 2) float32
            y down.
        """
        found = {
            pair.direction: pair.read(channels[..., 2 * number : 2 * number + 2])
            for number, pair in enumerate(self.pairs)
        }
        if len(found) == 1:  # at constant speed
            opposite: Direction = "backward" if "forward" in found else "forward"
            found[opposite] = -next(iter(found.values()))
        return found["backward"], found["forward"]

    def __str__(self) -> str:
        names = (("first", "second"), ("third", "fourth"))
        axes = {1: ("right", "down"), -1: ("left", "up")}
        return ", and ".join(
            f"the {x} and {y} channel lead to the {'next' if pair.direction == 'forward' else 'previous'} frame, "
            f"{axes[pair.x_sign][0]} and {axes[pair.y_sign][1]}"
            for pair, (x, y) in zip(self.pairs, names, strict=False)
        )


conventions: Mapping[str, VectorConvention] = MappingProxyType(
    {
        "blender": VectorConvention((StoredVectors("backward", 1, -1), StoredVectors("forward", -1, 1))),
        "nuke": VectorConvention((StoredVectors("forward", 1, -1), StoredVectors("backward", 1, -1))),
        "forward-up": VectorConvention((StoredVectors("forward", 1, -1),)),
        "forward-down": VectorConvention((StoredVectors("forward", 1, 1),)),
        "backward-up": VectorConvention((StoredVectors("backward", 1, -1),)),
        "backward-down": VectorConvention((StoredVectors("backward", 1, 1),)),
    }
)
"""Conventions by name."""

layer_names = ("vector", "motionvector", "motionvectors", "motion", "velocity", "vrayvelocity", "speed")
"""Last word of the names of layers with two channels of motion, in small letters."""


def find_vector_channels(names: Collection[str], *, of_any_layer: bool = False) -> tuple[list[str], str] | None:
    """Find the channels of motion vectors by their names.

    Parameters
    ----------
    names : collection of str
        All channels of a file.
    of_any_layer : bool
        Take two channels also of a layer whose name does not say that it holds motion, if there is no other.

    Returns
    -------
    list of str, str
        Two or four channels in the order of their convention, and its name; None if there are no such channels.

    Examples
    --------
    >>> find_vector_channels(["R", "G", "B", "velocity.R", "velocity.G", "velocity.B"])
    (['velocity.R', 'velocity.G'], 'forward-up')
    """
    layer = find_layer(names, "XYZW", "Vector")
    if layer is not None:
        return [layer + each for each in "XYZW"], "blender"
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


_nuke_channels = ("forward.u", "forward.v", "backward.u", "backward.v")
_second_of = {"R": "G", "X": "Y", "u": "v", "x": "y"}
