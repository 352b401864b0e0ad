"""Option --dry-run: prints what a conversion would make, keep and lose, and its time and size, estimated by a trial."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import replace
from fractions import Fraction

from rich.console import Console

from fpsboost.cli.batch import remark_on_last_image
from fpsboost.cli.messages import console, fact_table, literal, sentence
from fpsboost.conflicts import check_together
from fpsboost.errors import OptionError
from fpsboost.frame import ClipInfo
from fpsboost.io.opening import PIPES
from fpsboost.media import counted
from fpsboost.memory import readable_size
from fpsboost.preparation import ConversionJob, Preparation, prepared, with_duration
from fpsboost.preview.page import Preview, estimate_sentence, preview
from fpsboost.probing import find_guides
from fpsboost.run_options import RunOptions
from fpsboost.timing.options import Timing, readable
from fpsboost.timing.position import Position, format_time
from fpsboost.timing.schedule import count_frames

PLACES = (Fraction(1, 4), Fraction(1, 2), Fraction(3, 4))
"""Places of the passages that are tried, as parts of the clip; where motion is largest, they would be too large."""

MIN_FRAMES = 1200  # number of frames of a clip below which one passage is tried, at its beginning

PART = 16
"""Divisor of a clip's frames for those that are tried: with reading, the trial takes a tenth of the run."""

SHORTEST = 3
"""Minimum number of frames in a passage."""
LONGEST = 24
"""Maximum number of frames in a passage."""

KEY_INTERVAL = 250
"""Usual number of frames from one key frame to the next; in a passage, the first frame is one."""

NAMES = {"audio": "sound", "subtitle": "subtitles", "cover": "cover picture", "data": "data", "attachment": "file"}
"""Names in messages of the kinds of streams beside the pictures."""


def say_dry_run(job: ConversionJob, run: RunOptions) -> None:
    """Print what a conversion would make, keep, lose and take; write nothing."""
    check_together(run.names_given() | {"dry_run"})
    if {job.input, job.output} & {*PIPES}:
        raise OptionError("A pipe can be read only once, and --dry-run tries passages of the clip; name files.")
    reading = console()
    with reading.status("reading"), prepared(job, replace(run, resume=False)) as ready:
        coding, remarks = ready.expected_losses()
        remarks.take(find_guides(ready))
        source = ready.clip.source.info
        output = ready.output
        is_images = ready.target.kind == "images"
        frames = output.expected_frames
        rate = output.timing.rate
        if frames is None:
            source = job.decoding.trim.of_info(with_duration(ready.clip.whole))
            frames = count_frames(ready.schedule, source, holds_last_frame=not is_images or job.timing.loop)
        kept = _kept(ready, {remark.values.get("lost_stream") for remark in remarks})
        places, length = _places(ready, source)
    made = [output.path, *([] if frames is None else [counted(frames, "frame")])]
    if ready.target.has_rate:
        made[-1] += f"{',' if frames is None else ' at'} {readable(rate)} fps"
        made += [] if frames is None else [format_time(frames / rate)]
    made += coding
    duration = "" if source.duration is None else f", {format_time(source.duration)}"
    duration = duration if source.frame_count is None else f", {counted(source.frame_count, 'frame')}"
    rows = {
        "from": f"{source.width}x{source.height} at {readable(source.rate)} fps{duration}",
        "makes": ", ".join(made),
        "keeps": ", ".join(kept) or "only the pictures",
        "takes": "not estimated, as the clip is too short for a trial",
    }
    added = frames if frames is None or not run.in_place else frames - (source.frame_count or 0)
    if length >= SHORTEST:
        with reading.status("trying passages"):
            target = "images/" if is_images else job.output
            # of the frames of a curve, hardly any is one of the source
            timing = Timing(factor=4) if job.timing.retimes else job.timing.of_passage()
            tried = replace(job, output=target, timing=timing)
            run = RunOptions(limit=run.limit, threads=run.threads)
            trial = preview(tried, {"": job.method}, run, at=places, length=length)
        remarks.take(trial.remarks.expected)
        rows["takes"] = estimate_sentence(frames, trial.seconds_per_frame[""])
        rows["size"] = _size(trial, added) + ", other streams not counted" * bool(kept)
        rows["tried"] = f"{sum(each.frames for each in trial.trials[''])} frames, for time and size"
    table = fact_table({name: sentence(value) for name, value in rows.items()})
    out = Console(highlight=False)
    out.print(f"[bold]{literal(str(job.input))}[/]", table, sep="\n")
    if is_images:
        remark_on_last_image(remarks, source.frame_count or 0, frames or 0, job.timing.multiple)
    for remark in remarks:
        out.print(f"[yellow]Note:[/] {sentence(remark)}", soft_wrap=True)
    out.print("Nothing was written.")


def _kept(ready: Preparation, lost: Collection[object]) -> list[str]:
    """Return the streams beside the pictures that a video keeps; `lost` are numbers of those that it cannot hold."""
    encoding = ready.output.encoding
    kept = list[str]()
    wanted = {"audio": encoding.audio, "subtitle": encoding.subtitles}
    for stream in ready.clip.whole.stream_info.streams if ready.target.kind == "video" else ():
        is_asked = encoding.streams is None or stream.index in encoding.streams or stream.kind not in wanted
        if stream.kind in NAMES and is_asked and wanted.get(stream.kind, True) and stream.index not in lost:
            language = f" ({stream.language})" if stream.language not in (None, "und") else ""
            kept.append(f"{stream.codec or stream.title or ''} {NAMES[stream.kind]}{language}".strip())
    return kept


def _places(ready: Preparation, info: ClipInfo) -> tuple[list[Position], int]:
    """Return where the passages of the trial begin, and their length in frames, so that they take a tenth of the run.

    Short clips are tried at their beginning, since reading elsewhere may require decoding everything before.
    """
    count = info.frame_count or (MIN_FRAMES if info.duration is None else int(info.duration * info.rate))
    begin, _ = ready.job.decoding.trim.seconds(ready.clip.whole.info)
    shares = PLACES if count >= MIN_FRAMES else (Fraction(0),)
    length = min(LONGEST, count // (PART * len(shares)))
    return [Position(begin + count / info.rate * share) for share in shares], length


def _size(trial: Preview, frames: int | None) -> str:
    """Return the estimated size of so many frames, by the mean size of later frames and of key frames in the trial."""
    trials = trial.trials[""]
    begun = sum(each.first for each in trials)
    later = (sum(each.size for each in trials) - begun) / sum(each.frames - (each.first > 0) for each in trials)
    if frames is None:
        return f"about {readable_size(later)} a frame"
    return f"about {readable_size(later * frames + begun / len(trials) * -(-frames // KEY_INTERVAL))}"
