"""Options, declared once: as fields in Python, as flags on the command line."""

import ast
import re
from dataclasses import fields
from inspect import signature
from pathlib import Path
from typing import Literal, get_args, get_origin, get_type_hints

import pytest

import fpsboost
from fpsboost import (
    DecodeOptions,
    Encoding,
    MotionField,
    RunOptions,
    Timing,
    find_method,
    interpolate_clip,
    methods,
)
from fpsboost.cli.flags import flag_names, in_flags
from fpsboost.cli.options import MethodOptions, TuningOptions, option_classes
from fpsboost.options import flags_of

PACKAGE = Path(fpsboost.__file__).parent
NOT_ON_THE_COMMAND_LINE = {"trim", "side", "observer", "watcher", "progress", "cancel"}  # groups, objects, functions


WRITES_COMMANDS = {"evaluation/hidden_frames.py", "evaluation/report/page.py"}
"""Files with words of the command line, for the line that a report page shows to be typed."""


@pytest.mark.parametrize("cls", [DecodeOptions, Encoding, Timing, RunOptions])
def test_every_field_has_a_flag(cls):
    """Whatever a library call can be told, the command line can."""
    named = {flag.field for flag in flags_of(cls)}
    assert {field.name for field in fields(cls)} - named <= NOT_ON_THE_COMMAND_LINE


def test_flags_are_spelled_once():
    """A field that two groups have has one flag in both, so that a message can name it."""
    flags = [(flag.field, flag.name) for cls in option_classes for flag in flags_of(cls)]
    assert set(flags) == set(flag_names.items())


@pytest.mark.parametrize("flag", list(flags_of(TuningOptions)), ids=lambda flag: flag.field)
def test_options_of_methods_are_fields_of_their_parts(flag):
    """With the same choices, if there are some; texts are read where those behind the name of a method are."""
    parts = {type(part) for method in methods.values() for part in (method.estimator, method.synthesizer)}
    (kind,) = {hints[flag.field] for hints in map(get_type_hints, parts) if flag.field in hints}
    assert (get_args(kind) if get_origin(kind) is Literal else ()) == flag.option.choices


def test_flags_of_methods_stand_for_options_behind_a_name():
    """One grammar: what a flag sets, and what the name of a method has behind a colon, are the same."""
    made = MethodOptions("nlm:fusion=plain").interpolator(TuningOptions(patch_radius="4", v="0.1"))
    assert made == find_method("nlm:fusion=plain,patch-radius=4,v=0.1") != methods["nlm"]


@pytest.mark.parametrize(
    ("sentence", "shown"),
    [
        ("give `fps`", "give --fps"),
        ("give `fps=60`", "give --fps 60"),
        ("give `codec='hevc'`", "give --codec hevc"),
        ("leave it out with `audio=False`", "leave it out with --no-audio"),
        ("`deinterlace=True` makes two", "--deinterlace makes two"),
        ("allow more with `limit`", "allow more with --max-memory"),
        ("the file `x`, `y`.mp4 and `", "the file `x`, `y`.mp4 and `"),
    ],
)
def test_messages_name_flags(sentence, shown):
    """The command line puts its flags where the library names fields, and leaves other backquotes alone."""
    assert in_flags(sentence) == shown


def library_texts():
    """Yield the texts of the library outside docstrings, with their files; integrations name options of their hosts."""
    for path in sorted(PACKAGE.rglob("*.py")):
        place = path.relative_to(PACKAGE)
        if place.parts[0] in ("cli", "integrations", "ui") or place.as_posix() in WRITES_COMMANDS:
            continue
        tree = ast.parse(path.read_text(encoding="utf-8"))
        docstrings = {id(node.value) for node in ast.walk(tree) if isinstance(node, ast.Expr)}
        for node in ast.walk(tree):
            if isinstance(node, ast.Constant) and isinstance(node.value, str) and id(node) not in docstrings:
                yield path, node.value


@pytest.mark.slow
def test_the_library_names_fields_and_no_flags():
    """No message of the library speaks of a command line, and each name between backquotes is an option or argument."""
    names = flag_names.keys() | signature(interpolate_clip).parameters.keys() | signature(MotionField).parameters.keys()
    for path, text in library_texts():
        assert not re.search(r"(?<![\w-])--[a-z]", text), f"{path}: {text}"
        for name in re.findall(r"`([a-z]\w*)(?:=[^`]*)?`", text):
            assert name in names, f"{path}: {text}"
