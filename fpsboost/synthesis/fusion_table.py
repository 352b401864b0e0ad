"""The weights of candidates, learnt from drawn scenes: coefficients of their features.

The table is what ``samples/fit_fusion.py`` makes of scenes that ``samples/construct_clips.py`` draws: no film is among
them, and nothing is learnt from images but these numbers. The logarithm of the weight of a candidate, beside that of
its votes, is a sum of its features times coefficients, plus eight hinges: such sums where they are above 0, each times
a factor (see `fpsboost.kernels.pixel_weights`).
"""

from __future__ import annotations

from collections.abc import Mapping
from functools import cache

import numpy as np
from numpy.typing import NDArray

from fpsboost.kernels.fusion_features import FEATURES

TABLE: Mapping[str, tuple[float, ...]] = {
    "similarity": (15.8, 12.9, -1.46, 0.564, 5.07, 4.34, -9.16, -1.31, 1.68, -1.76),
    "similarity, fine": (0.98, -0.332, 0.0216, 0.721, -1.18, -0.194, 7.89, 0.00644, -3.12, 0.131),
    "similarity, medium": (-0.32, -1.86, -2.59, -0.154, 0.968, 3.44, -2.67, -2.02, 0.663, 3.02),
    "flatness": (0.32, -4.57, -0.634, 3.02, 1.27, -6.76, -3.07, -4.14, -7.87, -7.43),
    "similarity onward, own": (-1.03, 1.99, 0.59, -1.77, -1.51, -2.87, -1.8, 3.81, 2.6, 1.58),
    "similarity onward, other": (-1.03, -1.19, 2.29, 2.69, -5.75, 1.66, 2.41, -0.845, 2.9, 0.582),
    "similarity onward, distance": (0.51, 3.47, 0.692, -3.32, -0.493, 3.82, -1.58, 0.0128, 0.0912, 1.32),
    "similarity of the search, own": (-4.01, -3.19, 0.801, -1.84, -1.02, -0.595, 5.73, 20, -7.68, -2.45),
    "similarity of the search, other": (-4.01, 0.923, 0.749, -0.35, 5.87, 6.62, 7.9, 8.92, 3.59, 1.82),
    "similarity of the search, distance": (1.09, -3.91, -5.45, 3.13, 1.97, 5.23, -2.15, 12.3, -4.41, -4.13),
    "agreement with the field, own": (-0.74, -2.66, -4.13, -1.65, 2.65, -0.453, 2.34, -4.67, -3.53, -1.96),
    "agreement with the field, other": (-0.74, -1.18, -3.75, -4.31, -1.91, -3.63, -0.518, 0.96, 0.945, -1.08),
    "agreement with the field, distance": (-2.07, -2.68, -1.49, -5.97, -3.5, 0.1, 1.84, -3.93, 1.92, 3.58),
    "consistency of the field, own": (0.123, -1.12, 1.44, 0.208, -1.21, -1.96, -4.14, 6.94, 2.23, -0.994),
    "consistency of the field, other": (0.123, 2.22, -0.236, -1, 0.78, 0.0256, -0.195, 2.74, 1.56, -1.79),
    "consistency of the field, distance": (2.11, 4.59, -0.398, 3.69, 1.97, 2.77, -0.582, 1.09, -1.96, 0.878),
    "landings, own": (2.57, 1.63, 0.476, -0.567, -0.0315, 0.37, -5.31, -1.55, -2.14, 0.344),
    "landings, other": (2.57, -2.28, 1.1, 3.76, 0.0232, -3.75, -1.26, 3.11, -3.94, 1.27),
    "landings, distance": (-1.07, 2.27, -1.54, 1.43, 0.461, -0.288, 2.23, -2.78, 1.76, -2.88),
    "constant": (-13.1, -13.7, 4.17, 4, -0.708, -6.22, 4.6, -27.9, 5.65, 4.43),
    "share of the votes": (0.35, 2.63, 2.86, 1.84, -2.65, 0.214, -2.75, -1.4, 1.33, -0.312),
    "acceleration": (0.798, 0.817, -5.29, -6.26, 3.31, -1.67, -1.17, -0.829, -0.897, 0.0884),
    "gradient": (-2.81, 0.139, 9.02, -12, -4.95, -0.0722, 2.74, 7.03, 8.75, 4.89),
    "support by neighbours": (0.000283, 1.08, 3.65, 1.48, 3.43, -1.74, 1.49, -0.879, 0.231, 3.03),
}
"""Of each feature (see `fpsboost.kernels.fusion_features`) the coefficients for both frames, for one of them alone, and
for each hinge; "own" is the frame that is weighed, or that the hinge is of."""

OUTPUTS: tuple[tuple[float, ...], ...] = (
    (-0.624, -0.188, -0.322, -0.357, 0.715, -0.323, 0.517, 0.564),
    (-0.0966, -1.01, -0.838, -1.16, 1.13, -0.262, 0.145, 0.416),
)
"""Factors of the hinges for both frames, and for their own frame alone."""

OWN = np.arange(4, 19, 3)
"""Numbers of the features of frame 0 that are followed by those of frame 1."""

Coefficients = tuple[NDArray[np.float32], NDArray[np.float32], NDArray[np.float32]]


def mirrored(coefficients: NDArray[np.floating]) -> NDArray[np.floating]:
    """Return coefficients, or features, (..., FEATURES), with both frames exchanged."""
    order = np.arange(FEATURES)
    order[OWN], order[OWN + 1] = OWN + 1, OWN
    return coefficients[..., order]


def as_coefficients(rows: NDArray[np.floating], outputs: NDArray[np.floating]) -> Coefficients:
    """Return a table, (2 + hinges, FEATURES), and the factors of the hinges, (hinges, 2), as the kernels take them.

    These are the even and the odd part of the table by exchange of the frames, and the coefficients and factors of each
    row that `fpsboost.kernels.window_rows.add_feature_row` takes.
    """
    even = (rows + mirrored(rows)) / 2
    odd = rows - even
    every = np.vstack([[(1, 0), (0, 1)], outputs]) * (0.5, 1)
    factors = np.column_stack([even[:, :7], odd[:, 4], every])
    return even.astype(np.float32), odd.astype(np.float32), factors.astype(np.float32).ravel()


@cache
def fusion_coefficients() -> Coefficients:
    """Return the coefficients of the learnt table as the kernels take them."""
    return as_coefficients(np.array(list(TABLE.values())).T, np.array(OUTPUTS).T)
