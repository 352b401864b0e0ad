"""Settings that are changed for a while and put back afterwards.

A setting is an attribute of an owner, and owners have names, so that what was changed can be kept as text in a file.
"""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from typing import NamedTuple

Value = bool | int | float | str
Owners = Mapping[str, object]


class Setting(NamedTuple):
    """A value of an attribute: ``Setting("render", "filepath", "//renders/")``."""

    owner: str
    name: str
    value: Value


class Change(NamedTuple):
    """A setting before it was changed and after."""

    before: Setting
    after: Setting


def read(owners: Owners, settings: Sequence[Setting]) -> list[Setting]:
    """Return the settings with the values that they have now."""
    return [setting._replace(value=getattr(owners[setting.owner], setting.name)) for setting in settings]


def write(owners: Owners, settings: Sequence[Setting]) -> None:
    """Set the settings in their order, which matters where one decides what another may be."""
    for setting in settings:
        setattr(owners[setting.owner], setting.name, setting.value)


def change(owners: Owners, wanted: Sequence[Setting]) -> list[Change]:
    """Set the settings, and return what that changed."""
    before = read(owners, wanted)
    write(owners, wanted)
    # read back: an owner may round a value, or take a name in another spelling
    return [Change(*both) for both in zip(before, read(owners, wanted), strict=True)]


def restore(owners: Owners, changes: Sequence[Change]) -> list[Setting]:
    """Put settings back, and return those that are left alone, because somebody has changed or removed them since.

    All are read before the first is set, since setting one may change another.
    """
    present = [each for each in changes if each.before.owner in owners]
    now = read(owners, [each.after for each in present])
    kept = [each for each, current in zip(present, now, strict=True) if each.after == current]
    write(owners, [each.before for each in kept])
    return [each.after for each in changes if each not in kept]


def to_text(changes: Sequence[Change]) -> str:
    """Return changes as JSON text, for `from_text`."""
    return json.dumps([[list(setting) for setting in each] for each in changes])


def from_text(text: str) -> list[Change]:
    """Return the changes that `to_text` wrote; none if the text is empty."""
    return [Change(Setting(*before), Setting(*after)) for before, after in json.loads(text or "[]")]
