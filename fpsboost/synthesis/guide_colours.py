"""Colours of frames and guides on one scale, on which they are compared, and as light, of which pixels are means."""

from dataclasses import dataclass
from typing import Self

import cv2
import numpy as np

from fpsboost.colour import MIDDLE_GRAY, STEEPNESS, has_alpha, normalised, premultiplied
from fpsboost.image import Image, as_image, view
from fpsboost.layered import FrameImage, LayeredImage

WHITE = np.float32(255)
"""White on the scale on which pictures are compared."""

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
        if not isinstance(image0, LayeredImage) or not isinstance(image1, LayeredImage):
            return cls()
        light = np.concatenate([_colours_of(normalised(each.colour)).ravel() for each in (image0, image1)])
        light = light[light > 0]
        return cls(np.float32(MIDDLE_GRAY / np.exp(cv2.log(light).mean())) if light.size else np.float32(1))

    @property
    def is_scene_linear(self) -> bool:
        """Whether values are light, and compared by ratio."""
        return self.exposure is not None

    def values(self, image: FrameImage) -> Image:
        """Return the numbers that are mixed, (H, W, C): alpha premultiplied, of the image's type if it has none."""
        array = view(image).to_bgr()
        if not has_alpha(array) and array.dtype != np.float32:
            return array
        return premultiplied(array)

    def levels(self, values: np.ndarray, white: np.float32) -> np.ndarray:
        """Return `values` as they are compared, (H, W, 3) float32: code values from 0 to `WHITE`, light by ratio."""
        colours = _colours_of(values)
        if self.exposure is None:
            return colours.astype(np.float32) * (WHITE / white)
        return self.of_light((colours * self.exposure).clip(0, MAX_LIGHT))

    def light(self, levels: np.ndarray) -> np.ndarray:
        """Return the light of `levels`, nearly: that of scene-linear colours, or that of the usual gamma."""
        if self.exposure is None:
            return np.asarray(levels.clip(0, WHITE) ** 2 * (1 / WHITE))
        return np.asarray(np.expm1(levels * (np.log1p(STEEPNESS) / WHITE)) / STEEPNESS)

    def of_light(self, light: np.ndarray) -> np.ndarray:
        """Return the levels of light; the inverse of `light`."""
        if self.exposure is None:
            return np.sqrt(light * WHITE)
        logarithm = cv2.log(1 + STEEPNESS * np.maximum(light, 0)).reshape(light.shape)
        return np.asarray(logarithm * (WHITE / np.log1p(STEEPNESS)))

    def shifted(self, values: np.ndarray, difference: np.ndarray, white: np.float32) -> np.ndarray:
        """Return float `values` whose colours are changed by a difference of levels, (H, W, 3)."""
        changed = values.copy()
        count = values.shape[2] - has_alpha(values)
        if self.exposure is None:
            changed[..., :count] += difference[..., :count] * (white / WHITE)
        else:
            light = self.light(self.levels(values, white) + difference)
            changed[..., :count] = (light / self.exposure)[..., :count]
        return changed

    def image(self, values: np.ndarray, image0: FrameImage, image1: FrameImage, t: float) -> Image:
        """Return float `values` as an image of the type of the frames, with what they have as alpha."""
        return as_image(values, view(image0).to_bgr(), view(image1).to_bgr(), t)


def _colours_of(values: np.ndarray) -> np.ndarray:
    """Return (H, W, 3) without alpha; gray is repeated."""
    colours = values[..., : values.shape[2] - has_alpha(values)]
    return colours if colours.shape[2] == 3 else colours.repeat(3, axis=2)
