"""Column sums of similarity, moved down row by row."""

from __future__ import annotations

import numpy as np
from twins import uncompiled

from fpsboost.kernels.box import slide_box
from fpsboost.kernels.jit import LANES, njit
from fpsboost.kernels.similarity import UNIT, similarity


@njit()
def slide(planes0, place0, plane0, planes1, place1, plane1, oldest, newest, columns, at):
    """Call the compiled form."""
    slide_box(planes0, place0, plane0, planes1, place1, plane1, oldest, newest, columns, at)


def test_a_row_comes_in_and_one_goes_out_alike_compiled_and_not():
    """To the bit, from equal pixels to such as have nothing in common; nothing beside the columns is written."""
    random, plane = np.random.default_rng(1), 60
    first = random.random(3 * plane).astype(np.float32) * np.float32(0.5)
    second = first + random.normal(size=first.size).astype(np.float32) * np.float32(0.5)
    second[20] = 50
    for c in range(3):
        second[c * plane + 9 : c * plane + 13] = first[c * plane + 4 : c * plane + 8]
    before = random.integers(0, 5 * UNIT, (2, 40)).astype(np.int32)
    similar = [int(similarity(*first[4 + x :: plane][:3], *second[9 + x :: plane][:3])) for x in range(LANES)]
    assert similar[0] == UNIT
    assert min(similar) == 0
    expected_rows, expected_sums = before.copy()
    expected_sums[7 : 7 + LANES] += similar - before[0, 3 : 3 + LANES]
    expected_rows[3 : 3 + LANES] = similar
    for call in (slide, uncompiled(slide)):
        oldest, columns = before.copy()
        call(first, 4, plane, second, 9, plane, oldest, 3, columns, 7)
        np.testing.assert_array_equal(oldest, expected_rows)
        np.testing.assert_array_equal(columns, expected_sums)
