"""Command `fpsboost preview`: converts some passages of a clip and shows them on a page."""

from __future__ import annotations

import shlex
from pathlib import Path
from typing import Annotated

from cyclopts import Group, Parameter
from rich.console import Console

from fpsboost.cli.compare import split_methods
from fpsboost.cli.flags import Cuts, Input, Reading, in_flags, with_flags
from fpsboost.cli.messages import console, literal, sentence
from fpsboost.cli.options import MethodOptions, PathName, PreviewOptions, command_line
from fpsboost.conflicts import check_together
from fpsboost.errors import OptionError
from fpsboost.io.new_output import write_whole
from fpsboost.io.opening import PIPES, Target
from fpsboost.media import check_writable
from fpsboost.preparation import ConversionJob, clip_name, output_beside
from fpsboost.run_options import RunOptions
from fpsboost.timing.options import Timing


@with_flags
def preview(
    input: Input,
    page: Annotated[PathName | None, Parameter(name="PAGE")] = None,
    /,
    *,
    options: Annotated[PreviewOptions, Group("Preview", sort_key=0)],
    decoding: Reading,
    timing: Annotated[Timing, Group("Rate", sort_key=1)],
    cuts: Cuts,
) -> None:
    """Show passages of a clip before and after, and estimate the time of the whole conversion.

    Parameters
    ----------
    input
        A video, an animation, a folder of images, or a pattern: shot_%04d.png, shot_####.png.
    page
        The page, an .html file; else IN-preview.html here.
    """
    from fpsboost.preview.page import estimate_sentence, make_page, write_video  # noqa: PLC0415
    from fpsboost.preview.page import preview as run  # noqa: PLC0415

    place = Path(page or f"{clip_name(input) or 'clip'}-preview.html")
    if input in PIPES:
        raise OptionError("Standard input can be read only once, and a preview reads several places; name a file.")
    check_together(timing.names_given() | {"a preview"})
    if place.suffix.lower() not in (".html", ".htm"):
        raise OptionError(f"{place} is not the name of an HTML page; write {place}.html.")
    check_writable(place, str(place), [Path(input)], options.overwrite)
    if options.side_by_side is not None:
        check_video(options.side_by_side, input, overwrite=options.overwrite)
    motions = [
        MethodOptions(text, options.match_grain, masking=options.masking) for text in split_methods(options.methods)
    ]
    methods = {motion.method: cuts.applied_to(motion.interpolator()) for motion in motions}
    output = output_beside(input, timing)
    job = ConversionJob(input, output, timing, next(iter(methods.values())), decoding)
    out = Console(highlight=False, soft_wrap=True, quiet=options.quiet)
    with console(quiet=options.quiet).status("reading") as status:
        run_options = RunOptions(limit=options.limit, threads=options.threads)
        result = run(job, methods, run_options, at=options.at, on_task=lambda task: status.update(literal(task)))
        status.update("writing the page")
        words = command_line(input, output, motions[0], decoding, timing, cuts)
        check_writable(place, str(place), overwrite=options.overwrite)  # once more: minutes have passed
        notes = [in_flags(remark) for remark in result.remarks]
        write_whole(place, make_page(result, shlex.join(words), notes).encode())
        if options.side_by_side is not None:
            write_video(options.side_by_side, result, overwrite=options.overwrite)
    for note in notes:
        out.print(f"Note: {literal(note)}")
    for name, seconds in result.seconds_per_frame.items():
        out.print(sentence(f"{name}: {estimate_sentence(result.frames, seconds)}"))
    if options.side_by_side is not None:
        out.print(f"Video: {literal(options.side_by_side)}")
    out.print(f"Page: {literal(str(place))}")


def check_video(path: str, input: str, *, overwrite: bool) -> None:
    """Raise an error if the video side by side cannot be written; called before any conversion."""
    if Target.parse(path).kind != "video":
        raise OptionError(
            f"`side_by_side` writes a video, and {path} is not the name of one; end it with .mp4 or .mkv."
        )
    check_writable(Path(path), path, [Path(input)], overwrite)
