"""Join of the parts of a conversion into the output of one run."""

import os
import time
from collections.abc import Sequence
from dataclasses import replace
from itertools import pairwise
from pathlib import Path

from fpsboost.contracts import Observer, SilentObserver, Summary
from fpsboost.errors import InputError, OptionError, explained
from fpsboost.io.images.sink import ImageSink
from fpsboost.io.opening import Target
from fpsboost.io.video.sink import VideoSink, traits_of_image
from fpsboost.media import complete_chunk, part_files
from fpsboost.method_table import find_method
from fpsboost.options import PathName, checked
from fpsboost.parts.manifest import MANIFEST_NAME, Manifest, first_difference, input_identity, stored
from fpsboost.preparation import ConversionJob, closing_remarks, opened_clip, prepare
from fpsboost.run_options import RunOptions
from fpsboost.timing.options import FrameIntervals


@checked
def join(
    output: PathName,
    parts: PathName | Sequence[PathName],
    *,
    input: PathName | None = None,
    overwrite: bool = False,
    observer: Observer | None = None,
) -> Summary:
    """Join the parts of a conversion; the result is the same as that of one run.

    Sound, subtitles and all other streams are copied from the input. The parts are kept.

    Parameters
    ----------
    output : str or os.PathLike
        Video or folder of images, of the type for which the parts were converted.
    parts : str, os.PathLike, or a sequence of these
        Folders of parts, in any order, or the folder that holds them.
    input : str or os.PathLike, optional
        The input, if its path has changed since the parts were converted.
    overwrite : bool
        Replace an existing output.
    observer : Observer, optional
        Informed when all parts have been checked.

    Raises
    ------
    InputError
        A part is missing, given twice, damaged, or of another job; or the input has changed.
    OptionError
        No parts are named, or `output` is of another type.
    OutputError
        The output exists, or cannot be written.

    Examples
    --------
    >>> join("out.mp4", "out.mp4.parts")  # doctest: +SKIP
    """
    begin = time.perf_counter()
    folders = find_parts([parts] if isinstance(parts, str | os.PathLike) else parts)
    ordered = check_complete([(folder, Manifest.read(folder)) for folder in folders])
    first = ordered[0][1]
    if Target.parse(output).file_type != first.facts.get("output_type"):
        raise OptionError(f"{output} is of another type than {first.output}; name one of that type.")
    run = RunOptions(overwrite=overwrite)
    # nothing is interpolated here, so any method that accepts all kinds of images may replace that of the parts
    method = find_method("nearest")
    job = ConversionJob(input or first.input, output, first.timing, method, first.decoding, first.encoding)
    with opened_clip(job, run) as clip:
        if input_identity(clip) != first.facts.get("input"):
            raise InputError(f"{clip.whole.info.name} is not the input of the parts; give that as `input`.")
        ready = prepare(job, run, clip)
        windows = [each.window for _, each in ordered if each.summary.frames_out and each.window is not None]
        window = replace(windows[0], end=windows[-1].end) if windows else None
        ready.output = replace(ready.output, window=window)
        summary = _summary(ordered)
        sink = ready.target.open(ready.output)
        (observer or SilentObserver()).opened(clip.source.info, summary.frames_out)
        with sink:
            files = [folder / file.name for folder, manifest in ordered for file in manifest.files]
            if isinstance(sink, VideoSink):
                traits = clip.whole.stream_info.traits or traits_of_image(
                    next(iter(clip.source)).pixels, clip.whole.stream_info.colours
                )
                sink.join([complete_chunk(file) for file in files], traits)
            elif isinstance(sink, ImageSink):
                sink.join(files)
        summary.remarks.take([*sink.remarks, *closing_remarks(ready, summary)])
    summary.seconds = time.perf_counter() - begin
    return summary


PartFiles = tuple[Path, Manifest]
"""Folder of a part, and its manifest."""


def find_parts(parts: Sequence[PathName]) -> list[Path]:
    """Return the folders of parts: those named, or those inside of a folder that holds them.

    Raises `OptionError` if none are named, and `InputError` for a path that is not a folder.
    """
    if not parts:
        raise OptionError("No parts are given; name their folders, or the folder that contains them.")
    folders: list[Path] = []
    for part in map(Path, parts):
        if not part.is_dir():
            raise InputError(f"{part} is not the folder of a part; name the folders that `chunk` has written.")
        inside = [] if (part / MANIFEST_NAME).exists() else sorted(part.glob(f"*/{MANIFEST_NAME}"))
        folders += [path.parent for path in inside] or [part]
    return folders


