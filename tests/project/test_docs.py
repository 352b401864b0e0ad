"""What the documentation names is there."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]


@pytest.mark.parametrize("page", sorted((ROOT / "docs").glob("*.md")), ids=lambda page: page.stem)
def test_functions_that_a_page_names_exist(page):
    """``path.py:name`` is a file of the package, and it defines or assigns that name."""
    for path, name in re.findall(r"`(\w+/[\w/]*\.py):([\w.]+)`", page.read_text(encoding="utf-8")):
        code = (ROOT / "fpsboost" / path.removeprefix("fpsboost/")).read_text(encoding="utf-8")
        last = name.split(".")[-1]
        found = re.search(
            rf"^\s*(def|class) {last}\b|^\s*{last}\b(, \w+)* *(:.*)?=|^\s*(\w+, )+{last} =|^    {last}: ", code, re.M
        )
        assert found, f"{page.name}: {path}:{name}"
