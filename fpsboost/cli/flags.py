"""Flags of the command line: the option fields of dataclasses."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, fields, is_dataclass
from typing import Any, get_type_hints

from fpsboost.options import Option


@dataclass(frozen=True)
class Flag:
    """Flag for a field of a dataclass.

    Attributes
    ----------
    field : str
        Name of the field.
    kind : type
        Type of the field.
    default : object
        Default of the field.
    option : Option
        What the field declares for a command line.
    """

    field: str
    kind: Any
    default: Any
    option: Option

    @property
    def name(self) -> str:
        """Name on the command line, with dashes."""
        return "--" + (self.option.flag or self.field.replace("_", "-"))

    def value(self, given: Any) -> Any:
        """Return the field's value for what was given on the command line."""
        if isinstance(self.default, bool):
            return self.default ^ given
        if self.option.parse is None or given is None:
            return self.default if given is None else given
        return self.option.parse(given, f"`{self.field}`")


def flags_of(cls: type) -> Iterator[Flag]:
    """Yield the flags of a dataclass of options, those of nested dataclasses in their place."""
    kinds = get_type_hints(cls)
    for field in fields(cls):
        if "option" in field.metadata:
            yield Flag(field.name, kinds[field.name], field.default, field.metadata["option"])
        elif is_dataclass(field.default):
            yield from flags_of(type(field.default))
