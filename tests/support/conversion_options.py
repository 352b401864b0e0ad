"""Options of conversions by the names of their fields, for tests that vary one or two of them."""

from dataclasses import fields, replace
from pathlib import Path
from typing import Any

from fpsboost import DecodeOptions, Encoding, FrameSink, RunOptions, Target, Timing, convert
from fpsboost.io import DescribedSource
from fpsboost.io.output import Output
from fpsboost.media import OutputTiming

FAST = Encoding(preset="ultrafast")
GROUPS = {"timing": Timing, "decoding": DecodeOptions, "run": RunOptions}


def grouped(**options: Any) -> dict[str, Any]:
    """Return arguments of `fpsboost.convert` with each option in the group whose field has its name."""
    arguments: dict[str, Any] = {}
    for argument, group in GROUPS.items():
        names = {field.name for field in fields(group)} & set(options)
        if names:
            arguments[argument] = group(**{name: options.pop(name) for name in names})
    return {**arguments, **options}


def output_of(path: Path | str, source: DescribedSource, timing: OutputTiming, **options: Any) -> Output:
    """Return an output made from a source."""
    stream = source.stream_info
    return Output(str(path), source.info, timing, stream, **options)


def open_output(path: Path | str, source: DescribedSource, timing: OutputTiming, **options: Any) -> FrameSink:
    """Return the sink of an output made from a source."""
    return Target.parse(str(path)).open(output_of(path, source, timing, **options))


def double(source: Path, target: Path, encoding: Encoding = FAST, **options: Any) -> list[str]:
    """Convert in the cheapest way; return the remarks."""
    if target.suffix == ".webm":
        encoding = replace(encoding, preset="8")
    return convert(str(source), str(target), method="nearest", encoding=encoding, **grouped(**options)).remarks
