"""What is imported of numba."""

from __future__ import annotations

import ast
from collections.abc import Iterator
from pathlib import Path

PACKAGE = Path(__file__).parents[2] / "fpsboost"

PUBLIC = {
    *("numba.njit", "numba.types", "numba.config", "numba.extending.type_callable", "numba.extending.lower_builtin"),
    *("numba.core.types", "numba.core.cgutils", "llvmlite.ir"),
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
