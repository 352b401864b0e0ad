"""The page about arrays of science holds what it says: its own code is run, without motion."""

import re
from pathlib import Path

import numpy as np
import pytest

PAGE = Path(__file__).parents[2] / "docs" / "arrays.md"


@pytest.fixture(scope="module")
def page():
    """Names that the code of the page defines."""
    names = {}
    blocks = re.findall(r"```python\n(.*?)```", PAGE.read_text(encoding="utf-8"), re.DOTALL)
    exec("".join(blocks).replace('"nlm"', '"blend"'), names)
    return names


def test_code_of_the_page_gives_its_series(page):
    """A scan for every minute, with NaN outside and no value beyond the range; three fields become five."""
    minutes, outside = page["every_minute"], page["is_outside"]
    assert sorted(minutes) == list(range(16))
    for dbz in minutes.values():
        assert np.isnan(dbz[outside]).all()
        assert -10 <= np.nanmin(dbz) <= np.nanmax(dbz) <= 40
    assert len(page["movie"]) == 5
    assert np.isnan(page["movie"][3][:, :4]).all()


@pytest.mark.parametrize(("t", "known"), [(0.25, [[1, 1, 0, 0]]), (0.75, [[1, 0, 1, 0]])])
def test_arrays_keep_gaps_units_and_times(page, t, known):
    """A gap of one array counts while it is the nearer one; units may be any, and a mean is that of the time."""
    pattern = np.random.default_rng(1).uniform(-300, -200, (32, 48))
    array0, array1 = pattern.copy(), pattern + 4
    array0[:, 24:], array1[:, 12:24], array1[:, 36:] = np.nan, np.nan, np.nan
    ((values, confidence),) = page["between"](array0, array1, [t], "blend")
    np.testing.assert_array_equal(np.isfinite(values), np.repeat(np.repeat(known, 32, 0), 12, 1))
    np.testing.assert_allclose(values[:, :12], pattern[:, :12] + 4 * t, atol=1e-3)
    assert confidence.shape == values.shape
