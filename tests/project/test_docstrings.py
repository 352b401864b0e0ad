"""Docstrings agree with the signatures that they describe, as numpydoc checks it."""

from __future__ import annotations

import importlib
import inspect
import pkgutil
import re
from collections.abc import Iterator

import pytest
from numpydoc.validate import validate

import fpsboost

ABOUT_PARAMETERS = {"PR01", "PR02", "PR03", "PR04", "PR05", "PR06", "PR08", "PR10"}
"""Parameters that are missing, unknown, in another order, without a type, or badly written."""

ABOUT_FORM = {"GL01", "GL02", "GL05", "GL06", "GL07", "GL10", "SS02", "SS03"}
"""Sections that are unknown, empty or out of order, and summaries that are no sentences."""

MODULES = [
    module.name
    for module in pkgutil.walk_packages(fpsboost.__path__, "fpsboost.")
    if not module.name.endswith("__main__") and not module.name.startswith(("fpsboost.cli", "fpsboost.ui.command"))
]
"""All modules but those of the command line, whose docstrings are texts of the help."""


def described(module: str) -> Iterator[str]:
    """Yield the names of the functions and classes of a module, and of the public methods."""
    for name, value in vars(importlib.import_module(module)).items():
        if getattr(value, "__module__", None) != module:
            continue
        if inspect.isfunction(value):
            yield f"{module}.{name}"
        elif inspect.isclass(value):
            yield f"{module}.{name}"
            for member, each in vars(value).items():
                is_method = inspect.isfunction(each) and each.__name__ == member  # and no function that is a default
                if not member.startswith("_") and (is_method or isinstance(each, property)):
                    yield f"{module}.{name}.{member}"


def faults_in(name: str) -> list[str]:
    """Return what is wrong with a docstring.

    A short one may have no section about parameters. Parameters may come in groups that another docstring describes;
    those of kernels come in groups anyway, and their types are what numba infers.
    """
    result = validate(name)
    text = result["docstring"] or ""
    checked = ABOUT_FORM | (ABOUT_PARAMETERS if "Parameters\n" in text else set())
    if name.startswith("fpsboost.kernels.") or re.search(r"\n *\w+(, \w+)*\n +(See|As) ", text):
        checked -= {"PR03", "PR04"}
    return [f"{name}: {fault}" for code, fault in result["errors"] if code in checked]


@pytest.mark.parametrize("module", MODULES)
def test_docstrings_agree_with_signatures(module):
    """Every parameter is described, in order and with its type, wherever any is."""
    if module == "fpsboost.integrations.vapoursynth":
        pytest.importorskip("vapoursynth", reason="VapourSynth needs Python 3.12 or newer")
    assert [fault for name in described(module) for fault in faults_in(name)] == []
