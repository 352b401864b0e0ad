"""Methods of a comparison as the command line names them: methods with options, and frames of other tools."""

from __future__ import annotations

import tempfile
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

from fpsboost.errors import OptionError

if TYPE_CHECKING:
    from collections.abc import Iterable

    from fpsboost.evaluation.contestants import Contestant
    from fpsboost.evaluation.hidden_frames import Interval
    from fpsboost.render.folder import VectorFolder


class NamedMethod(NamedTuple):
    """Method given by ``--methods``."""

    text: str
    """Text as the user wrote it, which names the method in tables."""
    name: str
    options: dict[str, str]


def split_methods(texts: Sequence[str]) -> list[NamedMethod]:
    """Parse ``--methods``: names separated by commas, each with options after a colon.

    No name contains an equals sign and every option does, so commas can separate both methods and options.
    """
    methods: list[NamedMethod] = []
    for text in texts:
        for place, part in enumerate(word.strip() for word in text.split(",")):
            name, colon, option = part.partition(":")
            if "=" in part and not (colon and "=" not in name):  # an option of the method before
                if place == 0 or ":" not in methods[-1].text:
                    raise OptionError(f"{part!r} belongs to no method; write METHOD:{part}.")
                methods[-1] = _with_option(methods[-1], f"{methods[-1].text},{part}", part)
                continue
            if not name:
                raise OptionError(f"--methods {text!r} lacks a name; write names with commas between them.")
            method = NamedMethod(part, name.strip(), {})
            methods.append(_with_option(method, part, option) if colon else method)
    return methods


def _with_option(method: NamedMethod, text: str, part: str) -> NamedMethod:
    option, equals, value = (word.strip() for word in part.partition("="))
    if not (option and equals and value):
        raise OptionError(f"{method.text!r} has an option without a value; write {method.name}:OPTION=VALUE.")
    if option in method.options:
        raise OptionError(f"{text!r} gives {option} twice; give it once.")
    return NamedMethod(text, method.name, {**method.options, option: value})


def choose(texts: Sequence[str], vectors: VectorFolder | None) -> tuple[dict[str, Contestant], dict[str, str]]:
    """Return the methods of ``--methods``, and those that cannot be run with the reason."""
    from fpsboost.evaluation.contestants import MINTERPOLATE, Minterpolate, method_names  # noqa: PLC0415
    from fpsboost.method_table import vector_methods  # noqa: PLC0415

    names = method_names()
    contestants: dict[str, Contestant] = {}
    skipped: dict[str, str] = {}
    for method in split_methods(texts):
        for candidate in [NamedMethod(name, name, {}) for name in names] if method.text == "all" else [method]:
            if candidate.name not in names:
                raise OptionError(f"There is no method {candidate.name!r}; choose from {', '.join(names)}, or all.")
            if candidate.name in vector_methods and vectors is None:
                skipped[candidate.text] = "it needs the renderer's motion vectors (--vectors)"
                continue
            contestant = _make(candidate, vectors)  # first, because a wrong option is one wherever FFmpeg is missing
            reason = Minterpolate.missing() if candidate.name == MINTERPOLATE else None
            if reason is None:
                contestants[candidate.text] = contestant
            else:
                skipped[candidate.text] = reason
    return contestants, skipped


def _make(method: NamedMethod, vectors: VectorFolder | None) -> Contestant:
    from fpsboost.evaluation.contestants import MINTERPOLATE, InterpolatorContestant, Minterpolate  # noqa: PLC0415
    from fpsboost.method_table import configure, find_method, may_use_vectors, methods, read_options  # noqa: PLC0415

    if method.name == MINTERPOLATE:
        return Minterpolate.with_options(method.options)
    texts = dict(method.options)
    # as in conversions, vectors are used where they can be
    if method.name in methods and not (may_use_vectors(methods[method.name]) and _uses_vectors(method, texts)):
        vectors = None
    interpolator = find_method(method.name, vectors)
    options = read_options(interpolator, method.name, texts)
    try:
        return InterpolatorContestant(configure(interpolator, method.name, options))
    except OptionError as error:
        raise OptionError(f"In {method.text}: {error}") from None


def _uses_vectors(method: NamedMethod, texts: dict[str, str]) -> bool:
    """Return whether a method is to use rendered vectors; takes the option out of its texts."""
    answer = texts.pop("vectors", "yes")
    if answer not in ("yes", "no"):
        raise OptionError(f"In {method.text}: vectors must be yes or no, not {answer!r}.")
    return answer == "yes"


class Others(NamedTuple):
    """Other tools given by ``--frames`` and ``--peer``."""

    folders: dict[str, str]
    commands: dict[str, str]

    def words(self) -> tuple[str, ...]:
        """Return the options as words of a command line."""
        return tuple(
            word
            for option, given in (("--frames", self.folders), ("--peer", self.commands))
            for name, value in given.items()
            for word in (option, f"{name}={value}")
        )

    def contestants(
        self, intervals: Callable[[], Iterable[Interval]], scratch: Path, begin: Callable[[str, None], None]
    ) -> Iterator[tuple[str, Contestant]]:
        """Match the folders to the clip of `intervals`, and run the commands, whose frames stay in `scratch`."""
        from fpsboost.evaluation.peers import find_frames, run_peer  # noqa: PLC0415

        for name, folder in self.folders.items():
            begin(name, None)
            yield name, find_frames(name, Path(folder), intervals())
        for name, command in self.commands.items():
            begin(name, None)
            yield name, run_peer(name, command, intervals(), Path(tempfile.mkdtemp(dir=scratch)))


def name_others(frames: Sequence[str], peers: Sequence[str]) -> Others:
    """Parse ``--frames NAME=FOLDER`` and ``--peer NAME=COMMAND``, each given any number of times."""
    from fpsboost.evaluation.contestants import method_names  # noqa: PLC0415
    from fpsboost.evaluation.peers import split_command  # noqa: PLC0415

    taken = set(method_names()) | {"all", "truth"}
    by_option: dict[str, dict[str, str]] = {"--frames": {}, "--peer": {}}
    for option, value, text in [
        *(("--frames", "FOLDER", word) for word in frames),
        *(("--peer", "'COMMAND {in} {out}'", word) for word in peers),
    ]:
        name, equals, rest = (word.strip() for word in text.partition("="))
        if not (name and equals and rest):
            raise OptionError(f"{option} {text!r} lacks a name or what it names; write {option} NAME={value}.")
        if name in taken or ":" in name:
            raise OptionError(f"{option} {name!r} is the name of another method; choose one of your own.")
        taken.add(name)
        by_option[option][name] = rest
    for name, command in by_option["--peer"].items():
        split_command(name, command)
    return Others(by_option["--frames"], by_option["--peer"])
