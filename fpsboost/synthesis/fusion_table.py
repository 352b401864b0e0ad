"""The weights of candidates: coefficients of their features, trained on synthetic scenes.

``samples/fit_fusion.py`` fits the table to scenes that ``samples/construct_clips.py`` draws; no film is among them, and
these numbers are all that is learnt from images. The logarithm of the weight of a candidate, beside that of its votes,
is a sum of its features times coefficients, plus eight hinges: such sums where they are above 0, each times a factor
(see `fpsboost.kernels.multi_hypothesis`). `docs/method.md` describes the features.
"""

from __future__ import annotations

from collections.abc import Mapping
from functools import cache

import numpy as np
from numpy.typing import NDArray

from fpsboost.kernels.pair_context import FEATURES

TABLE: Mapping[str, tuple[float, ...]] = {
    "similarity": (14.7, 15.3, -4.57, 3.66, 3.38, 5.31, -1.19, 1.26, 1.37, -10.9),
    "similarity, fine": (0.374, -0.876, 0.67, -0.797, -0.304, 1.84, 5.01, -3.11, -3.48, 3.07),
    "similarity, medium": (0.487, -1.91, -1.63, -0.303, 0.447, 2.99, -1.24, 2, 1.07, 0.483),
    "flatness": (-1.33, -5.44, -0.139, -1.96, -1.5, -6.76, -7.24, -5.15, -10.4, 0.255),
    "similarity onward, own": (-0.558, 2.96, 0.977, -3.33, -3.68, 1.61, 1.66, -0.945, 3.37, -0.644),
    "similarity onward, other": (-0.558, -0.904, 2.24, 3.41, -3.29, 1.61, -0.842, -1.58, 2.18, 2.13),
    "similarity onward, distance": (0.918, 1.49, -0.282, -0.566, -0.721, -0.127, 0.488, 1.5, -0.679, -1.38),
    "similarity of the search, own": (-3.47, -6.6, 1.59, -2.45, 3.38, -2.1, 2.68, 1.8, -2.12, -0.379),
    "similarity of the search, other": (-3.47, -2, 0.222, 5.65, 3.41, 0.197, 0.974, 28.9, 1.66, 8.52),
    "similarity of the search, distance": (2.16, -5.26, 0.162, 3.07, -4.1, 0.544, -4.32, 8.96, -9.5, 5.81),
    "agreement with the field, own": (-0.821, -3.22, -4.65, -3.65, 3.67, -2.04, -0.659, 4.42, -4.67, -1.07),
    "agreement with the field, other": (-0.821, -0.994, -4.99, -1.02, -3.3, -0.928, -2.58, -7.68, -0.086, 1.65),
    "agreement with the field, distance": (-0.645, -0.896, 2.66, -6.97, -4.89, 1.65, 2.9, 0.276, 2.72, -2.59),
    "consistency of the field, own": (0.0892, -2.19, 1.01, -1.21, -1.59, -1.79, -1.43, 2.35, 2.02, -4.51),
    "consistency of the field, other": (0.0892, 2.96, 3.23, 0.532, -1.05, 1.07, -2.75, 1.87, 1.22, 3.42),
    "consistency of the field, distance": (1.84, 3.61, 2.03, -5.1, 4.41, 1.83, 0.871, 3.81, -0.986, -2.09),
    "landings, own": (1.58, 2.25, 1.12, -0.549, -1.16, 2.51, -0.243, -2.72, 0.255, -4.95),
    "landings, other": (1.58, -1.92, 0.131, -0.74, 0.537, -2.98, 0.0801, -1.64, -4.09, -0.412),
    "landings, distance": (-0.442, 1.92, 0.362, -0.455, 1.61, -1.1, 0.128, 0.395, 1.91, 2.49),
    "constant": (-11.9, -11.8, 3.14, 3.61, 1.09, -6.67, 3.38, -24.2, 3.39, 5.39),
    "share of the votes": (0.732, 3.03, 2.61, 0.823, 0.454, -0.969, -1.52, 0.189, 1.67, -1.23),
    "acceleration": (0.323, -1.57, -6.73, -3.31, 2.23, -4.67, -2.71, 1.07, -0.902, -0.0109),
    "gradient": (-0.124, 3.73, 4.14, 3.69, -7.82, 5.5, -0.574, 2.17, 7.42, 2.24),
    "support by neighbours": (-0.161, 0.425, 3.45, 3.06, 2.92, -2.58, 3.18, -0.818, 0.917, 0.616),
}
"""Coefficients by feature (see `fpsboost.kernels.pair_context`): for a candidate that both frames show, for one that
a single frame shows, and for each hinge. "Own" is the frame whose sample is weighted, or that the hinge belongs to."""

OUTPUTS: tuple[tuple[float, ...], ...] = (
    (-0.943, -0.46, -0.105, -0.319, 1.35, -0.555, 0.505, 0.735),
    (-0.0957, -0.814, -0.992, -1.53, 0.594, -0.188, 0.268, 0.889),
)
"""Factors of the eight hinges in the weight of both frames, and in that of their own frame alone."""

OWN = np.arange(4, 19, 3)
"""Indices of the features of frame 0 that are followed by those of frame 1."""

Coefficients = tuple[NDArray[np.float32], NDArray[np.float32], NDArray[np.float32]]
"""Symmetric part of the table, antisymmetric part, and factors of the rows; see `as_coefficients`."""


def mirrored(coefficients: NDArray[np.floating]) -> NDArray[np.floating]:
    """Return coefficients, or features, (..., FEATURES), with the two frames exchanged."""
    order = np.arange(FEATURES)
    order[OWN], order[OWN + 1] = OWN + 1, OWN
    return coefficients[..., order]


def as_coefficients(rows: NDArray[np.floating], outputs: NDArray[np.floating]) -> Coefficients:
    """Return a table in the form that the kernels take.

    Parameters
    ----------
    rows : (2 + hinges, FEATURES)
        Coefficients of both frames, of a single frame, and of each hinge.
    outputs : (hinges, 2)
        Factors of the hinges, for both frames and for their own frame.

    Returns
    -------
    even, odd : (2 + hinges, FEATURES) float32
        Symmetric and antisymmetric part of the rows by exchange of the frames.
    factors : (2 + hinges, 2) float32
        Factors of each row for both frames and for either alone.
    """
    even = (rows + mirrored(rows)) / 2
    odd = rows - even
    factors = np.vstack([[(1, 0), (0, 1)], outputs]) * (0.5, 1)
    return even.astype(np.float32, order="C"), odd.astype(np.float32, order="C"), factors.astype(np.float32)


@cache
def fusion_coefficients() -> Coefficients:
    """Return the coefficients of `TABLE` in the form that the kernels take; computed once."""
    return as_coefficients(np.array(list(TABLE.values())).T, np.array(OUTPUTS).T)
