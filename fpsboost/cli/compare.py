"""Command `fpsboost compare`: prints tables, and writes a report page and data files.

Methods are named with their options, and frames of other tools by folders and commands.
"""

from __future__ import annotations

import os
import sys
import tempfile
from collections.abc import Iterable, Sequence
from dataclasses import replace
from itertools import chain
from pathlib import Path
from statistics import fmean
from typing import Annotated, NamedTuple

from cyclopts import Group
from rich.console import Console
from rich.progress import BarColumn, Progress, TextColumn, TimeRemainingColumn
from rich.table import Column, Table

import fpsboost
from fpsboost import evaluation
from fpsboost.cli import messages
from fpsboost.cli.flags import Cuts, Further, Input, with_flags
from fpsboost.cli.messages import literal, sentence
from fpsboost.cli.options import (
    ComparedMethodOptions,
    CutOptions,
    HoldOutOptions,
    ResultOptions,
    check_named_once,
)
from fpsboost.conflicts import check_together
from fpsboost.errors import OptionError, choose_one
from fpsboost.io.new_output import check_new_folder
from fpsboost.io.video.decode_options import DecodeOptions
from fpsboost.media import check_writable, counted
from fpsboost.options import words_of_options

FIGURES = {
    "psnr": "PSNR",
    "psnr_p5": "P5",
    "ssim": "SSIM",
    "mae": "MAE",
    "spurious": "spurious",
    "missing": "missing",
    "cpu_seconds": "CPU s",
}
"""Headings of the first table, as many as 80 columns hold, by the names of the data."""

EXIT_BELOW_LIMIT = 3  # exit code of a comparison that ends below ``--fail-under``


frames_group = Group("Frames", sort_key=1)


@with_flags
def compare(
    input: Input,
    /,
    *more: Further,
    decoding: Annotated[DecodeOptions, frames_group],
    frames: Annotated[HoldOutOptions, frames_group],
    method_options: Annotated[ComparedMethodOptions, Group("Methods", sort_key=2)],
    at_cuts: Cuts,
    results: Annotated[ResultOptions, Group("Results", sort_key=3)],
) -> None:
    """Hide frames, interpolate them and score each method.

    Exit codes: 0 compared, 1 failed, 2 wrong usage or no method to compare, 3 below --fail-under.

    Parameters
    ----------
    input
        A video file, a folder of images, or a pattern: shot_%04d.png, shot_####.png.
        Several clips count equally in the mean.
    more
        Further ones.
    """
    from fpsboost.evaluation.compare import compare as run  # noqa: PLC0415

    console = Console(highlight=False, quiet=results.quiet)
    inputs = [input, *more]
    hold_out = evaluation.HoldOut(
        frames.skip, *evaluation.parse_range(frames.range or ":"), decoding, frames.duplicates
    )
    others = name_others(method_options.frames_of, method_options.peer)
    measuring = name_others((), (), results.metric)
    check_several(inputs, method_options, decoding)
    rendered = {clip: method_options.rendered.of_clip(clip) for clip in inputs}
    folders = {clip: each.folder and match_vectors(clip, each.folder) for clip, each in rendered.items()}
    chosen = {clip: choose(method_options.methods, folder, at_cuts, decoding.guide) for clip, folder in folders.items()}
    ours, skipped = chosen[input]
    asked = split_methods(method_options.methods)[0]
    if results.fail_under is not None and ours and asked in skipped:
        raise OptionError(f"--fail-under checks {asked}, which cannot be run here; name another method first.")
    metrics = choose_metrics(results.metrics, measuring)
    other_words = tuple(word for tool in (*others, *measuring) for word in (tool.option, tool.text))
    cuts = at_cuts.applied_to(fpsboost.find_method("nlm")).cuts
    check_results(results)
    for clip in more:  # the first one is opened below anyway
        next(hold_out.intervals(clip))
    compared = []
    with tempfile.TemporaryDirectory(prefix="fpsboost-") as scratch:  # the report shows frames that a peer wrote there
        for clip in inputs:
            with progress_bar(quiet=results.quiet) as bar:
                progress = Progressing(bar)
                ours, skipped = chosen[clip]
                compared_methods = dict(ours)
                for tool in others:
                    progress.begin(tool.name, None)
                    compared_methods[tool.name] = tool.compared(hold_out.intervals(clip), Path(scratch))
                comparison = run(
                    clip,
                    compared_methods,
                    hold_out,
                    progress,
                    skipped=skipped,
                    vectors=folders[clip],
                    cuts=cuts,
                    metrics=metrics,
                )
            words = words_of_options(rendered[clip]), words_of_options(at_cuts)
            comparison = replace(comparison, others=other_words, rendered=tuple(words[0]), cut_options=tuple(words[1]))
            compared.append(evaluation.ComparedClip(comparison, compared_methods))
            print_comparison(compared[-1], console)
        write_results(compared, results, console)
    if results.fail_under is not None:
        exit_if_below(results.fail_under, [clip.comparison for clip in compared])


