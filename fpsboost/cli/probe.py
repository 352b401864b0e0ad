"""Command `fpsboost probe`: prints the properties of a clip, as tables or as JSON."""

from __future__ import annotations

import json as plain
from dataclasses import asdict
from typing import TYPE_CHECKING, Annotated

from cyclopts import Parameter
from rich.console import Console
from rich.table import Column, Table

from fpsboost.cli.flags import OWN_OPTIONS, Input, OwnFlag, in_flags
from fpsboost.cli.messages import as_objects, console, fact_table, literal, sentence
from fpsboost.cli.options import PathName
from fpsboost.errors import rounded
from fpsboost.io.video.decode_options import DecodeOptions
from fpsboost.timing.position import as_ranges
from fpsboost.timing.schedule import parse_rate

if TYPE_CHECKING:
    from fpsboost.media import StreamFacts
    from fpsboost.probing import Probe

MAX_CUTS = 24
"""Maximum number of cuts whose times are printed; --json has them all."""


def probe(
    input: Input,
    /,
    *,
    input_fps: Annotated[str | None, Parameter(group=OWN_OPTIONS, metavar="RATE")] = None,
    stream: Annotated[int | None, Parameter(group=OWN_OPTIONS, metavar="N")] = None,
    allow_playlists: OwnFlag = False,
    guide: Annotated[PathName | None, Parameter(group=OWN_OPTIONS, metavar="PATH")] = None,
    guide_offset: Annotated[str, Parameter(group=OWN_OPTIONS, metavar="S")] = "0",
    json: OwnFlag = False,
) -> None:
    """Print the properties of a clip, and what a conversion keeps.

    Parameters
    ----------
    input
        A video file, an animation, a folder of images, or a pattern: shot_%04d.png, shot_####.png.
    input_fps
        Frame rate of images, else 24; or of a raw stream.
    stream
        Number of the video stream in its file; else the largest.
    allow_playlists
        Read playlists and the files that they name.
    guide
        Cheap clip of the frames to be made: are all there?
    guide_offset
        Start of the input in the guide, seconds.
    json
        Plain JSON on standard output.
    """
    from fpsboost.probing import probe as run  # noqa: PLC0415
    from fpsboost.probing import probe_guide  # noqa: PLC0415

    rate = None if input_fps is None else parse_rate(input_fps, "`input_fps`")
    with console(quiet=json).status("reading"):
        result = run(input, rate, stream, allow_playlists=allow_playlists)
        if guide is not None:
            decoding = DecodeOptions(input_fps=rate, stream=stream, guide=guide, guide_offset=guide_offset)
            result.remarks.take(probe_guide(input, decoding))
    if json:
        refused = result.conversion.refused
        values = asdict(result)
        values["remarks"] = as_objects(result.remarks)
        values["conversion"]["remarks"] = as_objects(result.conversion.remarks)
        values["conversion"]["refused"] = refused and in_flags(refused)
        print(plain.dumps(values, indent=1, default=str))
        return
    out = Console(highlight=False)
    out.print(f"[bold]{literal(result.name)}[/]")
    if result.streams:
        out.print(stream_table(result.streams))
    out.print(fact_table({name: sentence(value) for name, value in facts(result).items()}))
    for remark in [*result.remarks, *result.conversion.remarks]:
        out.print(f"[yellow]Note:[/] {sentence(remark)}")


def read_probe(text: str) -> Probe:
    """Return the properties of a clip that ``fpsboost probe --json`` has printed."""
    from fpsboost.parts.manifest import from_json  # noqa: PLC0415
    from fpsboost.probing import Probe  # noqa: PLC0415

    result: Probe = from_json(Probe, plain.loads(text))
    return result


def stream_table(streams: list[StreamFacts]) -> Table:
    """Return a table with one row per stream, with a column for whether an .mp4 can hold it."""
    names = ("stream", "kind", "codec", "", "language", "title", "in .mp4")
    columns = (Column(name, overflow="fold") for name in names)
    table = Table(*columns, box=None, pad_edge=False, header_style="dim")
    for stream in streams:
        cells = (str(stream.index), stream.kind, stream.codec, stream.details, stream.language, stream.title)
        table.add_row(*(literal(cell or "-") for cell in cells), "yes" if stream.carries_over else "[yellow]no[/]")
    return table


def facts(result: Probe) -> dict[str, str]:
    """Return the names and values of everything but streams as readable text."""
    conversion = result.conversion
    every = "" if result.declared_frames in (None, result.frames) else f" of the {result.declared_frames} declared"
    lines = {"size": f"{result.width}x{result.height}"}
    if look := result.look:
        tags = [f"{name} {tag}" for name in ("matrix", "primaries", "transfer") if (tag := getattr(look, name))]
        lines["pixels"] = f"{look.pixel_format}, aspect {look.pixel_aspect}, rotation {look.rotation:g} degrees"
        lines["colour"] = ", ".join([*(tags or ["no tags"]), "full range" if look.full_range else "limited range"])
    intervals = " / ".join(rounded(1000 * each, 4) for each in (result.shortest, result.median, result.longest))
    times = ", ".join(f"{cut:.3f}" for cut in result.cuts[:MAX_CUTS])
    more = f" and {len(result.cuts) - MAX_CUTS} more" if len(result.cuts) > MAX_CUTS else ""
    damaged = f"{len(result.damaged)} ({as_ranges(result.damaged[:MAX_CUTS])}); --replace auto interpolates them"
    flagged = f"{result.interlaced} of {result.frames} frames flagged; --deinterlace makes two of each"
    return {
        **lines,
        "rate": f"{result.rate:.6g} fps ({result.exact_rate}), {'varies' if result.varies else 'constant'}",
        "intervals": f"{intervals} ms (shortest / median / longest)",
        "duration": f"{result.duration:.3f} s" + (f", starts at {result.start:.3f} s" if result.start else ""),
        "frames": f"{result.frames}{every}",
        **({"numbers": f"in steps of {result.number_step}"} if (result.number_step or 1) > 1 else {}),
        "duplicates": describe_duplicates(result) if result.duplicates else "none",
        "scene cuts": f"{len(result.cuts)}, at {times}{more} s" if result.cuts else "none",
        **({"loop": "the last frame leads to the first; --loop makes the frames between"} if result.loops else {}),
        "damaged": damaged if result.damaged else "none",
        "interlaced": flagged if result.interlaced else "no",
        "--factor 2": conversion.refused or f"{conversion.frames} frames at {conversion.rate:.6g} fps",
    }


def describe_duplicates(result: Probe) -> str:
    """Return how many frames repeat another, in which cadence, and what leaves them out."""
    cadence = (
        f"{result.cadence} in {100 * result.cadence_share:.0f} % of what moves"
        if result.cadence_share >= 0.5
        else "in no regular cadence"
    )
    rate = "a variable rate" if result.picture_rate is None else f"{result.picture_rate:.6g} fps"
    return f"{result.duplicates}, {cadence}; --duplicates drop leaves {rate}"
