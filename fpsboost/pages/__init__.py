"""Pages that need only a browser: shared templates, a player of frames, and pictures as they stand in a page.

A comparison, a preview and the page of `fpsboost ui` are made of them. Nothing of the package is imported here.
"""

import base64
from dataclasses import dataclass, field
from typing import Any

import cv2
import numpy as np
from jinja2 import ChoiceLoader, Environment, PackageLoader, StrictUndefined
from markupsafe import Markup

QUALITY = 92
"""WebP quality of a picture, of 100."""

LOSSLESS = 101
"""OpenCV's quality of WebP without loss."""

MAX_WIDTH = 1280
"""Width of a picture that a page can use, pixels."""


@dataclass
class PlayerData:
    """Frames that the player of a page shows, in the form that player.js reads."""

    names: list[str]
    """Names of the views."""
    width: int
    """Width of a picture, pixels."""
    height: int
    """Height of a picture, pixels."""
    fps: float
    """Frames per second at full speed."""
    frames: list[dict[str, Any]] = field(default_factory=list)
    """For each frame its ``number``, ``passage``, ``note``, the indices of its ``images`` in `uris` (one of each view,
    or one for all of them), and optionally ``loss``, the mean absolute error of the compression of its first picture,
    levels of 255."""
    opening: int | None = None
    """Index of the frame that is shown first; None for the first one."""
    _places: dict[str, int] = field(default_factory=dict)
    """Index of each picture, by its data URI."""

    @property
    def uris(self) -> list[str]:
        """Data URIs of all pictures, each once."""
        return list(self._places)

    def add_picture(self, uri: str) -> int:
        """Return the index of a picture in `uris`; it is added if it is new."""
        return self._places.setdefault(uri, len(self._places))

    def as_json(self) -> dict[str, Any]:
        """Return the data for player.js."""
        return {name: getattr(self, name) for name in ("names", "fps", "uris", "frames", "opening")}


def templates_of(package: str) -> Environment:
    """Return the templates of a package and the shared ones.

    In templates, ``text_of(file)`` inserts a file without changes, such as a script.
    """
    loader = ChoiceLoader([PackageLoader(package), PackageLoader("fpsboost.pages")])
    environment = Environment(
        loader=loader, autoescape=True, undefined=StrictUndefined, trim_blocks=True, lstrip_blocks=True
    )
    environment.globals["text_of"] = lambda file: Markup(loader.get_source(environment, file)[0])
    return environment


def encode(image: np.ndarray, quality: int = QUALITY) -> str:
    """Return an image, (H, W, C) uint8, as WebP in a data URI."""
    return data_uri(as_webp(image, quality), "webp")


def data_uri(picture: bytes, kind: str) -> str:
    """Return an encoded picture as a data URI; `kind` is ``webp``, ``jpeg``..."""
    return f"data:image/{kind};base64,{base64.b64encode(picture).decode()}"


def as_webp(image: np.ndarray, quality: int) -> bytes:
    """Return an image, (H, W, C) uint8, encoded as WebP."""
    return cv2.imencode(".webp", image, [cv2.IMWRITE_WEBP_QUALITY, quality])[1].tobytes()


def not_too_wide(image: np.ndarray) -> np.ndarray:
    """Return an image, reduced if it is wider than `MAX_WIDTH`."""
    height, width = image.shape[:2]
    size = MAX_WIDTH, max(1, round(height * MAX_WIDTH / width))
    return image if width <= MAX_WIDTH else cv2.resize(image, size, interpolation=cv2.INTER_AREA)


def as_heat(values: np.ndarray) -> np.ndarray:
    """Return values of (H, W), 0 to 1, as colours from black over red to pale yellow, (H, W, 3) uint8."""
    levels = np.rint(values.clip(0, 1) * 255).astype(np.uint8)
    return np.asarray(cv2.applyColorMap(levels, cv2.COLORMAP_INFERNO))
