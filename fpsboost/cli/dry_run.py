"""Option --dry-run: what a conversion would make, keep and lose, and how long and large that would be, from a trial."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import replace
from fractions import Fraction

from rich.console import Console
from rich.table import Table

from fpsboost.cli.batch import last_image_remarks
from fpsboost.cli.messages import literal, readable, sentence
from fpsboost.errors import OptionError, rounded
from fpsboost.frame import ClipInfo
from fpsboost.io.opening import PIPES
from fpsboost.preparation import ConversionJob, Preparation, prepared, with_duration
from fpsboost.preview.page import Preview, estimate_sentence, preview
from fpsboost.probing import as_prospect, expected_losses, list_streams
from fpsboost.run_options import RunOptions
from fpsboost.timing.position import Position, format_time
from fpsboost.timing.schedule import count_frames

PLACES = (Fraction(1, 4), Fraction(1, 2), Fraction(3, 4))
"""Places of the passages that are tried, as parts of the clip; where motion is largest, they would be too large."""

MIN_SECONDS = 8  # duration of a clip below which passages at places of their own would overlap


NAMES = {"audio": "sound", "subtitle": "subtitles", "cover": "cover picture", "data": "data", "attachment": "file"}
"""What messages call the kinds of streams beside the pictures."""


def say_dry_run(job: ConversionJob, run: RunOptions) -> None:
    """Print what a conversion would make, keep, lose and take; write nothing."""
    if {job.input, job.output} & {*PIPES}:
        raise OptionError("A pipe can be read only once, and --dry-run tries passages of the clip; name files.")
    if run.chunk is not None:
        raise OptionError("--dry-run is about the whole conversion; leave --chunk out.")
    reading = Console(stderr=True)
    with reading.status("reading"), prepared(job, replace(run, resume=False)) as ready:
        details, remarks = expected_losses(ready)
        source, output, is_images = ready.clip.source.info, ready.output, ready.target.kind == "images"
        frames, rate = output.expected_frames, output.timing.rate
        if frames is None:
            source = job.decoding.trim.of_info(with_duration(ready.clip.whole))
            frames = count_frames(ready.base_schedule, source, holds_last_frame=not is_images)
        kept, places = _kept(ready, remarks), _places(ready, source)
    with reading.status("trying passages"):
        tried = replace(job, output="images/" if is_images else job.output)
        trial = preview(tried, {"": job.method}, RunOptions(limit=run.limit, threads=run.threads), at=places)
    made = [output.path, *([] if frames is None else [f"{frames} frame{'s' if frames > 1 else ''}"])]
    if ready.target.has_rate:
        made[-1] += f"{',' if frames is None else ' at'} {readable(rate)} fps"
        made += [] if frames is None else [format_time(frames / rate)]
    made += filter(None, details.split(", ")[:2])
    size = _size(trial, frames if not run.in_place or frames is None else frames - (source.frame_count or 0))
    length = "" if source.duration is None else f", {format_time(source.duration)}"
    length = length if source.frame_count is None else f", {source.frame_count} frames"
    rows = {
        "from": f"{source.width}x{source.height} at {readable(source.rate)} fps{length}",
        "makes": ", ".join(made),
        "keeps": ", ".join(kept) or "pictures alone",
        "takes": estimate_sentence(trial.estimates[""]._replace(frames=frames)),
        "size": size + (", other streams not counted" if kept else ""),
    }
    table = Table(box=None, pad_edge=False, show_header=False)
    table.add_column(style="dim", no_wrap=True)
    table.add_column(overflow="fold")
    for name, value in rows.items():
        table.add_row(name, sentence(value))
    console = Console(highlight=False)
    console.print(f"[bold]{literal(job.input)}[/]", table, sep="\n")
    if is_images:
        remarks += last_image_remarks(source.frame_count or 0, frames or 0, job.rate.multiple)
    for remark in dict.fromkeys([*remarks, *map(as_prospect, trial.remarks)]):
        console.print(f"[yellow]Note:[/] {sentence(remark)}", soft_wrap=True)
    console.print("Nothing was written.")


def _kept(ready: Preparation, remarks: Sequence[str]) -> list[str]:
    """Return the streams beside the pictures that a video keeps."""
    file, encoding, kept = ready.clip.whole.stream_info.video, ready.output.encoding, list[str]()
    lost = " ".join(remark for remark in remarks if "left out" in remark)
    wanted = {"audio": encoding.audio, "subtitle": encoding.subtitles}
    for stream in list_streams(file) if file is not None and ready.target.kind == "video" else ():
        is_asked = encoding.streams is None or stream.index in encoding.streams or stream.kind not in wanted
        is_lost = re.search(rf"stream {stream.index}\b" + r"|cover picture" * (stream.kind == "cover"), lost)
        if stream.kind in NAMES and is_asked and wanted.get(stream.kind, True) and not is_lost:
            language = f" ({stream.language})" if stream.language not in (None, "und") else ""
            kept.append(f"{stream.codec or stream.title or ''} {NAMES[stream.kind]}{language}".strip())
    return kept


def _places(ready: Preparation, info: ClipInfo) -> list[Position]:
    """Return where passages begin that are tried; none where motion or a curve decides, as in short clips."""
    duration = info.duration or (None if info.frame_count is None else info.frame_count / info.rate)
    if duration is None or duration < MIN_SECONDS or ready.job.rate.retimes:
        return []
    begin, _ = ready.job.decoding.trim.seconds(ready.clip.whole.info)
    return [Position(begin + duration * place) for place in PLACES]


def _size(trial: Preview, frames: int | None) -> str:
    """Return how large some frames become, by the smallest and the largest passage."""
    sizes = [each.size / each.frames * (frames or 1) for each in trial.trials[""]]
    least, most = (_as_bytes(size) for size in (min(sizes), max(sizes)))
    return (f"about {most}" if least == most else f"{least} to {most}") + (" a frame" if frames is None else "")


def _as_bytes(size: float) -> str:
    unit, name = next((each for each in ((1e9, "GB"), (1e6, "MB")) if size >= each[0]), (1e3, "kB"))
    return f"{rounded(size / unit, 2)} {name}"
