"""FLIP: the difference that a person sees who flips between two images, by NVIDIA's own program.

It is the package ``flip-evaluator``, which the extra ``fpsboost[flip]`` installs and nothing else needs.
"""

from __future__ import annotations

from importlib.util import find_spec
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fpsboost.evaluation.metrics import as_shown
from fpsboost.frame import Image

PACKAGE = "flip_evaluator"


def missing() -> str | None:
    """Return what is missing to measure it, or None."""
    return None if find_spec(PACKAGE) else "the package flip-evaluator; install it with pip install 'fpsboost[flip]'"


class FlipMeter:
    """LDR-FLIP of the made frames of one method, mean over the pixels: 0 is equal, 1 black beside white.

    Andersson et al. 2020 ("FLIP: a difference evaluator for alternating images", PACMCGIT 3(2), doi:10.1145/3406183).
    Images are taken as a screen shows them (`fpsboost.evaluation.metrics.as_shown`), 67 pixels a degree, which is the
    program's default: a 4K screen of 0.7 m from 0.7 m away.
    """

    def __init__(self) -> None:
        self._values: list[dict[str, float]] = []

    def shown(self, image: Image) -> None:
        """Ignore a frame that nobody made."""

    def made(self, truth: Image, made: Image) -> None:
        """Compare a frame."""
        from flip_evaluator import evaluate  # noqa: PLC0415 (an extra, which may be missing)

        _, mean, _ = evaluate(_as_rgb(truth), _as_rgb(made), "LDR", applyMagma=False)
        self._values.append({"flip": float(mean)})

    def values(self) -> list[dict[str, float]]:
        """Return ``flip`` of every made frame."""
        return self._values


def _as_rgb(image: Image) -> NDArray[Any]:
    """Return sRGB as FLIP takes it, (H, W, 3) float32 with 1.0 for white."""
    return np.ascontiguousarray(as_shown(image)[..., ::-1]).astype(np.float32) / np.float32(255)
