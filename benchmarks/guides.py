"""How good are frames that a guide helps to make: ``python benchmarks/guides.py CLIPS --kinds 'area4,area4*'``.

A guide is a cheap picture of the frame in between. Every second frame (``--factor 4``: three of four) is hidden, made
by `nlm` as a conversion makes it, and once more with a guide, which is made of the hidden frame itself. A kind of
guides with * behind its name has guides of the key frames, too. The README of this folder lists the kinds.

``--frames one`` makes one frame of each clip, of its two key frames alone. With ``--cache DIR``, frames, their scores
without a guide, and guides are computed once: a later run takes the time of the guided synthesis and of the scores.
"""

from __future__ import annotations

import argparse
import json
import os
import sys
import time
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass
from fractions import Fraction
from functools import partial
from itertools import pairwise
from pathlib import Path
from typing import Any, NamedTuple

import cv2
import numpy as np
from guide_kinds import CODECS, OTHER_PICTURES, PICTURES, MakeGuides, Material, enlarged, kinds_of_clip
from guide_scenes import DRAWN_KINDS, EXPOSED_KINDS, RENDERED_KINDS, drawn_scenes, rendered_scenes
from rich.console import Console
from rich.table import Table
from scoring import SAMPLE, find_clips, one_thread, read_frames, wide_console

from fpsboost import methods
from fpsboost.errors import FpsboostError, InputError
from fpsboost.evaluation.export import without_nan
from fpsboost.evaluation.results import means, score
from fpsboost.evaluation.steadiness import missing_edges, spurious_edges, wrong_area
from fpsboost.frame_cache import FrameCache, SourcePosition
from fpsboost.image import Image, view
from fpsboost.pair import with_neighbours
from fpsboost.synthesis import InterpolatedImage
from fpsboost.synthesis.guided import GuidedPair, GuideFindings, describe_findings

Figures = dict[str, float]

METHOD = "nlm"
PROBE_LENGTH = 13
"""Frames of a clip among which the one of ``--frames one`` is chosen."""
WORSE = 0.2
"""Loss that counts as worse than without a guide, dB."""
USUAL_PIXELS = 640 * 360
"""Size of frame for which CPU time is given."""
EQUAL = 120.0
"""PSNR of equal frames, dB."""
USUAL_KINDS = "area2,area4,area4*,area8,noise20,noise40,jpeg10*,tone*,tone4*"


class Hidden(NamedTuple):
    """A hidden frame between two key frames, all by their numbers."""

    number: int
    key0: int
    key1: int

    @property
    def t(self) -> Fraction:
        """Its place in time between the two."""
        return Fraction(self.number - self.key0, self.key1 - self.key0)


@dataclass(frozen=True)
class Shot:
    """What is the same for all kinds of guides: frames by their numbers, and those made without a guide."""

    hidden: list[Hidden]
    frames: dict[int, Image]
    made: dict[int, InterpolatedImage]
    scores: dict[int, Figures]
    """Scores of the frames made without a guide."""


