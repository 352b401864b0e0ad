"""Options as fields of frozen dataclasses: declared once, for Python and for a command line with flags for them.

A field's name, type and default are those of the dataclass; `option` adds what a command line needs beside them.
Messages of the library name a field between backquotes, with a value after ``=`` where one is meant: "give `fps=60`". A
program that has other names for the fields replaces them.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field, fields, is_dataclass
from typing import Any, get_type_hints


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


def option(default: Any, help: str, **properties: Any) -> Any:
    """Return a dataclass field with a default that is also an `Option`, which has these properties."""
    return field(default=default, metadata={"option": Option(help, **properties)})


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
    for each in fields(cls):
        if "option" in each.metadata:
            yield Flag(each.name, kinds[each.name], each.default, each.metadata["option"])
        elif is_dataclass(each.default):
            yield from flags_of(type(each.default))


def options_from(cls: type, given: Mapping[str, Any]) -> Any:
    """Build an object of options, and those nested in it, from texts and switches by the names of fields.

    Others are left out. Raises `OptionError` where a text cannot be read.
    """
    own = {each.name for each in fields(cls)} & given.keys()
    values = {flag.field: flag.value(given[flag.field]) for flag in flags_of(cls) if flag.field in own}
    nested = {each.name: type(each.default) for each in fields(cls) if is_dataclass(each.default)}
    return cls(**values, **{name: options_from(kind, given) for name, kind in nested.items()})


def words_of(options: Mapping[str, object]) -> tuple[str, ...]:
    """Return the given options as words of the command line; True stands for an option without a value."""
    given = {option: value for option, value in options.items() if value is not None and value is not False}
    return tuple(
        word for option, value in given.items() for word in ((option,) if value is True else (option, str(value)))
    )


def words_of_options(*options: Any) -> list[str]:
    """Return what differs from the defaults in objects of options, as words of the command line."""
    return [word for each in options for word in words_of(dict(given_in(each)))]


def given_in(options: Any) -> Iterator[tuple[str, object]]:
    """Yield the options that differ from their defaults, by their flags, with values as they are written."""
    names = {flag.field: flag.name for flag in flags_of(type(options))}
    for each in fields(options):
        value = getattr(options, each.name)
        if is_dataclass(each.default):
            yield from given_in(value)
        elif each.name in names and value != each.default:
            if isinstance(value, tuple):
                value = ",".join(map(str, value))
            is_switch = isinstance(value, bool)  # also where it drops something: --no-audio
            yield names[each.name], is_switch or (value.as_option() if hasattr(value, "as_option") else value)
