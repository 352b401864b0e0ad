"""Options of the command line alone; `fpsboost.cli.flags` makes flags of these and of all others.

Heavy modules are imported only when an option is used, so that --help need not wait for OpenCV and FFmpeg.
"""

from __future__ import annotations

import os
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal, get_args

import fpsboost
from fpsboost.cluster import ClusterOptions
from fpsboost.errors import OptionError
from fpsboost.io.video.decode_options import DecodeOptions
from fpsboost.io.video.encode_options import Encoding
from fpsboost.memory import MemoryLimit, parse_memory
from fpsboost.options import (
    LEAST_CONFIDENCE,
    AtCuts,
    Checked,
    Duplicates,
    MaskAs,
    Pattern,
    Range,
    Uncertain,
    given_in,
    one_of,
    option,
    words_of_options,
)
from fpsboost.render import ConventionName
from fpsboost.rerender import MergeOptions, PlanOptions
from fpsboost.run_options import RunOptions
from fpsboost.timing.options import Timing
from fpsboost.timing.position import Position, parse_positions

if TYPE_CHECKING:
    PathName = str
else:
    PathName = str | Path
"""Text that a shell completes to a file name: the parser tries the types in order, and any argument is a text."""


METHOD_KINDS = {
    "": ("nlm", "nlm-fast", "blend", "nearest"),
    'of the report "Image-based Reprojection Using a Non-local Means Algorithm"': (
        "nlm-exhaustive",
        "nlm-brute-force",
        "nlm-passes",
    ),
    "with --vectors": ("reproject-image", "reproject-scene"),
    "for comparison": ("dis", "farneback", "tvl1", "dis-warp", "tvl1-warp", "farneback-warp", "block"),
}
"""Methods by purpose, as the help lists them: those of `fpsboost.method_table`, which takes a second to import."""

METHODS = tuple(name for names in METHOD_KINDS.values() for name in names)
"""Names of all methods, which a shell completes."""

METHOD_HELP = (
    "Methods: "
    + "; ".join(f"{kind}: {', '.join(names)}".removeprefix(": ") for kind, names in METHOD_KINDS.items())
    + ".\nOptions of a method follow its name: nlm:fusion=plain,patch-radius=6."
)
"""Text above the options of methods in the help of a conversion."""


@dataclass(frozen=True)
class RenderedOptions(Checked):
    """Files that a renderer has written beside its images."""

    vectors: str | None = option(None, "Motion vectors of a renderer, one file per frame.", metavar="DIR")
    depth: str | None = option(None, "Depth of a renderer, for reproject-scene.", metavar="DIR")
    vector_convention: ConventionName = option("auto", "Vector convention: blender, nuke...", flag="vectors-as")

    @property
    def folder(self) -> fpsboost.VectorFolder | None:
        """Folder of motion vectors for methods that use them; None if no vectors are given."""
        return None if self.vectors is None else fpsboost.VectorFolder(self.vectors, self.depth, self.vector_convention)

    def of_clip(self, clip: str) -> RenderedOptions:
        """Return the options for one clip, whose name replaces ``{in}`` in the paths."""
        vectors, depth = (path and path.replace("{in}", clip) for path in (self.vectors, self.depth))
        return replace(self, vectors=vectors, depth=depth)


@dataclass(frozen=True)
class TuningOptions:
    """Some options of methods as flags: ``--patch-radius 6`` stands for ``--method nlm:patch-radius=6``.

    Fields are named like those of estimators and synthesizers. Values stay texts here, and are parsed and checked like
    the options after the name of a method. None keeps the method's own value.
    """

    patch_radius: str | None = option(None, "nlm*: patch radius, pixels.", metavar="N")
    v: str | None = option(None, "nlm*: similarity bandwidth, for colours from 0 to 1.", metavar="X")
    search_radius: str | None = option(None, "nlm-exhaustive: largest motion, pixels; else auto.", metavar="N")
    block_size: str | None = option(None, "block: block size, pixels.", metavar="N")
    search_range: str | None = option(None, "block: largest motion, pixels.", metavar="N")
    pattern: str | None = option(
        None, f"block: search pattern, {one_of(Pattern)}.", choices=get_args(Pattern), metavar="HOW"
    )

    def behind(self, method: str) -> str:
        """Return the text of a method with its own options, followed by those given as flags."""
        given = ",".join(f"{flag.removeprefix('--')}={value}" for flag, value in given_in(self))
        return f"{method}{',' if ':' in method else ':'}{given}" if given else method


