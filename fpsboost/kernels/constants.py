"""Numbers that the kernels in C++ and their callers in Python both know: ``hatch_build.py`` writes them into a header.

Nothing is imported here, as the program that compiles the kernels runs this file by itself.
"""

KINDS = ("uint8", "uint16", "float32", "int32", "int64", "float64", "bool")
"""Types of elements; the place of each is its number in C++."""

MAX_AXES = 5

LANES = 16
"""Group size, pixels: rows are processed in whole groups, as a remainder would cost as much as ten of them."""

HIGH_PASS_SIZE = 9
"""Side of the box whose mean luma is subtracted, pixels."""

FRACTION_BITS = 20
"""The fixed-point similarity of two equal pixels is two to this power."""

WHITE = 255
"""Largest level of the planes that are compared."""

TILE = 32
"""Side of a tile of the search of a level, pixels."""

MAX_TILE_PATCH_RADIUS = 10
"""Largest radius of the patches of the search of a level, pixels."""

MAX_PATCH_RADIUS = 20
"""Largest radius r of the patches of the exhaustive search, pixels: (2r + 1)^2 fixed-point similarities must fit 31
bits."""

SUMS_PER_CANDIDATE = 10
"""Number of sums per candidate: dx, dy; of votes whose acceleration is known, votes, ax, ay, ax^2 + ay^2; and the
gradients of dx and dy along x, then along y."""

VALUES_PER_MOTION = 8
"""Number of values per candidate: dx, dy; acceleration ax, ay; and the gradients of dx and dy along x, then along y."""

UNKNOWN = 0.1
"""Share of a candidate's votes that count as votes for zero acceleration."""

MARGIN = 40
"""Width of the repeated edges of spline coefficients beyond the frame, pixels."""

BLOCKS_2X2_PER_ROW = 16
"""2x2 blocks of pixels across a window, which has BLOCKS_2X2. Each has one weight: weights are means over patches,
which vary slowly."""

BLOCKS_2X2 = BLOCKS_2X2_PER_ROW**2

WINDOW = 2 * BLOCKS_2X2_PER_ROW
"""Side of a window, pixels."""

WINDOW_BLOCK = 8
"""Side of the blocks of a zoomed or turned window that move as their centre does, pixels."""

END_WEIGHT = 0.75
"""Weight of the first and the last of the five 2x2 blocks across a patch: equivalent to sums over patches of nine
pixels around each pixel."""

SPARE = 16
"""Columns of coefficients that are needed beyond the right margin: rows are read sixteen values at a time."""

FEATURES = 24
"""Features of a candidate in one 2x2 block of a window, by which the learnt weights weigh it."""

FEATURE_SUMS = 10
"""Sums of features: for both frames along a candidate, for either alone, and for each hinge."""

CONFIDENCE_POWER = 8
"""Power of the similarity that is the confidence: eight corresponds to a bandwidth of about a third, as a few levels
hardly change the weights, but are visible."""

STATIC = 1
"""Mark of a pixel that stays the same although its surroundings move."""

STATIC_CONTRAST = 2
"""Mark of such a pixel that would be different if it had moved."""

MOVING_SHARE = 0.8
"""Share of the pixels that would be an overlay, in a block and those around it, above which they are none if they
follow the motion of their own points. Around letters, a part of them does by chance."""

FRACTIONS = 64
"""Positions within a pixel, along an axis, at which pictures are sampled along smooth motion: a power of two."""

BINS = 6
"""Bins of the power of detail, in each of which the usual power of a difference is known."""

BANDS = 6
"""Largest number of bands into which a difference from a guide is split."""
