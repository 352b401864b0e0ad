"""Colours of frames and guides on one scale, on which they are compared, and as light, of which pixels are means."""

from dataclasses import dataclass
from typing import Self

import cv2
import numpy as np

from fpsboost.colour import STEEPNESS, displayed_colours, exposure_of, has_alpha, normalised, premultiplied
from fpsboost.image import Image, as_image, view
from fpsboost.layered import FrameImage, LayeredImage

WHITE = np.float32(255)
"""White on the scale on which pictures are compared."""

GAMMA = 2.2
"""Exponent by which code values are taken for light."""

MAX_LIGHT = np.float32(1e6)
"""Largest value of scene-linear light that is compared, in units of middle gray over 0.18."""


@dataclass(frozen=True)
class Colours:
    """Scale of the colours of two frames.

    Parameters
    ----------
    exposure : float or None
        Factor on scene-linear light that brings the log-average of the frames to middle gray; None for code values.
    """

    exposure: np.float32 | None = None

    @classmethod
    def of(cls, image0: FrameImage, image1: FrameImage) -> Self:
        """Return the scale of two frames, which is that of both and of everything between them."""
        if not isinstance(image0, LayeredImage):
            return cls()
        lights = [_colours_of(normalised(view(each).array())).ravel() for each in (image0, image1)]
        return cls(exposure_of(np.hstack(lights)))

    def values(self, image: FrameImage) -> Image:
        """Return the numbers that are mixed, (H, W, C) float32: to `WHITE` or by exposure, alpha premultiplied."""
        return premultiplied(view(image).to_bgr().copy()) * self._scale(image)  # contiguous

    def _scale(self, image: FrameImage) -> np.float32:
        return self.exposure or WHITE / view(image).white

    def levels(self, values: np.ndarray) -> np.ndarray:
        """Return `values` as they are compared, (H, W, 3) float32: code values from 0 to `WHITE`, light by ratio."""
        colours = _colours_of(values)
        return colours if self.exposure is None else self.of_light(colours.clip(0, MAX_LIGHT))

    def levels_of(self, image: FrameImage) -> np.ndarray:
        """Return an image as it is compared, (H, W, 3) float32: light among code values as a screen shows it."""
        if self.exposure is None and isinstance(image, LayeredImage):
            image = displayed_colours(image.colour)
        return self.levels(self.values(image))

    def light(self, levels: np.ndarray) -> np.ndarray:
        """Return the light of `levels`, nearly: that of scene-linear colours, or that of the usual gamma."""
        if self.exposure is None:
            return cv2.pow(levels.clip(0, WHITE) / WHITE, GAMMA).reshape(levels.shape) * WHITE
        return np.asarray(np.expm1(levels * (np.log1p(STEEPNESS) / WHITE)) / STEEPNESS)

    def of_light(self, light: np.ndarray) -> np.ndarray:
        """Return the levels of light; the inverse of `light`."""
        if self.exposure is None:
            return cv2.pow(light / WHITE, 1 / GAMMA) * WHITE
        logarithm = cv2.log(1 + STEEPNESS * light.clip(0)).reshape(light.shape)
        return np.asarray(logarithm * (WHITE / np.log1p(STEEPNESS)))

    def shifted(self, values: np.ndarray, difference: np.ndarray) -> np.ndarray:
        """Return `values` whose colours are changed by a difference of levels, (H, W, 3)."""
        changed = values.copy()
        count = values.shape[2] - has_alpha(values)
        levels = self.levels(values) + difference
        changed[..., :count] = (levels if self.exposure is None else self.light(levels))[..., :count]
        return changed

    def image(self, values: np.ndarray, image0: FrameImage, image1: FrameImage, t: float) -> Image:
        """Return `values` as an image of the type of the frames, with what they have as alpha."""
        return as_image(values / self._scale(image0), view(image0).to_bgr(), view(image1).to_bgr(), t)


def _colours_of(values: np.ndarray) -> np.ndarray:
    """Return (H, W, 3) without alpha; gray is repeated."""
    colours = values[..., : values.shape[2] - has_alpha(values)]
    return colours if colours.shape[2] == 3 else colours.repeat(3, axis=2)