@dataclass(frozen=True)
class Hiding:
    """Which frames are hidden, and where results that are the same every time are kept."""

    factor: int
    only_one: bool
    length: int
    quick: bool
    cache: Path | None

    def cached(self, name: str, compute: Callable[[], dict[str, Any]]) -> dict[str, Any]:
        """Return named arrays from the folder of the cache, or compute them."""
        if self.cache is None:
            return compute()
        path = self.cache / f"{name.replace('/', '_')}-{'one' if self.only_one else self.length}-{self.factor}.npz"
        if path.exists():
            with np.load(path) as stored:
                return dict(stored)
        found = compute()
        self.cache.mkdir(parents=True, exist_ok=True)
        unfinished = path.with_suffix(f".{os.getpid()}.npz")
        np.savez(unfinished, **found)
        unfinished.replace(path)
        return found

    def intervals(self, count: int) -> list[list[Hidden]]:
        """Return the hidden frames between every two key frames of a clip."""
        if self.only_one:
            key0 = middle_key(count, self.factor)
            return [[Hidden(key0 + self.factor // 2, key0, key0 + self.factor)]]
        keys = range(0, count, self.factor)
        return [[Hidden(number, *each) for number in range(each[0] + 1, each[1])] for each in pairwise(keys)]

    def seeds(self, shot: Shot, *, with_keys: bool) -> dict[int, int]:
        """Return a seed for the noise of each guide."""
        seeds = {each.number: each.number for each in shot.hidden}
        if with_keys and self.only_one:
            (each,) = shot.hidden
            seeds |= {each.key0: each.number + 100, each.key1: each.number + 200}
        elif with_keys:
            seeds |= {number: number for each in shot.hidden for number in (each.key0, each.key1)}
        return seeds


def middle_key(count: int, factor: int) -> int:
    """Return the number of the key frame before a frame near the middle of a clip."""
    return (min(count, PROBE_LENGTH) // 2 - 1) // 2 * 2 // factor * factor


def psnr(truth: Image, image: Image) -> float:
    """Return the PSNR as `score` has it, dB, without its other figures, which take longer."""
    return min(float(cv2.PSNR(truth, image)), EQUAL)


def score_image(truth: Image, image: Image, *, quick: bool) -> Figures:
    """Return the scores of an image against the true one."""
    if quick:
        return {"psnr": psnr(truth, image)}
    return {
        **asdict(score(truth, image)),
        "wrong": wrong_area(truth, image),
        "spurious": spurious_edges(truth, image),
        "missing": missing_edges(truth, image),
    }


def prepare(material: Material, hiding: Hiding) -> Shot:
    """Read a clip, hide frames, and make them without a guide."""

    def compute() -> dict[str, Any]:
        frames = material.read(PROBE_LENGTH if hiding.only_one else hiding.length)
        found: dict[str, Any] = {}
        for hidden, image, confidence in make_ordinary(frames, hiding.intervals(len(frames))):
            scores = score_image(frames[hidden.number], image, quick=False)
            found |= {f"made {hidden.number}": image, f"confidence {hidden.number}": confidence}
            found |= {f"frame {number}": frames[number] for number in hidden}
            found[f"hidden {hidden.number}"] = np.array([hidden.key0, hidden.key1])
            found[f"scores {hidden.number}"] = np.array(json.dumps(scores))
        return found

    stored = hiding.cached(material.name, compute)
    named = [key.split() for key in stored]
    numbers = [int(number) for what, number in named if what == "hidden"]
    return Shot(
        [Hidden(number, *map(int, stored[f"hidden {number}"])) for number in numbers],
        {int(number): stored[f"frame {number}"] for what, number in named if what == "frame"},
        {n: InterpolatedImage(stored[f"made {n}"], stored[f"confidence {n}"]) for n in numbers},
        {number: json.loads(str(stored[f"scores {number}"])) for number in numbers},
    )


def make_ordinary(
    frames: Sequence[Image], intervals: Sequence[Sequence[Hidden]]
) -> Iterator[tuple[Hidden, Image, np.ndarray]]:
    """Yield hidden frames as they are made without a guide, and their confidence; none across a scene cut."""
    method = methods[METHOD]
    keys = sorted({number for hidden in intervals for each in hidden for number in each[1:]})
    caches = [FrameCache(frames[n], None, position_of(n)) for n in keys if n < len(frames)]
    pairs = [method.pair(*each) for each in pairwise(caches)]
    for hidden, pair in zip(intervals, with_neighbours(pairs), strict=False):
        if not pair.is_discontinuous:
            made = method.images(pair, [each.t for each in hidden], with_confidence=True)
            for each, (image, confidence) in zip(hidden, made, strict=True):
                yield each, view(image).array(), confidence
        pair.release_caches()


class Guides(NamedTuple):
    """Guides by the numbers of their frames, and the scores of those of hidden frames, each enlarged."""

    pictures: dict[int, Image]
    alone: dict[int, Figures]


def prepare_guides(material: Material, shot: Shot, kind: str, hiding: Hiding) -> Guides:
    """Make the guides of a kind."""
    way, with_keys = kind.removesuffix("*"), kind.endswith("*")
    seeds = hiding.seeds(shot, with_keys=with_keys)

    def compute() -> dict[str, Any]:
        guides = material.kinds[way](shot.frames, seeds)
        alone = {}
        for number in shot.made:
            frame = shot.frames[number]
            alone[number] = {"psnr": psnr(frame, enlarged(guides[number], frame))}
        return {**{str(number): guide for number, guide in guides.items()}, "alone": np.array(json.dumps(alone))}

    name = f"{material.name}-{kind.replace('*', '-keys')}"
    stored = compute() if way in material.read_from_files else hiding.cached(name, compute)
    alone = json.loads(str(stored.pop("alone")))
    return Guides({int(n): guide for n, guide in stored.items()}, {int(n): row for n, row in alone.items()})


def measure_kind(material: Material, shot: Shot, kind: str, hiding: Hiding) -> dict[str, Any]:
    """Make the hidden frames of a clip with guides of a kind, and score them: means over the frames."""
    guides = prepare_guides(material, shot, kind, hiding)
    caches: dict[int, FrameCache] = {}
    rows, findings = list[Figures](), list[Figures]()
    for hidden in shot.hidden:
        # as in a conversion, a key frame is prepared once for all guides, and forgotten after its second pair
        caches = {n: caches.get(n) or FrameCache(shot.frames[n], None, position_of(n)) for n in hidden[1:]}
        guided, told, seconds = follow(caches[hidden.key0], caches[hidden.key1], hidden, shot, guides)
        truth = shot.frames[hidden.number]
        row = {
            "ordinary": shot.scores[hidden.number]["psnr"],
            "alone": guides.alone[hidden.number]["psnr"],
            "cpu": seconds * USUAL_PIXELS / (truth.shape[0] * truth.shape[1]),
            "confidence": float("nan") if guided.confidence is None else float(np.mean(guided.confidence)),
        }
        image = view(guided.image).array()
        findings.append(told._asdict())
        rows.append({**row, **score_image(truth, image, quick=hiding.quick)})
    return {
        **means(rows),
        "findings": means(findings),
    }


def position_of(number: int) -> SourcePosition:
    """Return the position of a frame in a clip with one frame a second."""
    return SourcePosition(number, Fraction(number))


def follow(
    image0: FrameCache, image1: FrameCache, hidden: Hidden, shot: Shot, guides: Guides
) -> tuple[InterpolatedImage, GuideFindings, float]:
    """Return a hidden frame as it is made with its guide, what that tells, and the CPU seconds."""
    for image, number in ((image0, hidden.key0), (image1, hidden.key1)):
        image.guide = guides.pictures.get(number)
    begin = time.process_time()
    made = shot.made[hidden.number]
    image, told = GuidedPair(image0, image1).follow(made, guides.pictures[hidden.number], float(hidden.t))
    return image, told, time.process_time() - begin


def measure_material(material: Material, kinds: Sequence[str], hiding: Hiding) -> dict[str, dict[str, Any]]:
    """Return the figures of a clip by kind of guide; "none" are those without."""
    shot = prepare(material, hiding)
    if not shot.hidden:
        print(f"{material.name}: nothing to hide between frames of one scene.", file=sys.stderr)
        return {}
    found: dict[str, dict[str, Any]] = {"none": means(list(shot.scores.values()))}
    for kind in kinds:
        if kind.removesuffix("*") in material.kinds:  # a clip may lack own guides
            found[kind] = measure_kind(material, shot, kind, hiding)
    decibels = (f"{kind} {row['psnr']:.2f}" for kind, row in found.items())
    print(material.name, *decibels, file=sys.stderr, flush=True)
    return found


def summarise(kind: str, clips: Mapping[str, Mapping[str, Any]]) -> dict[str, Any]:
    """Return the means of a kind over its clips, and which clips are worse than without a guide."""
    rows = [{key: value for key, value in row.items() if isinstance(value, float)} for row in clips.values()]
    found: dict[str, Any] = means(rows)
    if kind == "none":
        return found
    gains = {name: row["psnr"] - row["ordinary"] for name, row in clips.items()}
    return {
        **found,
        "worse": {name: gains[name] for name in sorted(gains, key=gains.__getitem__) if gains[name] < -WORSE},
        "findings": means([row["findings"] for row in clips.values()]),
    }


def table_of(title: str, summaries: Mapping[str, Mapping[str, Any]]) -> Table:
    """Return a table with a row for every kind."""
    titles = ("alone, dB", "ordinary", "guided", "SSIM", "wrong", "spurious", "missing", "worse", "CPU, s")
    table = Table("guide", title=title, box=None)
    for each in titles:
        table.add_column(each, justify="right")

    def text(row: Mapping[str, Any], name: str, digits: int = 2) -> str:
        value = row.get(name, float("nan"))
        return f"{value:.{digits}f}" if np.isfinite(value) else ""

    for kind, row in summaries.items():
        is_none = kind == "none"
        worse = row.get("worse", {})
        table.add_row(
            kind,
            "" if kind.removesuffix("*") in OTHER_PICTURES else text(row, "alone"),
            text(row, "psnr" if is_none else "ordinary"),
            "" if is_none else text(row, "psnr"),
            text(row, "ssim", 4),
            *(text(row, name) for name in ("wrong", "spurious", "missing")),
            "" if is_none else f"{len(worse)}" + (f" ({min(worse.values()):.1f})" if worse else ""),
            text(row, "cpu", 3),
        )
    return table


def measure(kinds: Sequence[str], materials: Iterable[Material], hiding: Hiding) -> dict[str, dict[str, Any]]:
    """Return the figures by kind and clip."""
    found: dict[str, dict[str, Any]] = {kind: {} for kind in ("none", *kinds)}
    for material in materials:
        for kind, row in measure_material(material, kinds, hiding).items():
            found[kind][material.name] = row
    return found


def clips_of(paths: Sequence[str], own: Mapping[str, Path]) -> Iterator[Material]:
    """Yield clips with the kinds of guides that can be made of their frames, and own ones."""
    for name, path in find_clips(paths or [str(SAMPLE)]).items():
        read = partial(read_frames, path)
        folders = {kind: folder / name for kind, folder in own.items() if (folder / name).is_dir()}
        own_kinds = {kind: read_guides(each) for kind, each in folders.items()}
        yield Material(name, read, kinds_of_clip(read) | own_kinds, frozenset(own_kinds))


def read_guides(folder: Path) -> MakeGuides:
    """Return a function that reads guides from a folder, which has one for every frame of the clip."""

    def make(frames: Mapping[int, Image], seeds: Mapping[int, int]) -> dict[int, Image]:
        guides = read_frames(str(folder), max(seeds) + 1)
        if len(guides) <= max(seeds):
            raise InputError(f"{folder} has {len(guides)} guides; it needs one for every frame of the clip.")
        return {number: guides[number] for number in seeds}

    return make


def parse_own(texts: Sequence[str]) -> dict[str, Path]:
    """Parse ``NAME=FOLDER``."""
    own = {}
    for text in texts:
        name, equals, folder = text.partition("=")
        if not (name and equals and Path(folder).is_dir()):
            raise InputError(f"--guides {text!r} is not NAME=FOLDER with a folder that exists; correct it.")
        own[name] = Path(folder)
    return own


def choose_kinds(text: str, known: Sequence[str]) -> list[str]:
    """Return the kinds of a list; ``all`` is each without and with guides of the key frames."""
    kinds = []
    for kind in (each.strip() for each in text.split(",")):
        kinds += [name + star for name in known for star in ("", "*")] if kind == "all" else [kind]
    for kind in kinds:
        if kind.removesuffix("*") not in known:
            raise InputError(f"There is no kind of guide {kind!r}; --kinds takes {', '.join(known)}, all.")
    return list(dict.fromkeys(kinds))


def groups_of(options: argparse.Namespace) -> Iterator[tuple[str, list[str], Iterable[Material]]]:
    """Yield clips that have the same kinds of guides, with their title and the kinds that are asked for."""
    own = parse_own(options.guides)
    groups: list[tuple[str, Sequence[str], Iterable[Material]]] = [
        ("Clips", [*PICTURES, *CODECS, *own], clips_of(options.clips, own)),
        ("Drawn scenes", DRAWN_KINDS, drawn_scenes(are_exposed=False)),
        ("Drawn scenes with motion blur", EXPOSED_KINDS, drawn_scenes(are_exposed=True)),
    ]
    kinds = choose_kinds(options.kinds, [kind for _, known, _ in groups for kind in known])
    for title, known, materials in groups:
        chosen = [kind for kind in kinds if kind.removesuffix("*") in known]
        if chosen:
            yield title, chosen, materials
    if options.renders:
        yield "Path-traced scenes", [name + star for name in RENDERED_KINDS for star in ("", "*")], rendered_scenes()


def print_findings(summaries: Mapping[str, Mapping[str, Any]], console: Console) -> None:
    """Print in words what was found of the guides of each kind."""
    for kind, row in summaries.items():
        if row.get("findings"):
            console.print(f"{kind}: {describe_findings(row['findings'])}", highlight=False, markup=False)


def show(title: str, found: Mapping[str, Mapping[str, Any]], console: Console) -> dict[str, dict[str, Any]]:
    """Print the table of a group, and which clips are worse or refused; return the means."""
    summaries = {kind: summarise(kind, clips) for kind, clips in found.items() if clips}
    count = max((len(clips) for clips in found.values()), default=0)
    console.print(table_of(f"{title}: {count}", summaries))
    print_findings(summaries, console)
    for kind, row in summaries.items():
        if row.get("worse"):
            listed = ", ".join(f"{name} {gain:.2f}" for name, gain in row["worse"].items())
            console.print(f"{kind}, worse than without: {listed}", highlight=False)
    return summaries


def main() -> None:
    """Print the tables, and write JSON if asked."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("clips", nargs="*", metavar="CLIPS", help="videos, folders of images, or folders of these")
    parser.add_argument("--kinds", default=USUAL_KINDS, help="separated by commas, or all (default: %(default)s)")
    parser.add_argument("--factor", type=int, choices=(2, 4), default=2, help="(default: %(default)s)")
    parser.add_argument("--frames", choices=("all", "one"), default="all", help="all hidden frames, or one of a clip")
    parser.add_argument("--length", type=int, default=25, help="frames of a clip at most (default: %(default)s)")
    parser.add_argument("--guides", action="append", default=[], metavar="NAME=FOLDER", help="own guides of the clips")
    parser.add_argument("--renders", action="store_true", help="also path-traced scenes, by Mitsuba")
    parser.add_argument("--quick", action="store_true", help="PSNR alone")
    parser.add_argument("--cache", type=Path, metavar="DIR", help="folder for what is the same every time")
    parser.add_argument("--json", type=Path)
    options = parser.parse_args()
    one_thread()
    hiding = Hiding(options.factor, options.frames == "one", options.length, options.quick, options.cache)
    console = wide_console()
    written: dict[str, Any] = {}
    try:
        for title, kinds, materials in groups_of(options):
            found = measure(kinds, materials, hiding)
            written[title] = {"means": show(title, found, console), "clips": found}
    except FpsboostError as error:
        raise SystemExit(str(error)) from error
    if options.json:
        options.json.write_text(json.dumps(without_nan(written), indent=1) + "\n")


if __name__ == "__main__":
    main()
