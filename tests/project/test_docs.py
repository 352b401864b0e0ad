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


def test_files_that_the_tree_names_exist():
    """Every file of the package stands in CONTRIBUTING.md, and nothing else does."""
    text = (ROOT / "CONTRIBUTING.md").read_text(encoding="utf-8")
    tree = text[text.index("fpsboost/\n") : text.index("tests/  benchmarks/")]
    folders: list[str] = []
    named = set()
    for line in tree.splitlines()[1:]:
        depth = (len(line) - len(line.lstrip())) // 2 - 1
        for word in re.split(r",? +", line.strip()):
            if word.endswith("/"):
                folders[depth:] = [word]
            elif word.endswith(".py"):
                named.add("".join(folders[:depth]) + word)
            elif not word.endswith((".css", ".js")):
                break
    there = {str(path.relative_to(ROOT / "fpsboost")) for path in (ROOT / "fpsboost").rglob("*.py")}
    there -= {path for path in there if path.endswith(("__init__.py", "__main__.py"))}
    assert named == there
