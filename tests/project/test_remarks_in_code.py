"""Remarks in the code of the package: their kinds, and that nothing reads their sentences."""

import ast
from pathlib import Path

import pytest

import fpsboost
from fpsboost import media, remarks

PACKAGE = Path(fpsboost.__file__).parent
FILES = sorted(PACKAGE.rglob("*.py"))
OF_TEXTS = {"find", "index", "partition", "removeprefix", "removesuffix", "replace", "rpartition", "search"}
OF_TEXTS |= {"split", "startswith", "endswith", "sub", "match", "fullmatch", "findall"}
"""Functions that look into a text."""


def calls(path: Path) -> list[ast.Call]:
    """All calls in a file."""
    return [node for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))) if isinstance(node, ast.Call)]


@pytest.mark.parametrize("path", FILES, ids=lambda path: path.stem)
def test_kinds_have_a_sentence(path):
    """Each kind that is added is in the table of its room, so that no run ends with a missing one."""
    texts = media.Remarks.texts if path.is_relative_to(PACKAGE / "media") else remarks.Remarks.texts
    added = [
        call.args[0].value
        for call in calls(path)
        if ast.unparse(call.func).endswith(("remarks.add", "_losses.add", "self._remark"))
        and isinstance(call.args[0], ast.Constant)
    ]
    assert [kind for kind in added if kind not in texts] == []


def test_sentences_are_used():
    """No sentence is left of which the kind is nowhere added."""
    written = {
        node.value.removesuffix("-once")
        for path in FILES
        if path.stem != "remarks"
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8")))
        if isinstance(node, ast.Constant) and isinstance(node.value, str)
    }
    of_damage = Path(media.remarks.__file__).read_text(encoding="utf-8").partition("class Damage")[2]
    kinds = {kind.removesuffix("-once") for kind in remarks.Remarks.texts}
    assert {kind for kind in kinds - written if f'"{kind}"' not in of_damage} == set()


@pytest.mark.parametrize("path", FILES, ids=lambda path: path.stem)
def test_nothing_reads_sentences(path):
    """No code looks for words in a remark: it goes by kind and values."""
    looked_into = [
        ast.unparse(call)
        for call in calls(path)
        if isinstance(call.func, ast.Attribute)
        and call.func.attr in OF_TEXTS
        and any("remark" in ast.unparse(each) for each in [call.func.value, *call.args])
        and "remarks" not in Path(path).stem
    ]
    assert looked_into == []
