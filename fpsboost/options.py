"""Options as fields of frozen dataclasses: declared once, for Python and for a command line with flags for them.

Values are checked where they come in, against the types that the fields and the parameters of public functions declare.

A field's name, type and default are those of the dataclass; `option` adds what a command line needs beside them.
Messages of the library name a field between backquotes, with a value after ``=`` where one is meant: "give `fps=60`". A
program that has other names for the fields replaces them.
"""

import math
import os
import reprlib
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence, Set
from dataclasses import Field, dataclass, field, fields, is_dataclass, replace
from fractions import Fraction
from functools import lru_cache, partial, wraps
from inspect import signature
from numbers import Integral, Number, Rational, Real
from pathlib import Path
from textwrap import shorten
from types import NoneType, UnionType
from typing import Annotated, Any, Literal, NamedTuple, ParamSpec, TypeVar, Union, get_args, get_origin, get_type_hints

from fpsboost.conflicts import check_together
from fpsboost.errors import OptionError

Parameters = ParamSpec("Parameters")
Result = TypeVar("Result")

Rate = Fraction | int | float | str
"""Frame rate, or another number that must be exact: 60, 59.94 (which is 60000/1001), ``"60000/1001"``, a Fraction."""

PathName = str | os.PathLike[str]
"""Name of a file or folder, as text or as a ``pathlib.Path``."""

AtCuts = Literal["repeat", "blend", "extrapolate"]
"""Across a cut: repeat the nearer frame, mix the two, or extrapolate the motion of each."""
Duplicates = Literal["interpolate", "keep"]
"""Treatment of repeated frames: grouped and interpolated again, or kept as frames of their own."""
AnyDuplicates = Literal["interpolate", "keep", "drop"]
"""The same of a conversion, which can also leave them out, so that the clip has the rate of its pictures."""
Pattern = Literal["full", "three-step", "diamond"]
"""Search pattern of block matching: every offset of the range, or one of two fast searches from the best so far."""
Uncertain = Literal["keep", "blend", "nearest", "hold"]
"""Fallback for uncertain pixels: none (keep), the mix of both frames, the nearer frame, or the nearer frame for a whole
image of which too much is uncertain (hold)."""
MaskAs = Literal["keep", "layer"]
"""Use of a mask: what it shows is kept as in the nearer frame, or is interpolated apart from what is behind it."""
LEAST_CONFIDENCE = 0.4
"""Confidence below which motion is unsure, unless another limit is given."""


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

    def flag_of(self, field: str) -> str:
        """Return the flag, with dashes, of the option that is a field of this name."""
        return "--" + (self.flag or field.replace("_", "-"))


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
        return self.option.flag_of(self.field)

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
    values = {flag.field: flag.value(given[flag.field]) for flag in flags_of(cls) if flag.field in given}
    return with_options(cls(), values, cls.__name__)


def words_of_options(*options: Any) -> list[str]:
    """Return what differs from the defaults in objects of options, as words of the command line."""
    words = list[str]()
    for each in options:
        for flag, value in given_in(each):
            words += [flag] if value is True else [flag, str(value)]
    return words


def given_in(options: Any) -> Iterator[tuple[str, object]]:
    """Yield the options that differ from their defaults, by their flags, with values as they are written."""
    for each, value in given_fields(options):
        text = ",".join(map(str, value)) if isinstance(value, tuple) else value
        is_switch = isinstance(value, bool)  # also where it drops something: --no-audio
        flag = each.metadata["option"].flag_of(each.name)
        yield flag, is_switch or (value.as_option() if hasattr(value, "as_option") else text)


def given_fields(options: Any) -> Iterator[tuple[Field[Any], Any]]:
    """Yield the fields of options that differ from their defaults, those of nested ones in their place, with values."""
    for each in fields(options):
        value = getattr(options, each.name)
        if isinstance(value, Checked) and "option" not in each.metadata:
            yield from given_fields(value)
        elif "option" in each.metadata and value != each.default:
            yield each, value


def with_options(options: Any, given: dict[str, Any], group: str) -> Any:
    """Return an object of options with others by the names of their fields, nested ones too; see `Checked`.

    They are taken out of `given`. Raises `OptionError` where one is given in the object too, which messages call
    `group`.
    """
    values = dict[str, Any]()
    for each in fields(options):
        value = getattr(options, each.name)
        if each.name in given:
            if value != each.default:
                raise OptionError(f"`{each.name}` is given twice, on its own and in `{group}`; give one of them.")
            value = values[each.name] = given.pop(each.name)
        if is_dataclass(each.default) and is_dataclass(value):
            values[each.name] = with_options(value, given, group)
    return replace(options, **values)