@dataclass(frozen=True)
class MaskOptions(Checked):
    """Areas that stay as they are, or are interpolated as a layer."""

    mask: str | None = option(None, "Image, or one per frame: white stays (HUD, titles).", metavar="FILE")
    mask_as: MaskAs = option("keep", "Masked areas: keep, or layer that moves.")

    def object(self) -> fpsboost.Mask | None:
        """Return the mask; None if none is given."""
        return None if self.mask is None else fpsboost.Mask(self.mask, mask_as=self.mask_as)


@dataclass(frozen=True)
class MethodOptions:
    """Method of interpolation by name, and options that apply to all methods."""

    method: str = option(
        "nlm",
        "nlm, nlm-fast, blend...; --help lists all.",
        short="m",
        choices=METHODS,
    )
    match_grain: bool = option(False, "Add their neighbours' grain to interpolated frames.")
    uncertain: Uncertain = option("keep", f"If unsure: {one_of(Uncertain)}.")
    below: float = option(LEAST_CONFIDENCE, "Confidence limit of uncertain pixels.")
    masking: MaskOptions = MaskOptions()
    rendered: RenderedOptions = RenderedOptions()

    def interpolator(self, tuning: TuningOptions = TuningOptions()) -> fpsboost.Interpolator:
        """Return the interpolator of the method, with the flags of `tuning`.

        Raises `OptionError` for an unknown method or option, and for a method that lacks its vectors.
        """
        return replace(
            fpsboost.find_method(tuning.behind(self.method), self.rendered.folder),
            match_grain=self.match_grain,
            uncertain=self.uncertain,
            below=self.below,
            mask=self.masking.object(),
        )


@dataclass(frozen=True)
class CutOptions(Checked):
    """Options for detecting where scenes end, and for the frames shown there."""

    at_cuts: AtCuts = option("repeat", f"At a cut: {one_of(AtCuts)}.")
    cut_threshold: Annotated[float, Range(0, 1)] | None = option(
        None, "Similarity below which it is a cut: 0 to 1; else 0.5."
    )
    no_cuts: bool = option(False, "Treat the clip as one scene.")
    cuts: str | None = option(None, "Cut list: a time or frame per line, or PySceneDetect's.", metavar="FILE")

    def applied_to(self, interpolator: fpsboost.Interpolator) -> fpsboost.Interpolator:
        """Return an interpolator with these options for cuts.

        Reads the file of `cuts`.
        """
        from fpsboost.analysis.scene_cuts import read_cuts  # noqa: PLC0415

        policy = interpolator.cuts
        if self.no_cuts:
            policy = None
        elif self.cuts is not None:
            policy = read_cuts(self.cuts)
        elif self.cut_threshold is not None and isinstance(policy, fpsboost.CutDetector):
            policy = replace(policy, threshold=self.cut_threshold)
        return replace(interpolator, cuts=policy, at_cuts=self.at_cuts)


@dataclass(frozen=True)
class TrialOptions:
    """Estimate instead of a conversion."""

    dry_run: bool = option(False, "Write nothing; estimate output, losses, time and size.")


@dataclass(frozen=True)
class JoinOptions:
    """Options for joining the parts of a conversion."""

    input: str | None = option(None, "The input, if it was moved.", metavar="IN")
    overwrite: bool = option(False, "Replace an existing output.", short="y")


@dataclass(frozen=True)
class MessageOptions(Checked):
    """Options for messages and progress."""

    verbose: bool = option(False, "Print details, and a traceback on errors.")
    quiet: bool = option(False, "Print errors only.", short="q")
    progress: Literal["bar", "json"] = option("bar", "Progress as a bar, or as json lines.")

    @property
    def prints_text(self) -> bool:
        """Whether messages other than errors are printed as sentences."""
        return not self.quiet and self.progress == "bar"


@dataclass(frozen=True)
class HoldOutOptions:
    """Frames of a clip that a comparison shows to methods, and those that it hides and has interpolated."""

    range: str | None = option(None, "Frames A to B - 1, counted from 0; also A: or :B.", metavar="A:B")
    skip: int = option(1, "Hidden frames between two shown ones.")
    duplicates: Duplicates = option("interpolate", "Duplicates: interpolate (unscored) or keep.")


