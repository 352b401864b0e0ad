"""Layers of in-between frames: each is mixed, or taken from one of the frames, according to its kind.

Linear layers have the same weights as the picture, so that a sum of layers that equals the picture before still does
afterwards. A spline overshoots at edges; where a layer would leave its range, *all* linear layers of that pixel are
moved by one share towards samples that cannot overshoot.

Depth is mixed on a surface only, normals keep their length, and identifiers and anything else that must not be mixed
come from the nearer frame that has the pixel (`Sources`).
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from functools import cache
from typing import NamedTuple, Protocol, runtime_checkable

import cv2
import numpy as np

from fpsboost.colour import normalised
from fpsboost.layered import Layer, LayeredImage
from fpsboost.synthesis import FramePair

PLANES_AT_ONCE = 8
"""Planes that are mixed at a time: their samples take 32 bytes per pixel each."""

Planes = Sequence[np.ndarray]
"""Planes of a frame, each (H, W)."""

AGREEMENT = np.float32(4)
"""Largest difference between a motion and that of a frame's own pixel for the two to agree, pixels: motion that changes
across a surface differs by less, that of something in front of it by more."""

NEAR = np.ones((3, 3), np.uint8)
"""Neighbourhood whose values limit that of a pixel, 3 x 3."""
RINGING = np.ones((21, 21), np.uint8)
"""Area to which a spline rings, 21 x 21."""

ONE_SURFACE = 0.1
"""Largest difference between two distances on one surface, as a share of the smaller."""


@runtime_checkable
class MixesLayers(Protocol):
    """Contract: synthesizer that generates all layers of a frame along with the picture."""

    def synthesize_layers(
        self, frame_pair: FramePair, layered: tuple[LayeredImage, LayeredImage], times: Sequence[float]
    ) -> Iterator[LayeredImage]:
        """Generate one image with all layers for every time; see `fpsboost.synthesis.Synthesizer.synthesize`.

        Parameters
        ----------
        frame_pair : FramePair
            The frames on which motion and weights are found, perhaps under equal illumination.
        layered : (LayeredImage, LayeredImage)
            The frames as they are, with the same layers.
        times : sequence of float
            Each in (0, 1).
        """


class Mixed(NamedTuple):
    """Planes of an in-between frame, each (planes, H, W) float32, sampled in two ways with the same weights."""

    sharp: np.ndarray
    """Interpolated by splines, which overshoot at edges."""
    smooth: np.ndarray
    """Smoothed by the same splines, within the range of the frames' own samples."""


