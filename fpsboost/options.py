"""Options as fields of frozen dataclasses: declared once, for Python and for a command line.

A field's name, type and default are those of the dataclass; `option` adds what a command line needs beside them.
Messages of the library name a field between backquotes, with a value after ``=`` where one is meant: "give `fps=60`". A
program that has other names for the fields replaces them.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any


@dataclass(frozen=True)
class Option:
    """Properties of an option on a command line."""

    help: str
    """A phrase with its unit, and its default unless that is shown."""
    flag: str = ""
    """Name without dashes; by default the field's own. A flag ``no-...`` turns off a field that is True by default."""
    short: str = ""
    """One letter, or empty."""
    metavar: str = ""
    """Placeholder of the value in the help; by default one for the type."""
    group: str = ""
    """Name of a group other than that of the dataclass."""
    choices: tuple[str, ...] = ()
    """Values that a shell proposes; others may be given, too. Those of a ``Literal`` need not be repeated here."""
    parse: Callable[[Any, str], Any] | None = None
    """Reads the value from its text, or its texts if it is repeatable, and its name; by default the type does."""


def option(
    default: Any,
    help: str,
    *,
    flag: str = "",
    short: str = "",
    metavar: str = "",
    group: str = "",
    choices: tuple[str, ...] = (),
    parse: Callable[[Any, str], Any] | None = None,
) -> Any:
    """Return a dataclass field with a default that is also an `Option`; see there for the parameters.

    Examples
    --------
    >>> from dataclasses import dataclass, fields
    >>> @dataclass(frozen=True)
    ... class Quality:
    ...     crf: int = option(18, "Constant rate factor; lower is better.")
    >>> Quality(), fields(Quality)[0].metadata["option"].help
    (Quality(crf=18), 'Constant rate factor; lower is better.')
    """
    return field(default=default, metadata={"option": Option(help, flag, short, metavar, group, choices, parse)})
