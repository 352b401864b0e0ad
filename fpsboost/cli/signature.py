"""Signatures of commands, with dataclasses of options replaced by flags."""

from __future__ import annotations

import inspect
from collections.abc import Callable
from dataclasses import is_dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal, get_args, get_origin, get_type_hints

from cyclopts import Group, Parameter

from fpsboost.cli.options import in_flags
from fpsboost.options import Flag, flags_of, options_from

if TYPE_CHECKING:
    PathName = str
else:
    PathName = str | Path
"""A text that a shell completes to a file: the parser tries the types in order, and a text it always is."""

PATH_METAVARS = ("DIR", "FILE", "IN")
"""Placeholders of options that are names of files and folders."""

GROUPS = {
    name: Group(name, sort_key=place)
    for place, name in enumerate(
        ["Input", "Rate", "Method", "Scenes", "Encoding", "Streams", "Side outputs", "Run", "Method options"], start=1
    )
}
"""Groups of options in the help of a conversion."""

_metavars = {
    **{"Literal": "HOW", "Fraction": "RATE", "Position": "TIME", "MemoryLimit": "SIZE"},
    **{"str": "NAME", "float": "X", "int": "N"},
}
"""Placeholders of values by the name of the type; in a union the first of these counts."""


def default_text(value: Any) -> str | None:
    """Return a default as the help shows it; None for a switch, or where there is none."""
    if isinstance(value, tuple):
        return ",".join(value) or None
    return None if value is None or value is False else str(value)


def with_flags(command: Callable[..., None]) -> Callable[..., None]:
    """Replace each parameter of a command whose type is a dataclass of options by flags for its fields.

    The command is called with objects of these classes. A parameter's type is ``Annotated[Encoding, group]``.
    """
    hints, signature = get_type_hints(command, include_extras=True), inspect.signature(command)
    parameters, classes = list[inspect.Parameter](), dict[str, type]()
    for name, parameter in signature.parameters.items():
        cls, *more = get_args(hints[name]) if get_origin(hints[name]) is Annotated else [hints[name]]
        if is_dataclass(cls):
            group = next((candidate for candidate in more if isinstance(candidate, Group)), None)
            classes[name] = cls  # type: ignore[assignment]
            parameters += [parameter_of(flag, group) for flag in flags_of(classes[name])]
        else:
            parameters.append(parameter.replace(annotation=hints[name]))

    def run(*arguments: Any, **values: Any) -> None:
        options = {name: options_from(cls, values) for name, cls in classes.items()}
        own = hints.keys() - classes.keys()
        command(*arguments, **options, **{name: value for name, value in values.items() if name in own})

    run.__doc__, run.__module__ = command.__doc__, command.__module__
    run.__signature__ = signature.replace(parameters=parameters)  # type: ignore[attr-defined]
    run.__annotations__ = {parameter.name: parameter.annotation for parameter in parameters}
    return run


def parameter_of(flag: Flag, group: Group | None) -> inspect.Parameter:
    """Return the parameter of a command that takes a flag's value, or its text if the library parses it."""
    kind, default, metavar = flag.kind, flag.default, flag.option.metavar
    if isinstance(default, bool):
        kind, default = bool, False
    else:
        metavar = metavar or next(_metavars[each] for each in _metavars if each in str(kind))
        if flag.option.parse is not None:
            kind, default = tuple[str, ...] if isinstance(default, tuple) else str, None
            kind |= None
        if metavar in PATH_METAVARS:
            kind |= Path
        if flag.option.choices:
            proposed: Any = Literal[flag.option.choices] | str  # parsed like a text, with choices for a shell
            kind = tuple[proposed, ...] if get_origin(kind) is tuple else proposed
    more = Parameter(
        name=[flag.name, f"-{flag.option.short}"] if flag.option.short else flag.name,
        help=in_flags(flag.option.help),
        group=GROUPS[flag.option.group] if flag.option.group else group,
        metavar=metavar or None,
    )
    return inspect.Parameter(
        flag.field, inspect.Parameter.KEYWORD_ONLY, default=default, annotation=Annotated[kind, more]
    )
