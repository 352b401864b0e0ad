"""Does everything come through: ``python benchmarks/originals.py FOLDER``.

Converts every file of a folder, reads source and result with PyAV alone, and prints a row each. A file passes where
its length, sound, colours and orientation came through, or where one sentence says why it cannot be converted; it fails
otherwise. A sound may be missing where a remark names its stream as left out. What follows ``--`` goes to fpsboost.
"""

from __future__ import annotations

import argparse
import json
import re
import subprocess
import sys
import tempfile
from dataclasses import asdict, dataclass, field
from pathlib import Path

import av
from coming_through import COMPARED_FRAMES, Colours, Video, compare_colours, compare_sound, read_video
from rich.markup import escape
from rich.table import Table
from scoring import wide_console

POLL_INTERVAL = 600
"""Seconds that a conversion may take; none of them should hang."""

MAX_SHIFT = 0.5
"""Levels of 8 bits by which the mean of a channel may change, beyond what the pixel format of the result changes."""

MAX_ROUNDING = (255 / 219 + 1.8814 * 255 / 224) / 2
"""The most that a pixel format may change: the rounding of luma and chroma to 8 bits, where it matters most.

That is the blue of BT.2020 in limited range: half a step of luma, and half a step of chroma 1.8814 times.
"""

CONTAINERS = (".mp4", ".mkv")
"""Tried one after the other: not every kind of sound fits into the first."""


@dataclass
class Row:
    """Result of converting one file."""

    name: str
    source: str = ""
    result: str = ""
    duration_difference: float | None = None
    sound: str = ""
    colours: Colours | None = None
    orientation: str = ""
    verdict: str = ""
    passed: bool = False
    remarks: list[str] = field(default_factory=list)


def convert(path: Path, folder: Path, options: list[str]) -> tuple[Path | None, list[str]]:
    """Convert a file; return the result, if there is one, and what was said."""
    for suffix in CONTAINERS:
        target = folder / f"{path.name}{suffix}"  # two files may differ in their endings alone
        command = [sys.executable, "-m", "fpsboost", str(path), str(target), *options]
        try:
            done = subprocess.run(command, capture_output=True, text=True, check=False, timeout=POLL_INTERVAL)
        except subprocess.TimeoutExpired:
            return None, [f"no end within {POLL_INTERVAL} s"]
        lines = done.stderr.strip().splitlines()
        if done.returncode == 0:
            return target, lines
    return None, lines


def judge(path: Path, folder: Path, options: list[str]) -> Row:
    """Convert one file and compare it with what came out."""
    row = Row(path.name)
    target, lines = convert(path, folder, options)
    if target is None:
        row.passed = len(lines) == 1 and lines[0].startswith("fpsboost: ")
        row.verdict = lines[-1].removeprefix("fpsboost: ") if lines else "failed without a word"
        return row
    row.remarks = [line.removeprefix("Note: ") for line in lines if line.startswith("Note: ")]
    try:
        before = read_video(path, COMPARED_FRAMES)
    except (av.error.FFmpegError, ValueError, AttributeError) as error:  # an animation that Pillow alone reads
        row.verdict = f"was converted, and PyAV cannot read it to compare: {error}"
        return row
    after = read_video(target, 3 * COMPARED_FRAMES, in_rgb=before.is_rgb)
    row.source = f"{before.description}, {len(before.times)} frames"
    row.result = f"{after.description}, {len(after.times)} frames"
    row.duration_difference = float(after.duration - before.duration)
    named = {int(number) for remark in row.remarks for number in re.findall(r"stream (\d+) was left out", remark)}
    row.sound = compare_sound(before, after, named)
    row.orientation = "same" if after.turned == before.turned else f"{before.turned:g} -> {after.turned:g} degrees"
    row.colours = compare_colours(before, after)
    faults = find_faults(row, before, after)
    row.passed = not faults
    row.verdict = "; ".join(faults) or "pass"
    return row


def find_faults(row: Row, before: Video, after: Video) -> list[str]:
    """Return the properties that did not come through, except a length whose difference a remark explains."""
    faults = []
    is_said = any("its header promises" in remark for remark in row.remarks)  # the header is where its end comes from
    if abs(row.duration_difference or 0) > max(after.duration / max(len(after.times), 1), 0.002) and not is_said:
        faults.append("length")
    if after.longest - before.longest > 0.002:
        faults.append("gap")
    if row.sound not in ("none", "identical"):
        faults.append("sound")
    if row.colours and (row.colours.change > MAX_SHIFT or row.colours.shift > MAX_SHIFT + MAX_ROUNDING):
        faults.append("colour")
    faults += [
        f"{name} {tag} -> {after.tags.get(name)}" for name, tag in before.tags.items() if after.tags.get(name) != tag
    ]
    if row.orientation != "same":
        faults.append("orientation")
    return faults


def table(rows: list[Row]) -> Table:
    """Return a table with a row for each file."""
    result = Table(box=None, pad_edge=False, header_style="dim")
    for name in ("file", "in", "out", "length, s", "sound", "colour", "PSNR", "turned", "verdict"):
        result.add_column(name, overflow="fold")
    for row in rows:
        cells = (
            row.name,
            row.source,
            row.result,
            "" if row.duration_difference is None else f"{row.duration_difference:+.4f}",
            row.sound,
            "" if row.colours is None else f"{row.colours.shift:.2f}",
            "" if row.colours is None else f"{row.colours.psnr:.1f}",
            row.orientation,
        )
        result.add_row(*map(escape, cells), f"[{'green' if row.passed else 'red'}]{escape(row.verdict)}[/]")
    return result


def main() -> None:
    """Run the command line."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=Path, help="videos; other files are tried too")
    parser.add_argument("--only", default="", help="names that contain this")
    parser.add_argument("--keep", type=Path, help="an empty folder for the results")
    parser.add_argument("--json", type=Path, help="write the rows here")
    parser.add_argument("options", nargs="*", help="after --: options of fpsboost")
    arguments = parser.parse_intermixed_args()
    paths = sorted(
        each
        for each in arguments.folder.iterdir()
        if each.is_file() and each.suffix.lower() != ".md" and arguments.only in each.name
    )
    console = wide_console()
    with tempfile.TemporaryDirectory() as scratch:
        folder = arguments.keep or Path(scratch)
        folder.mkdir(parents=True, exist_ok=True)
        rows = []
        for path in paths:
            with console.status(escape(path.name)):
                rows.append(judge(path, folder, arguments.options))
    console.print(table(rows))
    for remark in (each for row in rows for each in row.remarks):
        console.print(f"[dim]{escape(remark)}[/]")
    if arguments.json:
        arguments.json.write_text(json.dumps([asdict(row) for row in rows], indent=1))
    failed = [row.name for row in rows if not row.passed]
    console.print(f"{len(rows) - len(failed)} of {len(rows)} pass" + (f"; not {', '.join(failed)}" if failed else ""))
    sys.exit(bool(failed))


if __name__ == "__main__":
    main()