def exit_if_below(limit: float, comparisons: Sequence[evaluation.Comparison]) -> None:
    """Exit with `EXIT_BELOW_LIMIT` if the mean PSNR of the first method is below a limit, dB."""
    first, psnr = next(iter(evaluation.psnr_of_clips(comparisons).items()))
    reached = fmean(psnr)
    if reached < limit:
        reason = f"{first} reaches {reached:.2f} dB, below the {limit:g} dB of --fail-under."
        messages.console().print(f"[red]fpsboost:[/] {literal(reason)}")
        sys.exit(EXIT_BELOW_LIMIT)


def print_comparison(clip: evaluation.ComparedClip, console: Console) -> None:
    """Print the advice first, then the tables, reasons and remarks of a comparison."""
    advice, *reasons = evaluation.judge(clip.comparison).sentences
    console.print(sentence(advice), style="bold", soft_wrap=True)
    for table in tables(clip.comparison):
        console.print(table)
    for line in [*reasons, *remarks(clip)]:
        console.print(sentence(line))


def write_results(compared: Sequence[evaluation.ComparedClip], results: ResultOptions, console: Console) -> None:
    """Print the means over several clips and what figures mean, and write the JSON, CSV and page that are asked for."""
    comparisons = [clip.comparison for clip in compared]
    if len(comparisons) > 1:
        advice, *reasons = evaluation.judge_all(comparisons)
        console.print(sentence(advice), style="bold", soft_wrap=True)
        names = ["mean", *(literal(Path(each.clip).name) for each in comparisons)]
        means = figure_table("PSNR", f"{len(comparisons)} clips", names, evaluation.mean_rows(comparisons))
        console.print(means, *map(sentence, reasons), sep="\n")
    console.print("PSNR in dB, P5 its 5th percentile; MAE in levels of 255; CPU s of a frame.")
    for metric in comparisons[0].metrics.values():
        console.print(sentence(metric.meaning))
    if results.json is not None:
        evaluation.write_json(Path(results.json), comparisons)
    if results.csv is not None:
        evaluation.write_csv(Path(results.csv), comparisons)
    if results.report is not None:
        from fpsboost.evaluation.report.page import write_report  # noqa: PLC0415 (the drawing code is slow to import)

        with Console(stderr=True, quiet=results.quiet).status("writing the page"):
            page = write_report(Path(results.report), compared)
        console.print(f"Page: {literal(str(page))}", soft_wrap=True)


def check_several(inputs: Sequence[str], method_options: ComparedMethodOptions, decoding: DecodeOptions) -> None:
    """Raise `OptionError` if there are several clips and an option is about one, or one is named twice."""
    if len(inputs) == 1:
        check_together({f"guide={decoding.guide!r}"})
        return
    check_together(decoding.names_given() | {"several inputs"})
    rendered = filter(None, (method_options.rendered.vectors, method_options.rendered.depth))
    check_together({"several inputs", "frames_of" if method_options.frames_of else "methods"})
    if any("{in}" not in path for path in rendered):
        raise OptionError(
            "--vectors and --depth belong to one clip; with several, write {in} for it, as in {in}/vectors."
        )
    check_named_once(inputs)


def match_vectors(clip: str, vectors: fpsboost.VectorFolder) -> fpsboost.VectorFolder:
    """Match a renderer's vectors with the frames of a clip by number if both have numbers."""
    from fpsboost.io.images.source import find_numbers  # noqa: PLC0415

    numbers = find_numbers(clip)
    return vectors if numbers is None else vectors.matched(numbers, must_match=numbers.step > 1)


