"""Frozen dataclasses of options as JSON, and back."""

from __future__ import annotations

from dataclasses import fields, is_dataclass
from fractions import Fraction
from typing import Any, get_args, get_origin, get_type_hints


def as_json(value: Any) -> Any:
    """Return a dataclass as JSON knows it: objects for dataclasses, text for fractions.

    Examples
    --------
    >>> from fpsboost.timing.rate import OutputRate
    >>> as_json(OutputRate(Fraction(5, 2)))["factor"]
    '5/2'
    """
    if is_dataclass(value):
        return {field.name: as_json(getattr(value, field.name)) for field in fields(value) if field.init}
    if isinstance(value, Fraction):
        return str(value)
    if isinstance(value, dict):
        return {str(key): as_json(each) for key, each in value.items()}
    if isinstance(value, (list, tuple)):
        return [as_json(each) for each in value]
    return value


def from_json(kind: Any, value: Any) -> Any:
    """Return the object of a type that `as_json` has stored.

    Parameters
    ----------
    kind : type
        A dataclass, Fraction, str, int, float, bool, a list, tuple or dict of these, or a union of one with None.
    value : object
        Result of `as_json`.

    Raises
    ------
    KeyError, TypeError, ValueError
        The value was stored by something else.

    Examples
    --------
    >>> from fpsboost.timing.rate import OutputRate
    >>> from_json(OutputRate, as_json(OutputRate(Fraction(5, 2)))).factor
    Fraction(5, 2)
    """
    if value is None:
        return None
    choices = [each for each in get_args(kind) if each is not type(None)] if _is_union(kind) else [kind]
    if Fraction in choices:
        return Fraction(value)
    (kind, *_) = choices
    if is_dataclass(kind):
        hints = get_type_hints(kind)
        return kind(**{name: from_json(hints[name], each) for name, each in value.items()})  # type: ignore[operator]
    return _collection(kind, value) if get_args(kind) else value


def _collection(kind: Any, value: Any) -> Any:
    """Return a list, tuple or dict; values of a Literal as they are."""
    items = get_args(kind)
    if get_origin(kind) is dict:
        return {items[0](key): from_json(items[1], each) for key, each in value.items()}
    if get_origin(kind) is list:
        return [from_json(items[0], each) for each in value]
    if get_origin(kind) is tuple:
        kinds = [items[0]] * len(value) if items[-1] is Ellipsis else items
        return tuple(from_json(each, item) for each, item in zip(kinds, value, strict=True))
    return value


def _is_union(kind: Any) -> bool:
    return type(None) in get_args(kind) or Fraction in get_args(kind)
