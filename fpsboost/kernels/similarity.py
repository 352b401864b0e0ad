"""Similarity of two pixels: the report's exponential (section 3.2, Eqs. 3 and 4), and a linear form of it on bytes.

The product over the colour components of ``exp(-d^2 / (2 v^2))`` is one exponential of a sum. With images scaled by
`colour_scale`, it is ``2^-s`` of a plain sum of squares s, and computed in integers: a polynomial for the fraction of
s, a shift for its integer part. Fixed-point values make every later sum exact, whatever its order, so that running sums
do not drift, ties in flat areas stay ties, and the result does not depend on the number of threads.

The linear form, ``max(1 - sum_c |a_c - b_c| / (4 v), 0)``, falls from 1 to 0 approximately as the exponential does (v
is the bandwidth), and takes a dozen instructions for sixteen pixels.
"""

import math

FRACTION_BITS = 20
UNIT = 1 << FRACTION_BITS
"""Fixed-point similarity of two equal pixels."""

WHITE = 255
"""Largest level."""

TRUNCATION = 4
"""Sum of absolute differences, in units of the bandwidth, at which the similarity reaches 0."""


def colour_scale(bandwidth: float) -> float:
    """Return the factor on colours in [0, 1] after which the similarity is ``2^-(sum of squared differences)``."""
    return math.sqrt(math.log2(math.e) / 2) / bandwidth


def level_scale(bandwidth: float) -> float:
    """Return the levels of a component that ranges over 1: 255, or fewer if the truncation would exceed 255."""
    return WHITE * min(1.0, 1 / (TRUNCATION * bandwidth))


def truncation(bandwidth: float) -> int:
    """Return the sum of absolute differences over all components, in levels, at which the similarity reaches 0."""
    return max(1, round(TRUNCATION * bandwidth * level_scale(bandwidth)))