@dataclass(frozen=True)
class ComparedMethodOptions:
    """Methods, frames of other tools, and motion vectors of a comparison."""

    methods: tuple[str, ...] = option(
        ("nlm,nlm-fast,dis,block,minterpolate,blend",),
        "Methods of conversions, FFmpeg's minterpolate (block\n"
        "matching, as is block) or all, separated by commas,\n"
        "options after a colon: dis,nlm:patch-radius=9,v=0.05.\n"
        "Repeatable.",
        short="m",
        choices=(*METHODS, "minterpolate", "all"),
        metavar="NAMES",
    )
    frames_of: tuple[str, ...] = option(
        (),
        "Images of another tool: all frames in order, the hidden\n"
        "frames alone, or images with the clip's frame numbers,\n"
        "from 0. Repeatable.",
        flag="frames",
        metavar="NAME=DIR",
    )
    peer: tuple[str, ...] = option(
        (),
        "Command of another tool that doubles a folder of\n"
        "images: 'tool {in} {out}'; also {factor} and {fps}.\n"
        "Repeatable.",
        metavar="NAME=COMMAND",
    )
    rendered: RenderedOptions = RenderedOptions()


@dataclass(frozen=True)
class ResultOptions(Checked):
    """Metrics and output files of a comparison."""

    metrics: tuple[str, ...] = option(
        (),
        "Metrics beside PSNR, its 5th percentile (P5), SSIM,\n"
        "MAE, spurious and missing edges: flip, xpsnr, vmaf,\n"
        "psnr_hvs, mse, motion_smoothness, wrong, flicker,\n"
        "steps, psnr_div, with commas; see docs/comparison.md.",
        metavar="NAMES",
    )
    metric: tuple[str, ...] = option(
        (),
        "Command that scores images: NAME:lower='tool {truth}\n{made}', or NAME:higher=; see docs/comparison.md.",
        metavar="NAME=COMMAND",
    )
    report: str | None = option(None, "New folder for the page, index.html.", metavar="DIR")
    json: str | None = option(None, "New JSON file of all results; see docs/comparison.md.", metavar="FILE")
    csv: str | None = option(None, "New CSV file, a row for each method and frame.", metavar="FILE")
    fail_under: Annotated[float, Range(0, 120)] | None = option(
        None, "Exit with 3 if the first method's PSNR is lower.", metavar="DB"
    )
    quiet: bool = option(False, "Print errors only.", short="q")


@dataclass(frozen=True)
class PlannedMethodOptions:
    """Method whose interpolated frames `fpsboost plan` examines."""

    method: str = option("nlm", "Interpolation method.", short="m", choices=METHODS)
    rendered: RenderedOptions = RenderedOptions()
    quiet: bool = option(False, "Print errors only.", short="q")


@dataclass(frozen=True)
class PreviewOptions:
    """Passages, methods and files of a preview."""

    at: tuple[Position, ...] = option(
        (),
        "Start of a passage: 90s, 1:30.5, or frame 120f; else\nwhere motion is largest, or speed changes. Repeatable.",
        metavar="TIME",
        parse=parse_positions,
    )
    methods: tuple[str, ...] = option(
        ("nlm",), "As in compare: separated by commas, options after a\ncolon.", short="m", metavar="NAMES"
    )
    match_grain: bool = option(False, "Add their neighbours' grain to interpolated frames.")
    masking: MaskOptions = MaskOptions()
    side_by_side: str | None = option(None, "Write the passages, before and after, as a video too.", metavar="FILE")
    overwrite: bool = option(False, "Replace an existing page and video.", short="y")
    limit: MemoryLimit | None = option(
        None, "Refuse clips above this: 8G; else the free memory.", flag="max-memory", parse=parse_memory
    )
    threads: int | None = option(None, "Pairs of frames in parallel; else one per core.")
    quiet: bool = option(False, "Print errors only.", short="q")


conversion = (DecodeOptions, Timing, MethodOptions, CutOptions, Encoding, RunOptions, TuningOptions, ClusterOptions)
comparison = (HoldOutOptions, ComparedMethodOptions, ResultOptions)
others = (TrialOptions, MessageOptions, PlanOptions, PlannedMethodOptions, MergeOptions, JoinOptions, PreviewOptions)
option_classes = conversion + comparison + others
"""Classes of options of all commands, by which messages of the library find the flags of its fields."""


def command_line(input: str | os.PathLike[str], output: str | os.PathLike[str], *options: Any) -> list[str]:
    """Return the words of a conversion on the command line, with what differs from the defaults of options."""
    return ["fpsboost", os.fspath(input), os.fspath(output), *words_of_options(*options)]


def check_named_once(inputs: Sequence[str]) -> None:
    """Raise `OptionError` if two of several paths lead to the same file or folder."""
    places = [os.path.realpath(path) for path in inputs]
    for path, place in zip(inputs, places, strict=True):
        if places.count(place) > 1:
            raise OptionError(f"{path} is named twice; name it once.")
