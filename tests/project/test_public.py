"""Public names: Semantic Versioning covers them, documentation finds them, docstrings agree with signatures."""

import ast
import importlib
import inspect
import pkgutil
import re
import typing
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from numpydoc.validate import validate

import fpsboost


def classes_in(annotation: Any) -> Iterator[type]:
    """Yield the classes of the package that an annotation names."""
    for argument in typing.get_args(annotation):
        yield from classes_in(argument)
    origin = typing.get_origin(annotation) or annotation
    if isinstance(origin, type) and origin.__module__.split(".")[0] == "fpsboost":
        yield origin


@pytest.mark.parametrize("name", fpsboost.__all__)
def test_what_a_public_name_takes_and_returns_is_public(name):
    """Every class that a public function or constructor takes or returns."""
    value = getattr(fpsboost, name)
    if not callable(value):
        return
    for annotation in typing.get_type_hints(value.__init__ if isinstance(value, type) else value).values():
        for each in classes_in(annotation):
            assert getattr(fpsboost, each.__name__, None) is each, f"{name} takes or returns {each.__name__}"


def test_names_for_extensions_come_from_below():
    """None is of the command line, or of what is built upon these names."""
    stub = Path(fpsboost.__file__).with_name("extension.pyi").read_text(encoding="utf-8")
    assert not re.search(r"^from \.(cli|integrations|preview|rerender|ui)\b", stub, re.MULTILINE)


def test_names_for_extensions_are_those_that_they_use():
    """No name is listed that nothing imports, or that is public anyway."""
    folder = Path(fpsboost.__file__).parent
    files = {path: ast.parse(path.read_text(encoding="utf-8")) for path in folder.rglob("*.py")}
    imports = [node for tree in files.values() for node in ast.walk(tree) if isinstance(node, ast.ImportFrom)]
    used = {alias.name for node in imports if node.module == "fpsboost.extension" for alias in node.names}
    listed = set(re.findall(r" as (\w+)$", (folder / "extension.pyi").read_text(encoding="utf-8"), re.MULTILINE))
    assert listed == used
    assert not listed & set(fpsboost.__all__)


@pytest.mark.parametrize("name", ["convert", "stream", "interpolate", "run_conversion"])
def test_public_functions_have_few_parameters(name):
    """At most nine; options come in groups."""
    assert len(inspect.signature(getattr(fpsboost, name)).parameters) <= 9


def test_unknown_names_do_not_resolve():
    """A misspelled name is an AttributeError that says it."""
    with pytest.raises(AttributeError, match="intrepolate"):
        _ = fpsboost.intrepolate


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


ABOUT_PARAMETERS = {"PR01", "PR02", "PR03", "PR04", "PR05", "PR06", "PR08", "PR10"}
"""Parameters that are missing, unknown, in another order, without a type, or badly written."""

ABOUT_FORM = {"GL01", "GL02", "GL05", "GL06", "GL07", "GL10", "SS02", "SS03"}
"""Sections that are unknown, empty or out of order, and summaries that are no sentences."""

MODULES = [
    module.name
    for module in pkgutil.walk_packages(fpsboost.__path__, "fpsboost.")
    if not module.name.endswith(("__main__", "native.kernels"))  # the latter is no module, but a library
    and not module.name.startswith(("fpsboost.cli", "fpsboost.ui.command"))
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
    those of kernels come in groups anyway.
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