def check_complete(parts: Sequence[PartFiles]) -> list[PartFiles]:
    """Return the parts in order, after all checks.

    Raises
    ------
    InputError
        A part is missing, damaged or given twice, they belong to different jobs, or one does not begin where the part
        before ends.
    """
    by_number: dict[int, PartFiles] = {}
    (folder0, manifest0), *_ = parts
    for folder, manifest in parts:
        other = by_number.setdefault(manifest.part.number, (folder, manifest))[0]
        difference = first_difference(manifest0.facts, manifest.facts)
        count0 = manifest0.part.count
        count = manifest.part.count
        if other != folder:
            raise InputError(f"{other} and {folder} are both part {manifest.part}; name one of them.")
        if count != count0:
            raise InputError(
                f"{folder0} is one of {count0} parts and {folder} one of {count}; join parts of one conversion."
            )
        if difference:
            raise InputError(f"{folder0} and {folder} differ in their {difference}; make one of them again.")
    missing = [str(number) for number in range(1, manifest0.part.count + 1) if number not in by_number]
    if missing:
        some = ", ".join(missing[:8]) + (", ..." if len(missing) > 8 else "")
        raise InputError(
            f"Of {manifest0.part.count} parts, {some} {'is' if len(missing) == 1 else 'are'} missing; make them first."
        )
    ordered = [by_number[number] for number in sorted(by_number)]
    for folder, manifest in ordered:
        _check_files(folder, manifest)
    filled = [each for each in ordered if each[1].summary.frames_out]
    for (folder, manifest), (next_folder, following) in pairwise(filled):
        if not _fits(manifest, following):
            raise InputError(
                f"{next_folder} does not go on where {folder} ends, because {following.input} has damaged places "
                "before it; convert it in one run."
            )
    return ordered


def _fits(manifest: Manifest, following: Manifest) -> bool:
    """Return whether a part begins where the one before ends, by the boundary that both have recorded."""
    ends, begins = (each.summary.boundaries.get(following.first) for each in (manifest, following))
    if manifest.first + manifest.summary.frames_out != following.first or ends is None or begins is None:
        return False
    return ends.time == begins.time and (ends.number == begins.number or not manifest.counts_frames)


def _check_files(folder: Path, manifest: Manifest) -> None:
    """Raise `InputError` unless the files of a part are unchanged, by their sizes and hashes."""
    with explained(InputError, "read", folder, "make this part again"):
        names = {path.name for path in part_files(folder)} - {MANIFEST_NAME}
        expected = {file.name for file in manifest.files}
        if names != expected:
            name = min(names ^ expected)
            state = "is missing" if name in expected else "does not belong there"
            raise InputError(f"{folder / name} {state}; make part {manifest.part} again.")
        for file in manifest.files:
            if (folder / file.name).stat().st_size != file.size or stored(folder / file.name) != file:
                raise InputError(f"{folder / file.name} is damaged; make part {manifest.part} again.")


def _summary(parts: Sequence[PartFiles]) -> Summary:
    """Return the summary of the whole conversion: sums of the parts'."""
    summaries = [manifest.summary for _, manifest in parts]
    summary = Summary(frames_in=max(each.frames_in for each in summaries))
    intervals = [each.frame_intervals for each in summaries if each.frame_intervals.longest]
    if intervals:
        longest = max(intervals, key=lambda each: (each.longest, -each.begin))
        shortest = min(each.shortest for each in intervals)
        summary.frame_intervals = FrameIntervals(shortest, longest.longest, longest.begin)
    for each in summaries:
        summary.frames_out += each.frames_out
        summary.frames_made += each.frames_made
        summary.scene_cuts += each.scene_cuts
        summary.duplicates += each.duplicates
        summary.unsure_frames += each.unsure_frames
        summary.unsure_pixels += each.unsure_pixels
        summary.replaced += each.replaced
        summary.note_guides(each.guided_frames, each.guide_figures)
        summary.guides_missing += each.guides_missing
        summary.remarks.take(each.remarks)
        summary.note_match(each.lowest_match)
    return summary
