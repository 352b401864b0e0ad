"""The weights of candidates, learnt from drawn scenes: coefficients of their features.

The table is what ``samples/fit_fusion.py`` makes of scenes that ``samples/construct_clips.py`` draws: no film, no
network. The logarithm of the weight of a candidate, beside that of its votes, is the sum of its features times these
coefficients (see `fpsboost.kernels.fusion_features`); those of either frame alone mirror each other.
"""

from __future__ import annotations

from collections.abc import Mapping
from functools import cache

import numpy as np
from numpy.typing import NDArray

from fpsboost.kernels.fusion_features import FEATURES

SINGLE: Mapping[str, int] = {
    "similarity": 0,
    "lack of similarity": 1,
    "similarity, fine": 2,
    "similarity, medium": 3,
    "flatness": 4,
    "similarity on flat ground": 5,
    "constant": 21,
    "share of the votes": 22,
    "acceleration": 23,
    "gradient": 24,
    "support by neighbours": 25,
}
"""Features that are the same for both frames, and their numbers."""

PAIRED: Mapping[str, int] = {
    "similarity onward": 6,
    "similarity of the search": 9,
    "agreement with the field": 12,
    "consistency of the field": 15,
    "landings": 18,
}
"""Features of frame 0, of frame 1, and how far the two are apart; the number of the first of the three."""

Coefficients = Mapping[str, tuple[float, ...]]

TABLE: Coefficients = {
    "similarity": (14.3, 16.1),
    "lack of similarity": (4.22, 2.56),
    "similarity, fine": (5.16, 0.202),
    "similarity, medium": (-3.23, -0.721),
    "flatness": (-6.37, 0.754),
    "similarity on flat ground": (-3.62, -2.49),
    "constant": (-19.6, -20.4),
    "share of the votes": (-3.81, -0.0886),
    "acceleration": (0.874, 0.793),
    "gradient": (7.74, 1.43),
    "support by neighbours": (3.55, -0.396),
    "similarity onward": (1.97, -0.745, 0.854, 0.166),
    "similarity of the search": (0.656, -6.2, -5.8, -5.57),
    "agreement with the field": (3.16, 3.1, -0.0307, 0.208),
    "consistency of the field": (-4.35, 2.12, 0.259, 0.638),
    "landings": (-1.82, 1.85, 1.16, 1.11),
}
"""Of single features the coefficient for both frames, and for one alone; of paired ones, for both frames those of the
sum and of the distance, for one alone those of its own and of the other's."""


def as_table(coefficients: Coefficients) -> NDArray[np.float32]:
    """Return the coefficients of every feature for both frames, frame 0 alone and frame 1 alone, (3, FEATURES).

    Examples
    --------
    >>> as_table({"similarity": (18, 14)})[:, 0].tolist()
    [18.0, 14.0, 14.0]
    """
    table = np.zeros((3, FEATURES), np.float32)
    for name, values in coefficients.items():
        if name in SINGLE:
            table[:, SINGLE[name]] = values[0], values[1], values[1]
        else:
            both, distance, own, other = values
            table[:, PAIRED[name] : PAIRED[name] + 3] = (both, both, distance), (own, other, 0), (other, own, 0)
    return table


@cache
def fusion_table() -> NDArray[np.float32]:
    """Return the learnt table as the kernels take it."""
    return as_table(TABLE)