def names_in(options: Any) -> Iterator[str]:
    """Yield the names of the fields of an object of options, and of those nested in it."""
    for each in fields(options):
        yield each.name
        if is_dataclass(each.default):
            yield from names_in(each.default)


def one_of(choices: Any) -> str:
    """Return the values of a ``Literal`` as a phrase.

    Examples
    --------
    >>> one_of(Uncertain)
    'keep, blend, nearest or hold'
    """
    *first, last = get_args(choices)
    return f"{', '.join(first)} or {last}"


class Checked:
    """Base of dataclasses whose values are checked against the types of their fields, with `Range` where they have one.

    All options of the package derive from it; it serves those of your own methods as well. Rates become fractions,
    paths texts, and lists, sets and arrays tuples. Texts are read as on the command line, and so are numbers for fields
    of another type: ``start=90`` is a position. A dataclass with a ``__post_init__`` of its own calls this one first.

    Raises
    ------
    OptionError
        A value has another type or lies outside of its range, or two options cannot be combined.

    Examples
    --------
    >>> @dataclass(frozen=True)
    ... class Smoothing(Checked):
    ...     radius: Annotated[float, Range(above=0, unit=" pixels")] = 1.0
    >>> Smoothing(radius=0)
    Traceback (most recent call last):
    fpsboost.media.errors.OptionError: `radius` must be above 0 pixels, not 0.
    """

    def __post_init__(self) -> None:
        for each in fields(self):  # type: ignore[arg-type]
            given = getattr(self, each.name)
            hint = hints_of(type(self))[each.name]
            value = os.fspath(given) if isinstance(given, os.PathLike) else given
            parse = each.metadata["option"].parse if "option" in each.metadata else None
            is_exact = isinstance(value, Fraction) if _is_rate(hint) else _is_of(value, hint)
            if parse and (isinstance(value, str) or (isinstance(value, Number) and not is_exact)):
                value = parse(str(float(value) if isinstance(value, Fraction) else value), f"`{each.name}`")
            elif isinstance(value, float) and _is_rate(hint) and math.isfinite(value):
                value = Fraction(str(value))  # as it is written: 0.1 is a tenth
            elif isinstance(value, list | range | Set) or getattr(value, "ndim", 0) == 1:
                value = tuple(value)
            check_type(each.name, value, hint)
            object.__setattr__(self, each.name, value)
        check_together(self.names_given())

    def names_given(self) -> set[str]:
        """Return the names of the options that differ from their defaults, and of those nested in this object.

        Texts and switches are named with their values, too: ``audio=False``. See `fpsboost.conflicts`.
        """
        return {name for each, value in given_fields(self) for name in (each.name, f"{each.name}={value!r}")}


class Range(NamedTuple):
    """Range of the numbers of a field of a `Checked` dataclass, in ``Annotated[float, Range(0, 1)]``.

    Examples
    --------
    >>> Range(0, 1).holds(1), Range(0, below=1).holds(1)
    (True, False)
    """

    least: float | Fraction = -math.inf
    """Lowest number."""
    most: float = math.inf
    """Highest number."""
    above: float = -math.inf
    """Limit that numbers must exceed; it is outside of the range."""
    below: float = math.inf
    """Limit that numbers must not reach; it is outside of the range."""
    unit: str = ""
    """Unit in messages, with a space before it: `` pixels``."""

    def holds(self, value: float) -> bool:
        """Return whether a number lies in the range; NaN does not."""
        return self.least <= value <= self.most and self.above < value < self.below

    def __str__(self) -> str:
        bounds = {"at least": self.least, "above": self.above, "at most": self.most, "below": self.below}
        words = [f"{word} {float(bound):.15g}" for word, bound in bounds.items() if math.isfinite(bound)]
        is_closed = math.isfinite(self.most - self.least)
        return (f"{float(self.least):.15g} to {self.most:.15g}" if is_closed else " and ".join(words)) + self.unit


PositiveInt = Annotated[int, Range(1)]
PositiveFloat = Annotated[float, Range(above=0)]


