"""Flags of all options by the names of their fields: in messages, in signatures of commands, and in the help."""

from __future__ import annotations

import inspect
import re
from collections.abc import Callable
from dataclasses import is_dataclass
from pathlib import Path
from typing import Annotated, Any, Literal, get_args, get_origin, get_type_hints

from cyclopts import Group, Parameter

from fpsboost.cli.options import METHOD_HELP, CutOptions, PathName, option_classes
from fpsboost.io.video.decode_options import DecodeOptions
from fpsboost.options import Flag, flags_of, options_from

QUOTES = "'\""

flag_names = {flag.field: flag.name for cls in option_classes for flag in flags_of(cls)}
"""Names of flags by the names of their fields."""


def in_flags(sentence: str) -> str:
    """Return a message of the library with flags for the fields that it names: ``--crf 20`` for ```crf=20```."""

    def flag(found: re.Match[str]) -> str:
        field, value = found.groups()
        if field not in flag_names:
            return found[0]
        return flag_names[field] if value in (None, "True", "False") else f"{flag_names[field]} {value.strip(QUOTES)}"

    return re.sub(r"`([a-z]\w*)(?:=([^`]*))?`", flag, sentence)


MAIN = "Main options"

OTHER_GROUPS = ("Rate", "Method", "Encoding", "Input", "Scenes", "Streams", "Side outputs", "Run", "Method options")

GROUPS = {
    name: Group(name, METHOD_HELP if name == "Method" else "", sort_key=place)
    for place, name in enumerate((MAIN, *OTHER_GROUPS), start=1)
}
"""Groups of options in the help of a conversion."""

MAIN_OPTIONS = ("--factor", "--fps", "--slow-motion", "--speed", "--method", "--codec", "--crf", "--in-place")
"""Options that come first in the help of a conversion, and alone in the short one: those that README explains."""

OWN_OPTIONS = Group("Options", sort_key=1)
"""Group of a command's options, if it has a single one."""

OwnFlag = Annotated[bool, Parameter(group=OWN_OPTIONS)]
Input = Annotated[PathName, Parameter(name="IN")]
"""Argument of a command that is a clip."""
Reading = Annotated[DecodeOptions, GROUPS["Input"]]
Cuts = Annotated[CutOptions, GROUPS["Scenes"]]
Further = Annotated[PathName, Parameter(show=False)]
"""Argument that may be repeated, which the usage shows."""

_metavars = {
    "Literal": "HOW",
    "Fraction": "RATE",
    "Position": "TIME",
    "MemoryLimit": "SIZE",
    "str": "NAME",
    "float": "X",
    "int": "N",
}
"""Placeholders of values by the name of the type; in a union the first of these counts."""


def default_text(value: Any) -> str | None:
    """Return a default as the help shows it; None for a switch, or if there is no default."""
    if isinstance(value, tuple):
        return ",".join(value) or None
    return None if value is None or value is False else str(value)


def with_flags(command: Callable[..., None]) -> Callable[..., None]:
    """Replace each parameter of a command whose type is a dataclass of options by flags for its fields.

    The result has the signature that the parser reads, and calls the command with objects of these classes. Options
    that contradict each other raise `OptionError` when the objects are made.

    Parameters
    ----------
    command : Callable
        Function whose parameters are all annotated: those of options with the group in the help, like
        ``Annotated[Encoding, group]``.

    Returns
    -------
    Callable
        Function with the command's other parameters, and one for each flag.
    """
    hints = get_type_hints(command, include_extras=True)
    signature = inspect.signature(command)
    parameters = list[inspect.Parameter]()
    classes = dict[str, type]()
    for name, parameter in signature.parameters.items():
        kind, group = get_args(hints[name])
        if is_dataclass(kind):
            classes[name] = kind  # type: ignore[assignment]
            parameters += [parameter_of(flag, group) for flag in flags_of(classes[name])]
        else:
            parameters.append(parameter.replace(annotation=hints[name]))

    def run(*arguments: Any, **values: Any) -> None:
        options = {name: options_from(cls, values) for name, cls in classes.items()}
        own = hints.keys() - classes.keys()
        command(*arguments, **options, **{name: value for name, value in values.items() if name in own})

    run.__doc__ = command.__doc__
    run.__module__ = command.__module__
    run.__signature__ = signature.replace(parameters=parameters)  # type: ignore[attr-defined]
    run.__annotations__ = {parameter.name: parameter.annotation for parameter in parameters}
    return run


def parameter_of(flag: Flag, group: Group) -> inspect.Parameter:
    """Return the parameter of a command for a flag, in the option's own group of the help or else in `group`.

    Values that the library parses are taken as texts; types of paths and choices let a shell complete them.
    """
    kind = flag.kind
    default = flag.default
    metavar = flag.option.metavar
    is_text = flag.option.parse is not None  # whose parser says what is wrong with one such as -1s
    if "PathLike" in str(kind):
        kind = str | None
    if isinstance(default, bool):
        kind = bool
        default = False
    else:
        metavar = metavar or next(_metavars[each] for each in _metavars if each in str(kind))
        if is_text:
            kind = tuple[str, ...] if isinstance(default, tuple) else str
            default = None
            kind |= None
        if metavar in ("DIR", "FILE", "IN"):  # names of files and folders
            kind |= Path
        if flag.option.choices:
            proposed: Any = Literal[flag.option.choices] | str  # parsed like a text, with choices for a shell
            kind = tuple[proposed, ...] if get_origin(kind) is tuple else proposed | kind
    group = GROUPS[flag.option.group] if flag.option.group else group
    if group in GROUPS.values() and flag.name in MAIN_OPTIONS:
        group = GROUPS[MAIN]
    names = [flag.name, f"-{flag.option.short}"] if flag.option.short else flag.name
    more = Parameter(
        name=names, help=in_flags(flag.option.help), group=group, metavar=metavar or None, allow_leading_hyphen=is_text
    )
    return inspect.Parameter(
        flag.field, inspect.Parameter.KEYWORD_ONLY, default=default, annotation=Annotated[kind, more]
    )
