"""What is imported of numba, and what is imported at all."""

from __future__ import annotations

import ast
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest
from video_truth import write_clip

PACKAGE = Path(__file__).parents[2] / "fpsboost"

PUBLIC = {
    *("numba.njit", "numba.types", "numba.config", "numba.extending.type_callable", "numba.extending.lower_builtin"),
    *("numba.extending.register_jitable", "numba.core.types", "numba.core.cgutils", "llvmlite.ir"),
}
"""What numba's documentation shows of itself and of llvmlite."""


def names_of_numba(source: str) -> Iterator[str]:
    """Yield the full names of what a module takes from numba and llvmlite."""
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.ImportFrom) and (node.module or "").split(".")[0] in {"numba", "llvmlite"}:
            yield from (f"{node.module}.{name.name}" for name in node.names)
        elif isinstance(node, ast.Import):
            yield from (name.name for name in node.names if name.name.startswith(("numba.", "llvmlite")))
        elif isinstance(node, ast.Attribute) and isinstance(node.value, ast.Name) and node.value.id == "numba":
            yield f"numba.{node.attr}"


def test_only_what_is_public_of_numba_is_used():
    """Anything else may be renamed by a release that changes nothing for its users."""
    used = {name: path.name for path in PACKAGE.rglob("*.py") for name in names_of_numba(path.read_text("utf-8"))}
    assert {name: where for name, where in used.items() if name not in PUBLIC} == {}


@pytest.mark.parametrize(
    "arguments", [("probe", "in.mp4"), ("in.mp4", "out.mp4", "--method", "blend"), ("in.mp4", "out.mp4")]
)
def test_what_a_conversion_does_not_need_is_not_imported(tmp_path, arguments):
    """Metrics, figures, pages and clusters; numba is needed by the detection of scene cuts already."""
    write_clip(tmp_path / "in.mp4")
    code = f"""if True:
        import atexit, sys
        others = {{"skimage", "matplotlib", "jinja2", "distributed", "starlette"}}
        atexit.register(lambda: print("loaded:", others & set(sys.modules)))
        sys.argv = ["fpsboost", *{arguments}]
        from fpsboost.__main__ import main
        main()
    """
    result = subprocess.run([sys.executable, "-c", code], cwd=tmp_path, capture_output=True, text=True, check=True)
    assert result.stdout.splitlines()[-1] == "loaded: set()"
