"""Options of conversions by the names of their fields, for tests that vary one or two of them."""

from __future__ import annotations

from dataclasses import fields, replace
from typing import Any

from fpsboost import DecodeOptions, Interpolator, RunOptions, methods
from fpsboost.timing.rate import OutputRate

GROUPS = {"rate": OutputRate, "decoding": DecodeOptions, "run": RunOptions}


def grouped(**options: Any) -> dict[str, Any]:
    """Return arguments of `fpsboost.convert` with each option in the group whose field has its name."""
    arguments: dict[str, Any] = {}
    for argument, group in GROUPS.items():
        names = {field.name for field in fields(group)} & set(options)
        if names:
            arguments[argument] = group(**{name: options.pop(name) for name in names})
    return {**arguments, **options}


def keeping_duplicates(method: str) -> Interpolator:
    """Return a method that takes frames which show the same as the one before for frames of their own."""
    return replace(methods[method], duplicates=None)
