"""What renderers bring beside their images: motion vectors and depth, and the conventions in which they are stored.

`folder` reads the files; the conventions are here, light to import for a command line. Vectors are in pixels per frame.
`docs/render.md` describes the conventions. Where a convention stores one direction, the other is taken for its
opposite, as if the speed were constant.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal, NamedTuple

if TYPE_CHECKING:
    import numpy as np

ConventionName = Literal["auto", "blender", "nuke", "forward-up", "forward-down", "backward-up", "backward-down"]
"""A convention, or the one that the names of the channels and a comparison of frames suggest."""

Direction = Literal["forward", "backward"]


class StoredVectors(NamedTuple):
    """Meaning of two channels: where their vectors lead, and the factors that make them point there, y down."""

    direction: Direction
    """The frame that the vectors lead to: the next one (forward), or the previous one (backward)."""
    x_sign: int
    """1 if positive values lead to the right, -1 if to the left."""
    y_sign: int
    """1 if positive values lead down, -1 if up."""

    def read(self, channels: np.ndarray) -> np.ndarray:
        """Return the vectors, (H, W, 2) float32, y down, of the two channels as stored, (H, W, 2)."""
        scaled = channels.copy()
        scaled *= (self.x_sign, self.y_sign)
        return scaled


@dataclass(frozen=True)
class VectorConvention:
    """Meaning of the channels of a vector pass: of the first two, and of the next two if there are four.

    Examples
    --------
    >>> print(conventions["forward-up"])
    the first and second channel lead to the next frame, right and up
    """

    pairs: tuple[StoredVectors, ...]
    """Meaning of the first two channels, and of the next two if there are four."""

    def read(self, channels: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return the vectors to the previous and to the next frame, each (H, W, 2) float32, y down.

        `channels` are those of the file, (H, W, 2 or 4).
        """
        vectors = {
            pair.direction: pair.read(channels[..., 2 * number : 2 * number + 2])
            for number, pair in enumerate(self.pairs)
        }
        if len(vectors) == 1:  # at constant speed
            opposite: Direction = "backward" if "forward" in vectors else "forward"
            vectors[opposite] = -next(iter(vectors.values()))
        return vectors["backward"], vectors["forward"]

    def __str__(self) -> str:
        axes = {1: ("right", "down"), -1: ("left", "up")}
        return ", and ".join(
            f"the {x} and {y} channel lead to the {'next' if pair.direction == 'forward' else 'previous'} frame, "
            f"{axes[pair.x_sign][0]} and {axes[pair.y_sign][1]}"
            for pair, (x, y) in zip(self.pairs, (("first", "second"), ("third", "fourth")), strict=False)
        )


conventions: Mapping[str, VectorConvention] = {
    "blender": VectorConvention((StoredVectors("backward", 1, -1), StoredVectors("forward", -1, 1))),
    "nuke": VectorConvention((StoredVectors("forward", 1, -1), StoredVectors("backward", 1, -1))),
    "forward-up": VectorConvention((StoredVectors("forward", 1, -1),)),
    "forward-down": VectorConvention((StoredVectors("forward", 1, 1),)),
    "backward-up": VectorConvention((StoredVectors("backward", 1, -1),)),
    "backward-down": VectorConvention((StoredVectors("backward", 1, 1),)),
}
"""Conventions by the names that options have for them."""
