"""Names are the words of the glossary, in `fpsboost.frame`, or words that everybody in the field has."""

from __future__ import annotations

import inspect
import re
import tokenize
from collections.abc import Iterator
from functools import cache
from pathlib import Path

import pytest

import fpsboost
from fpsboost import frame

PACKAGE = Path(fpsboost.__file__).parent


def words(text: str) -> set[str]:
    """Return the words of a text."""
    return set(re.findall(r"\w+", text))


FIELD = words(
    """
    area audio base bgr bitrate bits block cb chroma codec coding color colour cr crf cut decode decoder decoding
    deinterlace drop encoder encoding exposure factor flow fps frame gaps gradual grain image interpolate
    interpolated interpolator interval layered levels location lossless mask motion noise overlay pixel planes
    preset preview quality rate rectangle render rendered samples scene shape shutter sound stream stretch
    subsampling subtitles synthesize synthesizer t thumbnail timing trim vectors view x y
    """
)
"""Terms of image and video processing, as papers, FFmpeg and OpenCV use them."""

PROGRAMMING = words(
    """
    args array choose clip clock close compile copy cost count details detector dtype error estimate estimator
    flash folder format function height index info input json kwargs limit memory method name number observer
    option options original output overwrite place policy position presentation process range read ready resume
    run save score search second seconds sink size source step summary thread threads threshold
    time times tolerance total entry job join stop target unit utilisation value warning watch watcher width write
    """
)
"""Terms of programs."""

ENGLISH = words(
    """
    across affordable after amount around as at before begin between boundaries by bytes change check choice
    compensate completed conversion convert curved difference duration end every expected extrapolated fill find
    first for forgiving fpsboost full given has held highest in is keep last longest lowest made mapped mean merged
    moment most multiple must needs neighbours note of opened others out overhead part past pause per planned
    preceding radii reached remaining repeats share shortest side skip slow smallest space start still takes to
    varies whole with without wrote
    """
)
"""Words of everyday English in names that read as sentences."""


def words_in(name: str) -> set[str]:
    """Return the words of an identifier in either spelling, in the singular."""
    name = re.sub(r"(?<=[a-z0-9])(?=[A-Z])|(?<=[A-Z])(?=[A-Z][a-z])", "_", name)
    return {word.lower().rstrip("0123456789") for word in name.split("_") if word.strip("0123456789")}


def is_known(word: str, known: set[str]) -> bool:
    """Return whether a word, or the one that it is the plural of, is known."""
    return bool({word, word.removesuffix("s"), word.removesuffix("es"), word + "s"} & known)


def glossary() -> set[str]:
    """Return the terms that the glossary explains."""
    return set(re.findall(r"\*(\w+)\*", (frame.__doc__ or "").partition("Words\n")[2]))


@cache
def identifiers() -> set[str]:
    """Return all names in the package's code."""
    found = set()
    for path in PACKAGE.rglob("*.py"):
        with tokenize.open(path) as file:
            found |= {token.string for token in tokenize.generate_tokens(file.readline) if token.type == tokenize.NAME}
    return found


def public_names() -> Iterator[str]:
    """Yield the public names, their members, and the parameters of both."""
    for name in fpsboost.__all__:
        value = getattr(fpsboost, name)
        if not callable(value):
            continue
        yield name
        functions = [value.__init__ if isinstance(value, type) else value]
        if isinstance(value, type):
            members = [member for member in vars(value) if not member.startswith("_")]
            yield from members
            functions += [each for each in map(vars(value).get, members) if inspect.isfunction(each)]
        for function in functions:
            yield from (name for name in inspect.signature(function).parameters if name != "self")


@pytest.mark.parametrize("term", sorted(glossary()))
def test_the_glossary_is_in_use(term):
    """Every term that it explains is part of a name in the code, in the singular or the plural."""
    parts = words_in(term)
    assert any(all(is_known(part, words_in(name)) for part in parts) for name in identifiers())


def test_public_names_are_known_words():
    """A new word is explained in the glossary, or is a term of the field."""
    known = FIELD | PROGRAMMING | ENGLISH | {part for term in glossary() for part in words_in(term)}
    unknown = {word for name in public_names() for word in words_in(name) if not is_known(word, known)}
    assert unknown == set()
