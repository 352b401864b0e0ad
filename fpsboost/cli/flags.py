"""Flags of the command line: the option fields of dataclasses."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, fields, is_dataclass
from typing import Any, get_type_hints

from fpsboost.options import Option


@dataclass(frozen=True)
class Flag:
    """Flag for a field of a dataclass, with the field's name, type and default, and its `Option`."""

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


def words_of(options: Mapping[str, object]) -> tuple[str, ...]:
    """Return the given options as words of the command line; True stands for an option without a value."""
    given = {option: value for option, value in options.items() if value is not None and value is not False}
    return tuple(
        word for option, value in given.items() for word in ((option,) if value is True else (option, str(value)))
    )


def words_of_options(*options: Any) -> list[str]:
    """Return what differs from the defaults in objects of options, as words of the command line."""
    return [word for each in options for word in words_of(dict(_given(each)))]


def _given(options: Any) -> Iterator[tuple[str, object]]:
    """Yield the options that differ from their defaults, by their flags, with values as they are written."""
    names = {flag.field: flag.name for flag in flags_of(type(options))}
    for field in fields(options):
        value = getattr(options, field.name)
        if is_dataclass(field.default):
            yield from _given(value)
        elif field.name in names and value != field.default:
            yield names[field.name], value.as_option() if hasattr(value, "as_option") else value