class Sources(NamedTuple):
    """Source of each pixel of an in-between frame: its places in both frames, and the frame that shows it."""

    place0: tuple[np.ndarray, np.ndarray]
    """Rows and columns in frame 0, (H, W) int."""
    place1: tuple[np.ndarray, np.ndarray]
    """Rows and columns in frame 1, (H, W) int."""
    is_second: np.ndarray
    """Whether the pixel is taken from frame 1 instead of frame 0, (H, W) bool."""
    have_both: np.ndarray
    """Whether both frames show it, (H, W) bool."""
    t: float
    """Time of the in-between frame, 0 to 1."""

    def nearest(self, plane0: np.ndarray, plane1: np.ndarray) -> np.ndarray:
        """Return the values of the frame that each pixel is taken from, unmixed, (H, W)."""
        return np.asarray(np.where(self.is_second, plane1[self.place1], plane0[self.place0]))

    def clamp_range(self, plane0: np.ndarray, plane1: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return the lowest and the highest value around each pixel's places, (H, W), to which a spline is clamped.

        The clamp is for values above 1 and the pixels to which they ring; elsewhere the range is infinite.
        """
        sources = (plane0, self.place0), (plane1, self.place1)
        lows, highs = ([around(plane, NEAR)[place] for plane, place in sources] for around in (cv2.erode, cv2.dilate))
        high = np.maximum(*highs)
        no_limit = np.float32(np.inf)
        rings = cv2.dilate(high, RINGING) > 1
        return np.where(rings, np.minimum(*lows), -no_limit), np.where(rings, high, no_limit)

    def depth(self, plane0: np.ndarray, plane1: np.ndarray) -> np.ndarray:
        """Return distances like `nearest`, but mixed by time within a surface: nothing is between two surfaces."""
        value0, value1 = (
            plane[place].astype(np.float32, copy=False)
            for plane, place in ((plane0, self.place0), (plane1, self.place1))
        )
        with np.errstate(invalid="ignore"):  # where both are infinite
            apart = np.abs(value1 - value0)
            is_one = self.have_both & (apart <= ONE_SURFACE * np.minimum(np.abs(value0), np.abs(value1)))
            between = value0 + np.float32(self.t) * (value1 - value0)
        return np.where(is_one, between, self.nearest(plane0, plane1))


def mix_layers(
    layered: tuple[LayeredImage, LayeredImage],
    mix: Callable[[Planes, Planes], Mixed],
    find_sources: Callable[[], Sources],
) -> LayeredImage:
    """Return an in-between frame with all layers of two frames, which have the same.

    Parameters
    ----------
    layered : (LayeredImage, LayeredImage)
        The two frames.
    mix : callable
        Mixes (H, W) float32 planes of both frames, at most PLANES_AT_ONCE at a time.
    find_sources : callable
        Returns the `Sources`; called at most once, and only if a layer needs them.
    """
    colours = [list(np.moveaxis(normalised(each.colour), -1, 0)) for each in layered]
    linear = [
        (layer0.planes[name], layer1.planes[name])
        for layer0, layer1 in _pairs(layered)
        if layer0.kind == "linear"
        for name in layer0.planes
    ]
    find_sources = cache(find_sources)
    mixed = _mix_linear([*zip(*colours, strict=True), *linear], mix, find_sources)
    colour = cv2.merge(mixed[: len(colours[0])]).reshape(layered[0].colour.shape)
    linear_made = iter(mixed[len(colours[0]) :])
    output = []
    for layer0, layer1 in _pairs(layered):
        planes = [(layer0.planes[name], layer1.planes[name]) for name in layer0.planes]
        if layer0.kind == "linear":
            values: Planes = [next(linear_made) for _ in planes]
        elif layer0.kind == "normals":
            values = _mix_normals(planes, mix)
        else:
            choose = find_sources().depth if layer0.kind == "depth" else find_sources().nearest
            values = [choose(*each) for each in planes]
        made = zip(layer0.planes.items(), values, strict=True)
        output.append(
            replace(layer0, planes={name: each.astype(plane.dtype, copy=False) for (name, plane), each in made})
        )
    return LayeredImage(colour, tuple(output))


def _pairs(layered: tuple[LayeredImage, LayeredImage]) -> Iterator[tuple[Layer, Layer]]:
    """Return the pairs of corresponding layers."""
    return zip(layered[0].layers, layered[1].layers, strict=True)


def _mix_linear(
    pairs: Sequence[tuple[np.ndarray, np.ndarray]],
    mix: Callable[[Planes, Planes], Mixed],
    find_sources: Callable[[], Sources],
) -> Planes:
    """Return mixed planes, none of which leaves its range, and all of which are moved by one share.

    The share s is the largest for which ``smooth + s (sharp - smooth)`` is within the range of every plane: that of its
    two frames or, around values brighter than white, of the places that each pixel comes from.
    """
    share = np.ones(pairs[0][0].shape, np.float32)
    planes = list[tuple[np.ndarray, np.ndarray]]()
    ranges = list[tuple[np.float32, np.float32]]()
    for begin in range(0, len(pairs), PLANES_AT_ONCE):
        group = [(_numbers(plane0), _numbers(plane1)) for plane0, plane1 in pairs[begin : begin + PLANES_AT_ONCE]]
        planes0, planes1 = zip(*group, strict=True)
        mixed = mix(planes0, planes1)
        planes += zip(*mixed, strict=True)
        for (plane0, plane1), sharp, smooth in zip(group, *mixed, strict=True):
            lowest = min(plane0.min(), plane1.min())
            highest = max(plane0.max(), plane1.max())
            ranges.append((lowest, highest))
            if highest > 1:
                lows, highs = find_sources().clamp_range(plane0, plane1)
                lowest = np.maximum(lows, lowest)
                highest = np.minimum(highs, highest)
            beyond = (sharp < lowest) | (sharp > highest)
            if beyond.any():
                limit = np.where(sharp > highest, highest, lowest)[beyond]
                span = sharp[beyond] - smooth[beyond]
                allowed = np.divide(limit - smooth[beyond], span, out=np.zeros_like(span), where=span != 0)
                share[beyond] = np.minimum(share[beyond], allowed.clip(0, 1))
    made = []
    for (sharp, smooth), limits in zip(planes, ranges, strict=True):
        values = sharp - smooth
        values *= share
        values += smooth
        made.append(values.clip(*limits, out=values))  # of the excess by rounding alone
    return made


def _mix_normals(pairs: Sequence[tuple[np.ndarray, np.ndarray]], mix: Callable[[Planes, Planes], Mixed]) -> Planes:
    """Return mixed directions that are as long as the frames' are: 1 on surfaces, 0 on the background."""
    planes0, planes1 = ([_numbers(plane) for plane in planes] for planes in zip(*pairs, strict=True))
    lengths = [np.sqrt(sum(plane * plane for plane in planes)) for planes in (planes0, planes1)]
    *directions, length = mix([*planes0, lengths[0]], [*planes1, lengths[1]]).sharp
    length = length.clip(min(each.min() for each in lengths), max(each.max() for each in lengths))
    found = np.sqrt(sum(each * each for each in directions))
    factor = length / np.maximum(found, np.float32(1e-6))
    return [each * factor for each in directions]


def _numbers(plane: np.ndarray) -> np.ndarray:
    """Return a plane as float32 without infinity and NaN, which would spread to neighbouring pixels."""
    return normalised(plane.astype(np.float32, copy=False))


def find_sources(places: np.ndarray, flows: tuple[np.ndarray, np.ndarray], t: float) -> Sources:
    """Decide which frame each pixel of an in-between frame is taken from.

    A frame shows the pixel if its place is inside of the frame, and if the frame's own motion there agrees: where the
    pixel is occluded, the frame shows another surface, which moves differently. If both frames show it, the frame that
    is nearer in time is taken.

    Parameters
    ----------
    places : (4, H, W) float32
        Column and row in frame 0, then in frame 1.
    flows : two (H, W, 2) float32
        Motion of the pixels of each frame to the other one, pixels.
    t : float
        Time of the in-between frame.
    """
    height, width = places.shape[1:]
    motion = places[2:] - places[:2]
    apart = []
    found = []
    for (column, row), flow, sign in zip((places[:2], places[2:]), flows, (1, -1), strict=True):
        x = np.rint(column).astype(np.intp)
        y = np.rint(row).astype(np.intp)
        is_inside = (x >= 0) & (x < width) & (y >= 0) & (y < height)
        place = y.clip(0, height - 1), x.clip(0, width - 1)
        difference = np.moveaxis(flow[place], -1, 0) * np.float32(sign) - motion
        apart.append(np.where(is_inside, np.hypot(*difference), np.float32(np.inf)))
        found.append(place)
    have_both = np.maximum(*apart) <= AGREEMENT
    is_second = np.where(have_both | (apart[0] == apart[1]), t > 0.5, apart[1] < apart[0])
    return Sources(found[0], found[1], is_second, have_both, t)
