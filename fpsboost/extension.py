"""Names of the package, beyond the public ones, that what is built upon it may use.

These are the user interface, the cluster, plans and merges of renders, previews, and plugins of other programs: they
import from `fpsboost` and from here. ``extension.pyi`` beside this file lists the names; each is imported when it is
asked for, so that no program waits for libraries that it does not use.
"""

import ast
from importlib import import_module
from pathlib import Path
from typing import Any

_listed = ast.parse(Path(__file__).with_suffix(".pyi").read_text(encoding="utf-8")).body
_modules = {each.name: node.module for node in _listed if isinstance(node, ast.ImportFrom) for each in node.names}


def __getattr__(name: str) -> Any:
    if name not in _modules:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(f"fpsboost.{_modules[name]}"), name)
