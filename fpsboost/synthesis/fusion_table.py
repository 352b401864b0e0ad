"""The weights of candidates: coefficients of their features, trained on synthetic scenes.

``samples/fit_fusion.py`` fits the table to scenes that ``samples/construct_clips.py`` draws; no film is among them, and
these numbers are all that is learnt from images. The logarithm of the weight of a candidate, beside that of its votes,
is a sum of its features times coefficients, plus eight hinges: such sums where they are above 0, each times a factor
(see `fpsboost.kernels.multi_hypothesis`). `docs/method.md` describes the features.
"""

from collections.abc import Mapping
from functools import cache

import numpy as np
from numpy.typing import NDArray

from fpsboost.kernels.constants import FEATURES

TABLE: Mapping[str, tuple[float, ...]] = {
    "similarity": (15.2, 15.15, -4.632, 3.637, 3.409, 5.162, -1.311, 1.37, 2.034, -10.77),
    "similarity, fine": (0.4775, -1.032, 0.6987, -0.6648, -0.1511, 1.922, 4.918, -3.249, -3.614, 2.95),
    "similarity, medium": (0.5243, -2.006, -1.559, -0.3046, 0.5442, 3.082, -1.332, 2.069, 1.059, 0.3999),
    "flatness": (-1.333, -5.591, -0.5139, -1.741, -1.537, -6.887, -7.308, -5.301, -10.91, 0.4396),
    "similarity onward, own": (-0.5257, 3.152, 0.9627, -3.061, -3.639, 1.61, 1.524, -0.9236, 3.427, -0.4957),
    "similarity onward, other": (-0.5257, -1.141, 2.272, 3.634, -3.121, 1.778, -0.9953, -1.467, 2.068, 1.954),
    "similarity onward, distance": (0.9218, 1.633, -0.7799, -0.6292, -0.6795, -0.04612, 0.5219, 1.531, -0.5779, -1.143),
    "similarity of the search, own": (-3.616, -6.601, 0.9653, -2.242, 3.058, -1.912, 3.131, 1.439, -2.479, -0.05823),
    "similarity of the search, other": (-3.616, -1.915, -0.494, 6.202, 2.807, 0.7349, 1.05, 29.37, 0.7779, 9.035),
    "similarity of the search, distance": (1.74, -5.503, 0.06636, 3.618, -3.507, -0.05432, -4.177, 9.557, -9.81, 5.647),
    "agreement with the field, own": (-0.531, -3.105, -4.824, -4.009, 3.578, -2.089, -0.5235, 4.469, -4.32, -0.916),
    "agreement with the field, other": (-0.531, -0.988, -5.13, -1.17, -3.422, -0.9771, -2.404, -7.786, 0.2391, 1.614),
    "agreement with the field, distance": (-0.205, -1.24, 2.452, -7.416, -5.059, 2.033, 3.105, 0.826, 3.346, -2.962),
    "consistency of the field, own": (0.09663, -2.17, 0.8088, -1.372, -1.592, -1.731, -1.177, 2.124, 1.76, -4.421),
    "consistency of the field, other": (0.09663, 3.107, 3.034, 0.5372, -1.155, 1.026, -2.6, 1.86, 0.8406, 3.545),
    "consistency of the field, distance": (1.932, 3.559, 1.703, -4.905, 4.353, 1.73, 1.065, 3.449, -1.335, -1.939),
    "landings, own": (1.512, 2.46, 1.367, -0.3982, -1.136, 2.524, -0.5103, -2.703, -0.07455, -4.92),
    "landings, other": (1.512, -2.001, 0.3827, -0.6636, 0.7405, -2.922, 0.02556, -1.725, -4.264, -0.4454),
    "landings, distance": (-0.3853, 1.87, 0.6427, -0.3282, 1.669, -1.064, -0.1121, 0.4621, 2.035, 2.375),
    "constant": (-12.5, -11.83, 4.472, 2.917, 1.591, -7.176, 3.134, -24.12, 4.428, 4.363),
    "share of the votes": (1.094, 3.185, 2.632, 0.5304, 0.2905, -0.9367, -1.535, -0.178, 2.103, -0.9764),
    "acceleration": (0.4082, -1.363, -7.334, -3.829, 2.153, -4.855, -2.423, 1.039, -0.7311, 0.3366),
    "gradient": (0.2571, 2.989, 4.661, 3.61, -7.764, 4.921, -0.457, 1.666, 7.721, 1.598),
    "support by neighbours": (-0.09023, 0.3803, 3.483, 2.97, 2.963, -2.512, 3.169, -0.8989, 1.03, 0.6117),
}
"""Coefficients by feature (see `fpsboost.kernels.pair_context`): for a candidate that both frames show, for one that
a single frame shows, and for each hinge. "Own" is the frame whose sample is weighted, or that the hinge belongs to."""

OUTPUTS: tuple[tuple[float, ...], ...] = (
    (-1.028, -0.5229, -0.07413, -0.34, 1.336, -0.6281, 0.656, 0.6834),
    (-0.1152, -0.8274, -0.912, -1.456, 0.5657, -0.1936, 0.2897, 0.86),
)
"""Factors of the eight hinges in the weight of both frames, and in that of their own frame alone."""

OWN = np.arange(4, 19, 3)
"""Indices of the features of frame 0 that are followed by those of frame 1."""

Coefficients = tuple[NDArray[np.float32], NDArray[np.float32], NDArray[np.float32]]
"""Symmetric part of the table, antisymmetric part, and factors of the rows; see `fusion_coefficients`."""


def mirrored(coefficients: NDArray[np.floating]) -> NDArray[np.floating]:
    """Return coefficients, or features, (..., FEATURES), with the two frames exchanged."""
    order = np.arange(FEATURES)
    order[OWN], order[OWN + 1] = OWN + 1, OWN
    return coefficients[..., order]


@cache
def fusion_coefficients() -> Coefficients:
    """Return the table in the form that the kernels take; computed once.

    Returns
    -------
    even, odd : (2 + hinges, FEATURES) float32
        Symmetric and antisymmetric part, by exchange of the frames, of the coefficients of both frames, of a single
        frame, and of each hinge.
    factors : (2 + hinges, 2) float32
        Factors of each row for both frames and for either alone.
    """
    rows = np.array(list(TABLE.values())).T
    even = (rows + mirrored(rows)) / 2
    odd = rows - even
    factors = np.vstack([[(1, 0), (0, 1)], np.array(OUTPUTS).T]) * (0.5, 1)
    return even.astype(np.float32, order="C"), odd.astype(np.float32, order="C"), factors.astype(np.float32)
