"""The import contracts, with imports that `lint-imports` does not see: of names that a package imports on first use."""

import ast
import tomllib
from collections.abc import Iterator
from pathlib import Path

import grimp
import pytest

ROOT = Path(__file__).parents[2]
SETTINGS = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
CONTRACTS = SETTINGS["tool"]["importlinter"]["contracts"]


STUBS = {path.stem.replace("__init__", path.parent.name): path for path in ROOT.glob("fpsboost/**/*.pyi")}
"""Files that list what a package or module imports when it is asked for, by the last part of the module's name."""


def module_of(path: Path) -> str:
    """The name of a module of the package, by its file."""
    return ".".join(part for part in path.relative_to(ROOT).with_suffix("").parts if part != "__init__")


def names_used(path: Path) -> Iterator[tuple[str, str]]:
    """Each name that a file takes from another module, with that module's name: imported, or as an attribute of it."""
    folder = path.relative_to(ROOT).parts[:-1]
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.ImportFrom):
            above = folder[: len(folder) + 1 - node.level] if node.level else ()
            yield from ((".".join([*above, *filter(None, [node.module])]), alias.name) for alias in node.names)
        elif isinstance(node, ast.Attribute) and isinstance(node.value, ast.Name) and node.value.id in STUBS:
            yield module_of(STUBS[node.value.id]), node.attr


@pytest.fixture(scope="module")
def graph() -> grimp.ImportGraph:
    """All imports, and for each name that a stub lists an import of the module that defines it."""
    graph = grimp.build_graph("fpsboost", include_external_packages=True, cache_dir=None)
    defined_in = {(module_of(stub), name): module for stub in STUBS.values() for module, name in names_used(stub)}
    for path in ROOT.glob("fpsboost/**/*.py"):
        for used in names_used(path):
            if used in defined_in:
                name = f"{defined_in[used]}.{used[1]}"  # of a module, or of a class or function in one
                imported = name if name in graph.modules else defined_in[used]
                graph.add_import(importer=module_of(path), imported=imported)
    return graph


def test_stubs_are_resolved(graph):
    """The names that the command line imports from `fpsboost` lead to where they are defined."""
    assert graph.direct_import_exists(importer="fpsboost.cli.plan", imported="fpsboost.rerender.planning")


def test_imports_go_downwards(graph):
    """No layer imports one that stands above it or beside it, directly or by way of others."""
    (contract,) = (each for each in CONTRACTS if each["type"] == "layers")
    layers = [grimp.Layer(*map(str.strip, line.split("|"))) for line in contract["layers"]]
    assert graph.find_illegal_dependencies_for_layers(layers=layers) == set()


def test_the_method_reaches_no_reader_of_files(graph):
    """Nor by way of others: the modules of the method lead to none of the libraries that read and write files."""
    (contract,) = (each for each in CONTRACTS if each["name"] == "The method needs numpy and OpenCV alone")
    for module in contract["source_modules"]:
        for library in contract["forbidden_modules"]:
            assert graph.find_shortest_chains(importer=module, imported=library, as_packages=True) == set()
