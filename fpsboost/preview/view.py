"""Frames as a page shows them: reduced, upright, in 8-bit colours, each an encoded picture."""

from bisect import bisect_right
from dataclasses import dataclass, field
from fractions import Fraction

import cv2
import numpy as np
from numpy.typing import NDArray

from fpsboost import Frame, FrameImage
from fpsboost.extension import VideoTraits, as_shown, turned_upright, view

LONGEST_SIDE = 960  # longer side of a picture on the page, pixels

QUALITY = 85
"""JPEG quality, of 100."""


@dataclass
class View:
    """Frames of a passage as encoded pictures."""

    traits: VideoTraits | None = None
    """Properties of the video that its display depends on; None for images."""
    times: list[Fraction] = field(default_factory=list)
    """Seconds after the passage's first frame, on the source's clock."""
    pictures: list[bytes] = field(default_factory=list)
    """JPEG of each frame."""
    end: Fraction = Fraction(0)
    """End of the last frame, seconds after the passage's first frame."""
    guides: list[bytes] = field(default_factory=list)
    """JPEG of the guide of each frame, or of the frame itself if it has none."""

    def add(self, frame: Frame, time: Fraction) -> None:
        """Add a frame, which is shown from a time on, seconds."""
        self.times.append(time)
        self.pictures.append(self._encoded(frame.image))
        self.guides.append(self.pictures[-1] if frame.guide is None else self._encoded(frame.guide))

    def _encoded(self, image: FrameImage) -> bytes:
        """Return an image as JPEG, as it is displayed."""
        shown = as_shown(self.displayed(view(image).to_bgr()))
        return cv2.imencode(".jpg", shown, [cv2.IMWRITE_JPEG_QUALITY, QUALITY])[1].tobytes()

    def displayed(self, image: np.ndarray) -> np.ndarray:
        """Return an image, or a map of its pixels, as it is displayed and no larger than a page can use."""
        height, width = image.shape[:2]
        aspect = (self.traits.sample_aspect_ratio or 1) if self.traits else 1
        scale = min(1.0, LONGEST_SIDE / max(height, width * aspect))
        size = max(1, round(width * aspect * scale)), max(1, round(height * scale))
        if size != (width, height):
            image = cv2.resize(image, size, interpolation=cv2.INTER_AREA if scale < 1 else cv2.INTER_LINEAR)
        image = image.reshape(*image.shape[:2], -1)
        return turned_upright(image, self.traits.display_matrix if self.traits else None)

    def place_at(self, time: Fraction) -> int:
        """Return the index of the picture that is shown at a time."""
        return max(0, bisect_right(self.times, time) - 1)

    def image_at(self, time: Fraction) -> NDArray[np.uint8]:
        """Return the picture that is shown at a time, (H, W, 3)."""
        data = np.frombuffer(self.pictures[self.place_at(time)], np.uint8)
        return np.asarray(cv2.imdecode(data, cv2.IMREAD_COLOR), np.uint8)