def check_results(results: ResultOptions) -> None:
    """Raise an error if a file or the page cannot be written, or if one lies in the place of another."""
    taken = set[Path]()
    for path in filter(None, (results.report, results.json, results.csv)):
        if path == results.report:
            check_new_folder(Path(path))
        else:
            check_writable(Path(path), path)
        place = Path(os.path.realpath(path))
        if {place, place.parent} & taken:
            raise OptionError(f"{path} is already the path of another result; choose another one.")
        taken.add(place)


def tables(comparison: evaluation.Comparison) -> list[Table]:
    """Return tables, best method first: overall figures; errors by area, if one is large enough; further metrics."""
    title = f"{literal(comparison.clip)}: {counted(len(comparison.hidden), 'frame')} of {comparison.kind}"
    columns = {name: evaluation.COLUMNS[name] for name in FIGURES}
    all_tables = [figure_table("method", title, FIGURES.values(), evaluation.named_rows(comparison, columns))]
    if comparison.areas:
        areas = chain.from_iterable(comparison.areas)
        all_tables.append(figure_table("MAE", "where the errors are", areas, evaluation.area_rows(comparison)))
    if further := evaluation.further_columns(comparison):
        titles = [column.title for column in further.values()]
        all_tables.append(figure_table("method", "further metrics", titles, evaluation.named_rows(comparison, further)))
    return all_tables


def figure_table(name: str, title: str, figures: Iterable[str], rows: Sequence[evaluation.Row]) -> Table:
    """Return a table with a row for each method, the first one highlighted if there are several."""
    columns = (Column(figure, justify="right", overflow="fold") for figure in figures)
    table = Table(Column(name, overflow="fold"), *columns, title=title)
    for place, row in enumerate(rows):
        style = "bold green" if place == 0 and len(rows) > 1 else ""
        table.add_row(
            "\n".join(map(literal, evaluation.break_name(row.name))), *(cell.text for cell in row.cells), style=style
        )
    return table


def remarks(clip: evaluation.ComparedClip) -> list[str]:
    """Return the remarks below the tables."""
    comparison = clip.comparison
    shares = ", ".join(f"{name} {100 * share:.0f} %" for name, share in comparison.shares.items())
    lines = [f"Of the picture: {shares}."]
    if comparison.cuts:
        are = "is" if len(comparison.cuts) == 1 else "are"
        lines.append(f"Note: {counted(len(comparison.cuts), 'frame')} across a scene cut {are} not counted.")
    lines += [f"Note: {note}" for note in clip.notes()]
    lines += [f"Note: {name} was skipped, {reason}." for name, reason in comparison.skipped.items()]
    return lines


def progress_bar(*, quiet: bool) -> Progress:
    """Return a progress display that is seen on a terminal, unless `quiet`, and gone at the end."""
    console = Console(stderr=True)
    columns = TextColumn("{task.description}"), BarColumn(), TextColumn("{task.completed} frames")
    hidden = quiet or not console.is_terminal
    return Progress(*columns, TimeRemainingColumn(compact=True), console=console, transient=True, disable=hidden)


class Progressing:
    """Progress display of a long run: the current task, a bar and the time left."""

    def __init__(self, progress: Progress) -> None:
        self._progress = progress

    def begin(self, name: str, frames: int | None) -> None:
        """Show a new task of so many frames; None if their number is unknown."""
        self._task = self._progress.add_task(literal(name), total=frames)

    def advance(self) -> None:
        """Count a frame of the current task."""
        self._progress.advance(self._task)


def split_methods(texts: Sequence[str]) -> list[str]:
    """Split ``--methods`` into methods with their options, as `fpsboost.method_table.split_method` reads them.

    No name contains an equals sign and every option does, so commas can separate both methods and options.
    """
    methods: list[str] = []
    for text in texts:
        for place, part in enumerate(word.strip() for word in text.split(",")):
            name = part.partition(":")[0]
            if "=" in name:  # an option of the method before
                if place == 0 or ":" not in methods[-1]:
                    raise OptionError(f"{part!r} follows no method name; write METHOD:{part}.")
                methods[-1] += f",{part}"
            elif not name:
                raise OptionError(f"--methods {text!r} lacks a name; write names with commas between them.")
            else:
                methods.append(part)
    return methods