def checked(function: Callable[Parameters, Result]) -> Callable[Parameters, Result]:
    """Decorate a public function: arguments of other types than its hints raise `OptionError` before it is called."""
    names = list(signature(function).parameters)

    @wraps(function)
    def call(*arguments: Parameters.args, **options: Parameters.kwargs) -> Result:
        hints = hints_of(function)
        for name, value in [*zip(names, arguments, strict=False), *options.items()]:
            check_type(name, value, hints.get(name, Any) if name in names else Any)
        return function(*arguments, **options)

    return call


hints_of: Callable[[Any], dict[str, Any]] = lru_cache(maxsize=None)(partial(get_type_hints, include_extras=True))
"""Types of a class's fields, or of a function's parameters, by name."""


def check_type(name: str, value: Any, hint: Any) -> None:
    """Raise `OptionError`, which calls a value by its name, unless the value is of the type of a hint."""
    if not _is_of(value, hint):
        given = str(value) if isinstance(value, Fraction) else shorten(reprlib.repr(value), 60)
        raise OptionError(f"`{name}` must be {_described(hint, value)}, not {given}.")


def _members(hint: Any) -> tuple[Any, ...]:
    """Return the types of a union, or a type by itself."""
    return get_args(hint) if get_origin(hint) in (Union, UnionType) else (hint,)


def _is_rate(hint: Any) -> bool:
    """Return whether a hint is `Rate`, perhaps with a range, or None."""
    return any(Fraction in (kind, *_members(get_args(kind)[0] if get_args(kind) else kind)) for kind in _members(hint))


def _is_of(value: Any, hint: Any) -> bool:
    """Return whether a value is of a type; numbers may be NumPy's, a bool is no number, and a text is no sequence."""
    origin = get_origin(hint) or hint
    if origin in (Union, UnionType):
        return any(_is_of(value, kind) for kind in _members(hint))
    if origin is Annotated:
        kind, extent = get_args(hint)
        return _is_of(value, kind) and (not isinstance(value, Real) or extent.holds(value))
    if origin is Literal:
        return isinstance(value, str | int) and value in get_args(hint)
    if origin in NUMBERS:
        return isinstance(value, NUMBERS[origin]) and not isinstance(value, bool)
    try:
        # arrays of other libraries are arrays, too; those of one dimension are sequences
        is_of = (isinstance(value, origin) and (origin is str or not isinstance(value, str))) or (
            hasattr(value, "__array__")
            and (origin.__name__ == "ndarray" or (origin is Sequence and getattr(value, "ndim", 0) == 1))
        )
    except TypeError:  # a hint that is no class, or a contract that cannot be checked
        return True
    elements = get_args(hint)[:1] if origin in (tuple, Sequence) else ()
    return is_of and all(_is_of(each, element) for element in elements for each in value)


NUMBERS: Mapping[Any, type] = {int: Integral, float: Real, Fraction: Rational}
"""Abstract types of numbers, which those of NumPy are, too."""

DESCRIPTIONS: Mapping[Any, str] = {
    bool: "True or False",
    int: "a whole number",
    float: "a number",
    Fraction: "a fraction",
    str: "text",
    os.PathLike: "a path",
    Path: "a path",
    tuple: "a sequence",
    Sequence: "a sequence",
    Iterable: "a sequence",
    Callable: "a function",
}
"""What messages call types."""


def _described(hint: Any, value: Any) -> str:
    """Return what a message calls a type, or the range that a value of the right type is not in."""
    members = _members(hint)
    origin = get_origin(hint) or hint
    if origin is Annotated:
        kind, extent = get_args(hint)
        return str(extent) if _is_of(value, kind) else _described(kind, value)
    if len(members) > 1:
        covered = (NoneType, int, Fraction) if float in members else (NoneType,)
        return " or ".join(dict.fromkeys(_described(kind, value) for kind in members if kind not in covered))
    if origin is Literal:
        return f"one of {', '.join(map(str, get_args(hint)))}"
    name = origin.__name__.removeprefix("nd")  # of an array
    if getattr(origin, "_is_protocol", False):
        missing = [each for each in dir(origin) if not each.startswith("_") and not hasattr(value, each)]
        name += f" with {' and '.join(missing)}" if missing else ""
    items = [f", each item {_described(each, value)}" for each in get_args(hint)[:1] if origin in (tuple, Sequence)]
    return DESCRIPTIONS.get(origin, f"{'an' if name[0].lower() in 'aeio' else 'a'} {name}") + "".join(items)
