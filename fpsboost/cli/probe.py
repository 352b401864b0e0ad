"""Command `fpsboost probe`: prints the properties of a clip, as tables or as JSON."""

from __future__ import annotations

import json as plain
from dataclasses import replace
from typing import TYPE_CHECKING, Annotated

from cyclopts import Group, Parameter
from rich.console import Console
from rich.table import Table

from fpsboost.cli.messages import shown
from fpsboost.cli.options import in_flags
from fpsboost.cli.signature import PathName

if TYPE_CHECKING:
    from fpsboost.io.video.fitting import StreamFacts
    from fpsboost.probing import Look, Probe

MAX_WIDTH = 80
MAX_CUTS = 24
"""Maximum number of cuts whose times are printed; --json has them all."""

options = Group("Options", sort_key=1)


def probe(
    input: Annotated[PathName, Parameter(name="IN")],
    /,
    *,
    input_fps: Annotated[str | None, Parameter(group=options, metavar="RATE")] = None,
    stream: Annotated[int | None, Parameter(group=options, metavar="N")] = None,
    json: Annotated[bool, Parameter(group=options)] = False,
) -> None:
    """Say what a clip is, and what a conversion would do with it.

    Parameters
    ----------
    input
        A video file, an animation, a folder of images, or a pattern: shot_%04d.png, shot_####.png.
    input_fps
        Frames per second of input images; else 24.
    stream
        Number of the video stream in its file; else the largest.
    json
        Plain JSON on standard output.
    """
    from fpsboost.probing import probe as run  # noqa: PLC0415
    from fpsboost.timing.schedule import parse_rate  # noqa: PLC0415

    rate = None if input_fps is None else parse_rate(input_fps, "`input_fps`")
    with Console(stderr=True, quiet=json).status("reading"):
        found = run(input, rate, stream)
    found = replace(
        found,
        remarks=[in_flags(remark) for remark in found.remarks],
        conversion=replace(
            found.conversion,
            refused=found.conversion.refused and in_flags(found.conversion.refused),
            remarks=[in_flags(remark) for remark in found.conversion.remarks],
        ),
    )
    if json:
        print(plain.dumps(found.as_json(), indent=1))
        return
    console = Console(highlight=False)
    console.width = min(console.width, MAX_WIDTH)
    console.print(f"[bold]{shown(found.name)}[/]")
    if found.streams:
        console.print(stream_table(found.streams))
    console.print(fact_table(found))
    for remark in [*found.remarks, *found.conversion.remarks]:
        console.print(f"[yellow]Note:[/] {shown(remark)}")


def stream_table(streams: list[StreamFacts]) -> Table:
    """Return a table with one row per stream, which says whether an .mp4 can hold it."""
    table = Table(box=None, pad_edge=False, header_style="dim")
    for name in ("stream", "kind", "codec", "", "language", "title", "in .mp4"):
        table.add_column(name, overflow="fold")
    for each in streams:
        cells = (str(each.index), each.kind, each.codec, each.details, each.language, each.title)
        table.add_row(*(shown(cell or "-") for cell in cells), "yes" if each.carries_over else "[yellow]no[/]")
    return table


def fact_table(found: Probe) -> Table:
    """Return a table of everything else, one name and value per row."""
    table = Table(box=None, pad_edge=False, show_header=False)
    table.add_column(style="dim", no_wrap=True)
    table.add_column(overflow="fold")
    for name, value in facts(found).items():
        table.add_row(name, shown(value))
    return table


def facts(found: Probe) -> dict[str, str]:
    """Return names and values as readable text."""
    conversion = found.conversion
    every = "" if found.declared_frames in (None, found.frames) else f" of the {found.declared_frames} declared"
    lines = {"size": f"{found.width}x{found.height}", **(look_lines(found.look) if found.look else {})}
    lines["rate"] = f"{found.rate:.6g} fps ({found.exact_rate}), {'varies' if found.varies else 'constant'}"
    lines["intervals"] = " / ".join(f"{1000 * each:.4g}" for each in (found.shortest, found.median, found.longest))
    lines["intervals"] += " ms (shortest / median / longest)"
    lines["duration"] = f"{found.duration:.3f} s" + (f", starts at {found.start:.3f} s" if found.start else "")
    lines["frames"] = f"{found.frames}{every}"
    if found.number_step is not None and found.number_step > 1:
        lines["numbers"] = f"in steps of {found.number_step}"
    lines["duplicates"] = str(found.duplicates) if found.duplicates else "none"
    lines["scene cuts"] = cut_times(found.cuts)
    flagged = f"{found.interlaced} of {found.frames} frames flagged; --deinterlace makes two of each"
    lines["interlaced"] = flagged if found.interlaced else "no"
    lines["--factor 2"] = conversion.refused or f"{conversion.frames} frames at {conversion.rate:.6g} fps"
    return lines


def look_lines(look: Look) -> dict[str, str]:
    """Return how the frames are stored and to be displayed, as names and values."""
    tags = [
        f"{name} {tag}" for name, tag in zip(("matrix", "primaries", "transfer"), tags_of(look), strict=True) if tag
    ]
    return {
        "pixels": f"{look.pixel_format}, aspect {look.pixel_aspect}, rotation {look.rotation:g} degrees",
        "colour": ", ".join([*(tags or ["no tags"]), "full range" if look.full_range else "limited range"]),
    }


def tags_of(look: Look) -> tuple[str | None, str | None, str | None]:
    """Return the colour tags: matrix, primaries, transfer."""
    return look.matrix, look.primaries, look.transfer


def cut_times(cuts: list[float]) -> str:
    """Return the number of cuts and their times as text."""
    if not cuts:
        return "none"
    listed = ", ".join(f"{cut:.3f}" for cut in cuts[:MAX_CUTS])
    more = f" and {len(cuts) - MAX_CUTS} more" if len(cuts) > MAX_CUTS else ""
    return f"{len(cuts)}, at {listed}{more} s"
