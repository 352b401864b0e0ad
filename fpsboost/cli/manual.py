"""Command ``fpsboost man``: prints a manual page in roff, made of what the help of all commands says."""

from __future__ import annotations

from collections.abc import Iterator

from cyclopts import App, Group
from cyclopts.argument import Argument
from rich.text import Text

from fpsboost.cli.signature import default_text
from fpsboost.version import __version__


def man() -> None:
    """Print the manual page."""
    from fpsboost.cli.app import EXAMPLES, EXIT_CODES, app  # noqa: PLC0415 (which imports this module)

    print(manual_page(app, EXAMPLES, EXIT_CODES))


def manual_page(app: App, examples: str, exit_codes: str) -> str:
    """Return the manual page of a command line in roff.

    Parameters
    ----------
    app : App
    examples : str
        Lines in Rich's markup, the first of them a title.
    exit_codes : str
        Phrases with commas between them, each of a code and what it means.
    """
    name, title = app.name[0], _plain(app.help).rstrip(".")
    lines = [
        f'.TH {name.upper()} 1 "" "{name} {__version__}" "User Commands"',
        *(".ad l", ".nh"),
        *(".SH NAME", f"{name} \\- {_escaped(title[0].lower() + title[1:])}"),
        *(".SH SYNOPSIS", ".nf", *(_escaped(line.strip()) for line in _usage(app)), ".fi"),
    ]
    for group, arguments in _by_group(app):
        lines += [f'.SH "{group.upper()}"', *(line for each in arguments for line in _entry(each))]
    lines.append(".SH COMMANDS")
    for command in (app[each] for each in app if not each.startswith("-")):
        lines += [f'.SS "{name} {_escaped(command.name[0])}"', _escaped(_plain(command.help))]
        lines += [line for _, arguments in _by_group(command) for each in arguments for line in _entry(each)]
    lines += [".SH EXAMPLES", ".nf", *map(_escaped, _plain(examples).strip().splitlines()[1:]), ".fi"]
    lines.append('.SH "EXIT STATUS"')
    for code, _, meaning in (each.partition(" ") for each in exit_codes.split(", ")):
        lines += [".TP", f".B {code}", _escaped(meaning)]
    return "\n".join(lines)


def _usage(app: App) -> list[str]:
    return _plain(app.usage or "").removeprefix("Usage: ").splitlines()


def _by_group(app: App) -> Iterator[tuple[str, list[Argument]]]:
    """Yield the shown arguments and options of a command by the names of their groups, arguments first."""
    groups: dict[str, list[Argument]] = {}
    places: dict[str, int] = {}
    for argument in app.assemble_argument_collection(parse_docstring=True):
        if not argument.show:
            continue
        group = _group_of(argument)
        groups.setdefault(group.name, []).append(argument)
        places[group.name] = group.sort_key if isinstance(group.sort_key, int) else 0
    for name in sorted(groups, key=places.__getitem__):
        yield name, groups[name]


def _group_of(argument: Argument) -> Group:
    """Return the group of an argument, which every one has once it is assembled."""
    groups = argument.parameter.group
    assert isinstance(groups, tuple)
    return next(each for each in groups if isinstance(each, Group))


def _entry(argument: Argument) -> list[str]:
    """Return an argument or option, its value, and what it does."""
    field = argument.field_info
    default = None if field.default is field.empty else default_text(field.default)
    names = ", ".join(rf"\fB{_escaped(name)}\fR" for name in argument.names if name not in argument.negatives)
    value = rf" \fI{_escaped(argument.parameter.metavar)}\fR" if argument.parameter.metavar else ""
    text = _plain(argument.parameter.help or "") + (f" [default: {default}]" if default else "")
    return [".TP", names + value, *map(_escaped, text.splitlines())]


def _plain(text: str) -> str:
    """Return a text without Rich's markup."""
    return Text.from_markup(text).plain


def _escaped(text: str) -> str:
    """Return one line as roff prints it literally, hyphens as those of options that can be copied."""
    escaped = text.replace("\\", r"\e").replace("-", r"\-").replace("'", r"\(aq").replace("`", r"\(ga")
    escaped = escaped.replace("^", r"\(ha").replace("~", r"\(ti")
    return rf"\&{escaped}" if escaped.startswith(".") else escaped
