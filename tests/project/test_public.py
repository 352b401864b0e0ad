"""What Semantic Versioning covers, the names of ``fpsboost.__all__``; and what the documentation names is there."""

from __future__ import annotations

import inspect
import re
import typing
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

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
    function = value.__init__ if isinstance(value, type) else value
    for annotation in typing.get_type_hints(function).values():
        for each in classes_in(annotation):
            assert getattr(fpsboost, each.__name__, None) is each, f"{name} takes or returns {each.__name__}"


@pytest.mark.parametrize("name", ["convert", "stream", "interpolate", "run_conversion"])
def test_public_functions_have_few_parameters(name):
    """At most eight; options come in groups."""
    assert len(inspect.signature(getattr(fpsboost, name)).parameters) <= 8


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
