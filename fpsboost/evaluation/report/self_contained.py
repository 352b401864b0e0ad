"""Pages that need nothing but a browser: their style sheets, scripts and pictures lie in them."""

from __future__ import annotations

import base64
from dataclasses import dataclass, field
from typing import Any

import cv2
import numpy as np
from jinja2 import ChoiceLoader, Environment, PackageLoader, StrictUndefined
from markupsafe import Markup
from numpy.typing import NDArray

QUALITY = 92
"""WebP quality of a picture, of 100."""

LOSSLESS = 101
"""OpenCV's quality of WebP without loss."""

MAX_WIDTH = 1280
"""Width of a picture that a page can use, pixels."""


@dataclass
class PlayerData:
    """Frames that the player of a page shows, as player.js takes them."""

    names: list[str]
    width: int
    height: int
    fps: float
    frames: list[dict[str, Any]] = field(default_factory=list)
    """For each frame its ``number``, ``passage``, ``note``, the places of its ``images`` in `uris` (one of each view,
    or one for all of them), and optionally ``loss``, the mean absolute error that compression leaves in its first
    picture, levels of 255."""
    opening: int | None = None
    _places: dict[str, int] = field(default_factory=dict)

    @property
    def uris(self) -> list[str]:
        return list(self._places)

    def add_picture(self, uri: str) -> int:
        """Return the place of a picture in `uris`, to which it is added if it is new."""
        return self._places.setdefault(uri, len(self._places))

    def as_json(self) -> dict[str, Any]:
        """Return what player.js reads."""
        names = ("names", "fps", "uris", "frames", "opening")
        return {name: getattr(self, name) for name in names}


def templates_of(*packages: str) -> Environment:
    """Return the templates of packages and the shared ones, in which ``text_of(file)`` is a file as it is."""
    loader = ChoiceLoader([PackageLoader(package) for package in (*packages, "fpsboost.evaluation.report")])
    environment = Environment(
        loader=loader, autoescape=True, undefined=StrictUndefined, trim_blocks=True, lstrip_blocks=True
    )
    environment.globals["text_of"] = lambda file: Markup(loader.get_source(environment, file)[0])
    return environment


def encode(image: NDArray[Any], quality: int = QUALITY) -> str:
    """Return an image of (H, W, C) uint8 as WebP in a data URI."""
    return data_uri(as_webp(image, quality), "webp")


def data_uri(picture: bytes, kind: str) -> str:
    """Return an encoded picture as a data URI; `kind` is ``webp``, ``jpeg``..."""
    return f"data:image/{kind};base64,{base64.b64encode(picture).decode()}"


def as_webp(image: NDArray[Any], quality: int) -> bytes:
    """Return an image of (H, W, C) uint8 as WebP."""
    return cv2.imencode(".webp", image, [cv2.IMWRITE_WEBP_QUALITY, quality])[1].tobytes()


def not_too_wide(image: NDArray[Any]) -> NDArray[Any]:
    """Return an image, reduced if it is wider than a page can use."""
    height, width = image.shape[:2]
    size = MAX_WIDTH, max(1, round(height * MAX_WIDTH / width))
    return image if width <= MAX_WIDTH else cv2.resize(image, size, interpolation=cv2.INTER_AREA)


def as_heat(values: NDArray[Any]) -> NDArray[Any]:
    """Return values of (H, W), 0 to 1, as colours from black over red to pale yellow, (H, W, 3) uint8."""
    levels = np.rint(values.clip(0, 1) * 255).astype(np.uint8)
    return np.asarray(cv2.applyColorMap(levels, cv2.COLORMAP_INFERNO))
