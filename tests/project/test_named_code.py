"""Files and functions that the pages of the documentation name."""

import re
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
PAGES = sorted([*ROOT.glob("*.md"), *ROOT.glob("docs/**/*.md")])


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_named_code_exists(page):
    """Every `fpsboost/FILE:NAME` of a page stands in that file."""
    for file, name in re.findall(r"`(fpsboost/[\w/]+\.\w+):(\w+)`", page.read_text("utf-8")):
        assert re.search(rf"\b{name}\b", (ROOT / file).read_text("utf-8")), f"{file}:{name}"
