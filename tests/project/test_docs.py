"""What the documentation names is there."""

from __future__ import annotations

import re
from pathlib import Path

ROOT = Path(__file__).parents[2]


def test_functions_that_pages_name_exist():
    """``path.py:name`` is a file of the package, and it defines or assigns that name."""
    pages = {page.name: page.read_text(encoding="utf-8") for page in (ROOT / "docs").glob("*.md")}
    places = [(page, *place) for page in pages for place in re.findall(r"`(\w+/[\w/]*\.py):([\w.]+)`", pages[page])]
    assert places
    for page, path, name in places:
        code = (ROOT / "fpsboost" / path.removeprefix("fpsboost/")).read_text(encoding="utf-8")
        last = name.split(".")[-1]
        definition = rf"(def|class) {last}\b|{last}\b(, \w+)* *(:.*)?=|(\w+, )+{last} =| *{last}: "
        assert re.search(rf"^\s*({definition})", code, re.M), f"{page}: {path}:{name}"
