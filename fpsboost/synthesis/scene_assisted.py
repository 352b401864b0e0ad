"""Every in-between pixel asks the renderer where it was and where it will be: Yang et al. 2011, scene-assisted."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from fractions import Fraction
from typing import Any, ClassVar, NamedTuple

import numpy as np
from numpy.typing import NDArray

from fpsboost.errors import OptionError
from fpsboost.frame import Image
from fpsboost.frame_cache import FrameCache
from fpsboost.io.vector_folder import VectorFolder
from fpsboost.motion.rendered import frame_number, not_an_output_frame
from fpsboost.synthesis import FramePair
from fpsboost.synthesis.blend import Blend
from fpsboost.synthesis.rounding import as_image, premultiplied


class _Neighbour(NamedTuple):
    """One of the two frames as an in-between frame sees it."""

    image: FrameCache
    flow: NDArray[Any]
    """(H, W, 2) float32, from the in-between frame to this one."""
    weight: float
    """Its share where both are seen."""


@dataclass(frozen=True)
class SceneAssisted:
    """Look both frames up along the in-between frame's own motion vectors (section 2.2 of the report).

    The renderer makes everything of the in-between frame but its shading. Its vectors go to the output frames beside it
    and are continued in a straight line where the two frames are farther away. What both frames show is mixed in time;
    a place outside of a frame, or behind something nearer, does not count; where nothing counts, both are mixed.

    Parameters
    ----------
    vectors : VectorFolder
        With depth, what is hidden in one frame is known.
    depth_tolerance : float
        A pixel is hidden where the other frame is nearer by more than this part of its depth.

    Raises
    ------
    OptionError
        The tolerance is out of range.
    """

    needs_every_frame: ClassVar[bool] = True

    vectors: VectorFolder
    depth_tolerance: float = 0.05

    def __post_init__(self) -> None:
        if not 0 <= self.depth_tolerance < 1:
            raise OptionError(f"depth_tolerance must be at least 0 and below 1, not {self.depth_tolerance}.")

    def with_vectors(self, vectors: VectorFolder) -> SceneAssisted:
        """See `fpsboost.io.vector_folder.UsesVectors.with_vectors`."""
        return replace(self, vectors=vectors)

    def without_vectors(self) -> Blend:
        """See `fpsboost.io.vector_folder.UsesVectors.without_vectors`."""
        return Blend()

    def synthesize(self, frame_pair: FramePair, times: Sequence[float]) -> Iterator[Image]:
        """See `fpsboost.synthesis.Synthesizer.synthesize`; motion that was estimated is not looked at.

        Raises
        ------
        OptionError
            An in-between frame is no output frame; or one of the two is none, and depth is to be compared.
        InputError
            There are no vectors for it, or some of another size.
        """
        for t in times:
            yield self._image_at(frame_pair, t)

    def _image_at(self, frame_pair: FramePair, t: float) -> Image:
        image0, image1 = frame_pair.image0, frame_pair.image1
        place0, place1, number = _places(image0.output_position, image1.output_position, t)
        here, step = self.vectors.for_image(number, image0.array), self.vectors.step
        neighbours = (
            _Neighbour(image0, here.backward * np.float32((number - place0) * step), 1 - t),
            _Neighbour(image1, here.forward * np.float32((place1 - number) * step), t),
        )
        weights, colours = [], []
        for neighbour in neighbours:
            height, width = here.backward.shape[:2]
            y, x = np.mgrid[:height, :width].astype(np.float32)
            x, y = x + neighbour.flow[..., 0], y + neighbour.flow[..., 1]
            seen = (x >= -0.5) & (x <= width - 0.5) & (y >= -0.5) & (y <= height - 0.5)
            if here.depth is not None:
                there = self.vectors.for_image(frame_number(neighbour.image.output_position), image0.array).depth
                assert there is not None, "all frames of a folder have depth, or none"
                seen &= _at_nearest(there, x, y) >= here.depth * np.float32(1 - self.depth_tolerance)
            weights.append(seen * np.float32(neighbour.weight))
            colours.append(_between_pixels(neighbour.image.cached(premultiplied), x, y))
        share = _share_of_second(weights[0], weights[1], t)[..., np.newaxis]
        mixed = (1 - share) * colours[0] + share * colours[1]
        return as_image(mixed, image0.array, image1.array, t)


def _places(place0: Fraction | None, place1: Fraction | None, t: float) -> tuple[Fraction, Fraction, int]:
    """Where the two frames are among the output's, and the number of the frame between them."""
    if place0 is None or place1 is None:
        raise not_an_output_frame()
    place = place0 + Fraction(t) * (place1 - place0)
    nearest = round(place)
    return place0, place1, frame_number(Fraction(nearest) if abs(place - nearest) < 1e-6 else place)


def _share_of_second(weight0: NDArray[Any], weight1: NDArray[Any], t: float) -> NDArray[Any]:
    """How much of each pixel comes from frame 1."""
    total = weight0 + weight1
    share: NDArray[Any] = np.where(total > 0, weight1 / np.where(total > 0, total, 1), np.float32(t))
    return share


def _at_nearest(plane: NDArray[Any], x: NDArray[Any], y: NDArray[Any]) -> NDArray[Any]:
    """A plane at the pixels nearest to places; depth must not be mixed across an outline."""
    height, width = plane.shape
    nearest: NDArray[Any] = plane[_index(np.rint(y), height), _index(np.rint(x), width)]
    return nearest


def _between_pixels(values: NDArray[Any], x: NDArray[Any], y: NDArray[Any]) -> NDArray[Any]:
    """(H, W, C) values at places, bilinear; the outermost pixels go on outside."""
    height, width = values.shape[:2]
    x, y = x.clip(0, width - 1), y.clip(0, height - 1)
    left, top = np.floor(x), np.floor(y)
    across, down = (x - left)[..., np.newaxis], (y - top)[..., np.newaxis]
    columns, rows = ([_index(first, size), _index(first + 1, size)] for first, size in ((left, width), (top, height)))
    upper, lower = (values[row, columns[0]] * (1 - across) + values[row, columns[1]] * across for row in rows)
    between: NDArray[Any] = upper * (1 - down) + lower * down
    return between


def _index(places: NDArray[Any], size: int) -> NDArray[Any]:
    return places.clip(0, size - 1).astype(np.intp)