def choose(
    texts: Sequence[str],
    vectors: fpsboost.VectorFolder | None,
    cuts: CutOptions = CutOptions(),
    guide: object = None,
) -> tuple[dict[str, evaluation.ComparedMethod], dict[str, str]]:
    """Return the methods of ``--methods`` by name, and the reasons why others are skipped.

    With a guide, the first method of this package comes once more, following guides: ``nlm+guide``.

    Raises `OptionError` for an unknown method or option.
    """
    from fpsboost.method_table import (  # noqa: PLC0415
        may_use_vectors,
        split_method,
        vector_methods,
    )

    names = evaluation.method_names()
    compared_methods: dict[str, evaluation.ComparedMethod] = {}
    skipped: dict[str, str] = {}
    for method in split_methods(texts):
        for text in names if method == "all" else [method]:
            name, options = split_method(text)
            if name not in names:
                raise OptionError(
                    f"There is no method {name!r}; {choose_one(name, [*names, 'all'])} "
                    "Other tools are given by --peer or --frames."
                )
            if name in vector_methods and vectors is None:
                skipped[text] = "it needs the renderer's motion vectors (--vectors)"
            elif name == evaluation.MINTERPOLATE:
                compared_methods[text] = evaluation.Minterpolate.with_options(options)
            else:
                takes_vectors = name in vector_methods or may_use_vectors(fpsboost.methods[name])
                method_of_text = fpsboost.find_method(text, vectors if takes_vectors else None)
                ours = evaluation.ComparedInterpolator(cuts.applied_to(method_of_text))
                compared_methods[text] = ours
                if guide is not None:
                    compared_methods[text.replace(name, f"{name}+guide", 1)] = replace(ours, follows_guides=True)
                    guide = None  # the first one alone
    return compared_methods, skipped


def choose_metrics(names: Sequence[str], tools: Sequence[OtherTool]) -> dict[str, evaluation.Metric]:
    """Return the metrics of ``--metrics`` and of ``--metric`` by name."""
    metrics = evaluation.choose_metrics(names)
    for tool in tools:
        high_is_good = tool.better == ":higher"
        metrics[tool.name] = evaluation.command_metric(tool.name, tool.value, high_is_good=high_is_good)
    return metrics


class OtherTool(NamedTuple):
    """Another tool of a comparison, which makes frames or measures them, by its option of the command line."""

    option: str
    """``--frames``, ``--peer`` or ``--metric``."""
    name: str
    value: str
    """Folder of its frames, or its command."""
    better: str
    """``:lower`` or ``:higher`` if it measures frames, whichever is better; else empty."""
    text: str
    """The option's text as it was given."""

    def compared(self, intervals: Iterable[evaluation.Interval], scratch: Path) -> evaluation.ComparedMethod:
        """Return the tool as a method: a folder matched with a clip, or a command, after running it.

        A command writes its frames to a folder in `scratch`, which must last as long as the method.
        """
        if self.option == "--frames":
            return evaluation.find_frames(self.name, Path(self.value), intervals)
        return evaluation.run_peer(self.name, self.value, intervals, Path(tempfile.mkdtemp(dir=scratch)))


def name_others(frames: Sequence[str], peers: Sequence[str], metrics: Sequence[str] = ()) -> list[OtherTool]:
    """Parse ``--frames NAME=FOLDER``, ``--peer NAME=COMMAND`` and ``--metric NAME:lower=COMMAND``."""
    others = list[OtherTool]()
    taken = {*evaluation.method_names(), "all", "truth"}
    for option, usage, texts in (
        ("--frames", "NAME=FOLDER", frames),
        ("--peer", "NAME='COMMAND {in} {out}'", peers),
        ("--metric", "NAME:lower='COMMAND {truth} {made}', or NAME:higher=", metrics),
    ):
        for text in texts:
            about, _, value = (word.strip() for word in text.partition("="))
            name = about.removesuffix(":lower").removesuffix(":higher")
            if not (name and value) or (name == about) == (option == "--metric"):
                raise OptionError(f"{option} {text!r} lacks a name or another part; write {option} {usage}.")
            if name in taken or ":" in name:
                raise OptionError(f"{option} {name!r} is the name of another method; choose a different name.")
            if option == "--peer":
                evaluation.split_command("peer", name, value, evaluation.PLACEHOLDERS)
            taken.add(name)
            others.append(OtherTool(option, name, value, about.removeprefix(name), text))
    return others
