"""Templates of pages that have their style sheets and scripts in themselves."""

from __future__ import annotations

from jinja2 import ChoiceLoader, Environment, PackageLoader, StrictUndefined
from markupsafe import Markup


def templates_of(*packages: str) -> Environment:
    """Return the templates of packages, in which ``text_of(file)`` is a style sheet or a script as it is."""
    loader = ChoiceLoader([PackageLoader(package) for package in packages])
    environment = Environment(
        loader=loader, autoescape=True, undefined=StrictUndefined, trim_blocks=True, lstrip_blocks=True
    )
    environment.globals["text_of"] = lambda file: Markup(loader.get_source(environment, file)[0])
    return environment
