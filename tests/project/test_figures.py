"""Published figures, the scripts that draw them, and what these scripts take from the package."""

import ast
import importlib
import re
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
FIGURES = sorted((ROOT / "docs" / "figures").iterdir())
SCRIPTS = sorted(path for folder in ("docs", "samples", "benchmarks") for path in (ROOT / folder).rglob("*.py"))
PAGES = [ROOT / "README.md", *sorted((ROOT / "docs").glob("*.md"))]


def drawn_by(script):
    """Names of the figures that a script saves; the gallery's are those of the scenes."""
    text = script.read_text("utf-8")
    names = {*re.findall(r'save\w*\(\s*(?:page, )?"([\w-]+)"', text)}
    names |= {*re.findall(r'(?:FIGURES / "|docs/figures/)([\w-]+)\.\w', text)}
    if script.name == "make_gallery.py":
        names |= {path.name for path in (ROOT / "samples" / "scenes").iterdir()}
    return names


@pytest.mark.parametrize("figure", FIGURES, ids=lambda figure: figure.name)
def test_figure_can_be_drawn_again(figure):
    """A script draws it, and a page shows it."""
    assert any(figure.stem in drawn_by(script) for script in SCRIPTS)
    assert any(f"figures/{figure.name}" in page.read_text("utf-8") for page in PAGES)


@pytest.mark.parametrize("script", SCRIPTS, ids=lambda script: f"{script.parent.name}/{script.name}")
def test_script_takes_what_the_package_has(script):
    """Every name that a script imports from the package is there."""
    for node in ast.walk(ast.parse(script.read_text("utf-8"))):
        if isinstance(node, ast.ImportFrom) and (node.module or "").split(".")[0] == "fpsboost":
            if node.module == "fpsboost.integrations.vapoursynth":
                pytest.importorskip("vapoursynth")
            module = importlib.import_module(node.module)
            for each in node.names:
                assert hasattr(module, each.name) or importlib.import_module(f"{node.module}.{each.name}")
