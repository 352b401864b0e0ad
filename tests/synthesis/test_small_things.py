"""Things of a few pixels that move by many: they are there half-way."""

import numpy as np
import pytest

from support.small_things import KINDS, shown_by_kind, small_things


@pytest.fixture(scope="module")
def by_kind():
    """What `nlm` and `dis` show of things of 5 and 10 pixels that move by 12 to 58."""
    return shown_by_kind(small_things((5, 10), (12, 30, 58), 1), ("nlm", "dis"))


@pytest.mark.parametrize("textured", [False, True])
@pytest.mark.parametrize("kind", KINDS)
def test_small_things_are_at_least_as_by_optical_flow(by_kind, kind, textured):
    """Of each kind before either ground: no further from the truth, and no more of them missing."""
    ours, other = (found.mean(axis=0) for found in by_kind[kind, textured])
    assert np.all(ours >= other)


@pytest.mark.parametrize(
    ("kind", "textured", "share"),
    [("rod", False, 0.9), ("ball", False, 0.7), ("note", False, 0.7), ("rod", True, 0.55), ("ball", True, 0.6)],
)
def test_most_of_a_small_thing_is_there(by_kind, kind, textured, share):
    """Rods, balls, and notes before flat ground."""
    assert by_kind[kind, textured][0][:, 1].mean() > share
