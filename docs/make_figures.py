"""Draw the figures of the documentation: ``python docs/make_figures.py``, into ``docs/figures/``.

Everything is computed by the package from this project's own samples (``samples/``). Needs an installed fpsboost; takes
about half a minute.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import replace
from fractions import Fraction
from itertools import pairwise
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, NamedTuple
from unittest import mock

import av
import cv2
import numpy as np
from make_gallery import labelled, save_animation, side_by_side
from matplotlib import rc_context
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from numpy.typing import NDArray
from PIL import Image

from fpsboost import CutDetector, Interpolator, Mask, interpolate_clip, methods
from fpsboost.analysis.duplicates import SourceFrame
from fpsboost.colour import colour_components
from fpsboost.evaluation.report.pictures import in_colour
from fpsboost.frame import Frame
from fpsboost.frame_cache import FrameCache
from fpsboost.kernels.constants import WINDOW
from fpsboost.motion import nlm
from fpsboost.motion.components import contrast_components
from fpsboost.pages import as_heat
from fpsboost.pair import Pair
from fpsboost.render.folder import VectorFolder
from fpsboost.repair import find_damaged
from fpsboost.synthesis import FramePair
from fpsboost.synthesis.multi_hypothesis import BlendInput, Candidates, MultiHypothesis
from fpsboost.timing.retime import parse_curve

Picture = NDArray[Any]
"""(H, W) or (H, W, 3) uint8, BGR."""

ROOT = Path(__file__).parents[1]
SAMPLES, FIGURES = ROOT / "samples", ROOT / "docs" / "figures"

GAP, LINE, TEXT = 12, 20, 12
"""Between panels, of a line of text, and its size, pixels."""

SVG = {"svg.fonttype": "none", "svg.hashsalt": "fpsboost", "font.family": "sans-serif"}
"""Settings of charts: text as text, and the same file every time."""


class Panel(NamedTuple):
    """A picture and what stands above it."""

    title: str
    picture: Picture


def main() -> None:
    """Draw all figures, and print the size of each file."""
    FIGURES.mkdir(exist_ok=True)
    for draw in (
        draw_before_and_after, draw_motion, draw_similarity, draw_choice, draw_residual_search, draw_candidates,
        draw_confidence, draw_cut, draw_repair, draw_arrays, draw_loop,
        draw_turning, draw_mask, draw_retime,
    ):  # fmt: skip
        path = draw()
        print(f"{path.relative_to(ROOT)}: {path.stat().st_size / 1000:.0f} kB")


# ------------------------------------------------------------------------------------------------------------- material


def clip() -> list[Picture]:
    """Read the frames of the sample clip."""
    with av.open(str(SAMPLES / "orbit.mp4")) as container:
        return [frame.to_ndarray(format="bgr24") for frame in container.decode(video=0)]


def scene(name: str, *numbers: int) -> list[Picture]:
    """Read frames of a rendered scene."""
    frames = [cv2.imread(str(SAMPLES / "scenes" / name / f"{number:04d}.png")) for number in numbers]
    assert all(frame is not None for frame in frames)
    return frames


def prepared(frames: Sequence[Picture]) -> list[FrameCache]:
    """Return frames in the caches that estimators take."""
    return [FrameCache(frame) for frame in frames]


def middle_pair(method: Interpolator, frames: Sequence[Picture]) -> tuple[Pair, Pair, Pair]:
    """Return the three pairs of four successive frames: before, middle and after."""
    images = prepared(frames)
    before, pair, after = (method.pair(*images[k : k + 2]) for k in range(3))
    return before, pair, after


def made_between(frames: Sequence[Picture]) -> Picture:
    """Return the frame that the default method makes half-way between the second and the third of four frames."""
    method = methods["nlm"]
    before, pair, after = middle_pair(method, frames)
    ((image, _),) = method.images(pair.between(before, after), [0.5])
    return np.asarray(image)


# -------------------------------------------------------------------------------------------------------------- figures


def draw_before_and_after() -> Path:
    """Draw two frames of the clip overlaid, and the frame that the default method makes half-way between them."""
    shown = clip()[32:36]
    overlaid = cv2.addWeighted(shown[1], 0.5, shown[2], 0.5, 0)
    made = made_between(shown)
    part = np.s_[75:335, 105:505]
    return save(
        "before-after",
        [
            [
                Panel("Before: two frames that follow each other, overlaid", overlaid[part]),
                Panel("After: the frame between them, made by fpsboost", made[part]),
            ]
        ],
    )


def draw_motion() -> Path:
    """Draw a pair of frames and its motion."""
    frames = clip()[27:29]
    field01, _ = methods["nlm"].pair(*prepared(frames)).fields
    edge = 20.0
    coloured = cv2.resize(in_colour(field01.flow, edge), (400, 225), interpolation=cv2.INTER_NEAREST)
    add_wheel(coloured)
    alike = cv2.resize(field01.similarity, (400, 225), interpolation=cv2.INTER_NEAREST)
    return save(
        "motion",
        [
            [Panel("Frame 0", smaller(frames[0], 400)), Panel("Frame 1", smaller(frames[1], 400))],
            [
                Panel(f"Motion from 0 to 1 (rim of the wheel: {edge:.0f} pixels)", coloured),
                Panel("Similarity of the patches at both ends, 0 black to 1 bright", as_heat(alike)),
            ],
        ],
    )


def draw_similarity() -> Path:
    """Draw the similarity of every offset at one point: where there is much contrast, and where there is little."""
    radius, reach, scale = 5, 24, 4
    rows = []
    for name, numbers, (y, x) in (("glass", (8, 10), (52, 58)), ("reflective", (8, 10), (62, 188))):
        first, second = scene(name, *numbers)
        colours, contrasts = ([of(each) for each in (first, second)] for of in (colour_components, contrast_components))
        report = similarity_map(*colours, y, x, radius, reach, exp_of(0.25))
        default = similarity_map(*contrasts, y, x, radius, reach, linear_of(0.09))
        around = np.s_[y - reach : y + reach + 1, x - reach : x + reach + 1]
        here, there = (larger(each[around], scale) for each in (first, second))
        middle = reach * scale
        corner, opposite = ((middle - radius * scale,) * 2, (middle + (radius + 1) * scale - 1,) * 2)
        cv2.rectangle(here, corner, opposite, (255, 255, 255), 2)
        titles = (
            ("Frame 0, a patch", "Frame 1, all offsets", "The report, v = 0.25", "Default, v = 0.09")
            if not rows
            else ("", "", "", "")
        )
        maps = [mark_maximum(larger(as_heat(each), scale), each, scale) for each in (report, default)]
        rows.append([Panel(title, picture) for title, picture in zip(titles, (here, there, *maps), strict=True)])
    return save("similarity", rows)


def draw_choice() -> Path:
    """Draw what semi-global matching adds in repeated patterns, beside a renderer's vectors."""
    number = 7
    first, second = scene("texture", number, number + 1)
    images = prepared([first, second])
    alone = replace(nlm.CoarseToFine(), smoothness=0).estimate(*images)[0].flow
    chosen = nlm.CoarseToFine().estimate(*prepared([first, second]))[0].flow
    true = VectorFolder(str(SAMPLES / "scenes" / "texture" / "vectors")).for_image(number, first).forward
    edge = 10.0
    fields = [in_colour(flow, edge) for flow in (alone, chosen, true)]
    add_wheel(fields[2])
    return save(
        "choice",
        [
            [Panel("Frame 0", first), Panel("Every point takes its most similar offset", fields[0])],
            [
                Panel("Semi-global matching chooses", fields[1]),
                Panel(f"The renderer's vectors (rim of the wheel: {edge:.0f} pixels)", fields[2]),
            ],
        ],
    )


def draw_residual_search() -> Path:
    """Draw the motion of a small fast ball, without and with the residual search."""
    frames = clip()[53:55]
    with mock.patch.object(nlm, "MIN_SIMILARITY", ()):
        without = nlm.CoarseToFine().estimate(*prepared(frames))[0].flow
    found = nlm.CoarseToFine().estimate(*prepared(frames))[0].flow
    part, edge = np.s_[147:307, 440:640], 30.0
    pictures = [each[part] for each in (*frames, in_colour(without, edge), in_colour(found, edge))]
    pictures[3] = np.ascontiguousarray(pictures[3])
    add_wheel(pictures[3])
    titles = "Frame 0", "Frame 1", "Motion without it", f"and with it (rim: {edge:.0f} pixels)"
    return save("residual-search", [[Panel(*each) for each in zip(titles, pictures, strict=True)]])


def draw_candidates() -> Path:
    """Draw the candidate motions of one node: what each brings together, and its weight."""
    frames = clip()[27:29]
    pair, fuse = methods["nlm"].pair(*prepared(frames)), MultiHypothesis()
    frame_pair = FramePair(pair.image0, pair.image1, *pair.fields)
    (inputs,) = fuse._blend_inputs(frame_pair, [0.5])
    listed, t = inputs.candidates, inputs.t
    row, column, scale = 8, 15, 4
    before, side = (WINDOW - listed.spacing) // 2, WINDOW
    top, left = row * listed.spacing - before, column * listed.spacing - before
    window = np.s_[top : top + side, left : left + side]
    rows, weights = [], []
    for k in range(int(listed.listed[row, column])):
        motion, prior = listed.motions[row, column, k], listed.weights[row, column, k]
        if prior == 0:
            continue
        mixed, alike = alone_everywhere(fuse, inputs, motion)
        weight = prior * np.exp(-fuse.sharpness * (1 - alike[window]))
        weights.append(weight)
        centre = left + side / 2 - 0.5, top + side / 2 - 0.5
        samples = [
            cv2.getRectSubPix(image.array, (side, side), (centre[0] + share * motion[0], centre[1] + share * motion[1]))
            for image, share in ((pair.image0, -t), (pair.image1, 1 - t))
        ]
        rows.append((motion, prior, samples, mixed[window], alike[window]))
    total, panels = np.sum(weights, axis=0), []
    shown: list[Picture] = []
    for (motion, prior, samples, mixed, alike), weight in zip(rows, weights, strict=True):
        if any(np.abs(motion[:2] - other[:2]).max() < 3 for other in shown):
            continue  # nearly the same motion as one with more votes
        shown.append(motion)
        name = f"({round(motion[0])}, {round(motion[1])})"
        titles = f"{name}: frame 0", "frame 1", "their mean", "similarity", f"share (votes {prior:.2f})"
        pictures = *samples, mixed, as_heat(((alike - 0.5) * 2).clip(0, 1)), as_heat(weight / total)
        panels.append([Panel(title, larger(each, scale)) for title, each in zip(titles, pictures, strict=True)])
    (made,) = fuse.synthesize(frame_pair, [t])
    panels.append([Panel("the frame made", larger(np.asarray(made)[window], scale))])
    return save("candidates", panels)


def draw_confidence() -> Path:
    """Draw where the result can be trusted, and where it is wrong."""
    frames = scene("glass", 12, 13, 14)
    pair = methods["nlm"].pair(*prepared([frames[0], frames[2]]))
    (fused,) = MultiHypothesis().fuse(FramePair(pair.image0, pair.image1, *pair.fields), [0.5])
    error = np.abs(fused.image.astype(np.float32) - frames[1]).mean(axis=2)
    largest = 64
    return save(
        "confidence",
        [
            [Panel("The frame that was made", fused.image), Panel("The frame that was hidden", frames[1])],
            [
                Panel("Confidence, 0 black to 1 bright", as_heat(fused.confidence)),
                Panel(f"Error, 0 black to {largest} levels and more bright", as_heat((error / largest).clip(0, 1))),
            ],
        ],
    )


def draw_cut() -> Path:
    """Draw the match score of all successive frames of the sample clip, as an SVG."""
    detector, images = CutDetector(), prepared(clip())
    match_score = [detector.match_score(first, second) for first, second in pairwise(images)]
    with rc_context(SVG):
        figure = Figure(figsize=(8, 2.6), layout="constrained")
        axes = figure.add_subplot()
        axes.plot(match_score, color="#2f6f9f", marker="o", markersize=3, linewidth=1)
        axes.axhline(detector.threshold, color="#b5532a", linewidth=1, linestyle="--")
        axes.text(0, detector.threshold + 0.02, f"threshold {detector.threshold}", color="#b5532a", va="bottom")
        for number, score in enumerate(match_score):
            if not detector.is_cut(score, *match_score[max(number - 1, 0) : number], *match_score[number + 1 :][:1]):
                continue
            axes.annotate("cut", (number, score), (8, 0), textcoords="offset points", va="center", color="#222222")
        axes.set(ylim=(0, 1), xlabel="pair of frames", ylabel="match score", xlim=(-1, len(match_score)))
        axes.spines[["top", "right"]].set_visible(False)
        return save_chart("cut", figure)


def draw_arrays() -> Path:
    """Draw the weather radar of docs/arrays.md, by the code of that page."""
    page: dict[str, Any] = {}
    text = (ROOT / "docs" / "arrays.md").read_text(encoding="utf-8")
    exec("".join(re.findall(r"```python\n(.*?)```", text, re.DOTALL)[:2]), page)
    panels = []
    for minute in (0, 3, 5, 10, 15):
        dbz = page["every_minute"][minute]
        picture = as_heat(((np.nan_to_num(dbz) + 10) / 55).clip(0, 1))
        picture[np.isnan(dbz)] = 160
        panels.append(Panel(f"{minute} minutes, {'measured' if minute in page['scans'] else 'interpolated'}", picture))
    return save("arrays", [panels])


def turntable(frames: int, width: int = 160) -> NDArray[np.uint8]:
    """Return the frames of one turn of a plate with discs, seen from above at an angle, (N, H, W, 3) BGR."""
    side, random = 4 * width, np.random.default_rng(3)
    plate = np.full((side, side, 3), 235, np.uint8)
    for share, colour in ((0.46, (120, 150, 170)), (0.4, (200, 215, 225))):
        cv2.circle(plate, (side // 2, side // 2), int(side * share), colour, -1, cv2.LINE_AA)
    for k in range(9):
        reach, angle = (0.18 + 0.13 * (k % 2)) * side, 2 * np.pi * k / 9
        centre = int(side / 2 + reach * np.cos(angle)), int(side / 2 + reach * np.sin(angle))
        colour = random.integers(30, 220, 3)
        cv2.circle(plate, centre, int(side * 0.06), colour.tolist(), -1, cv2.LINE_AA)
        cv2.circle(plate, centre, int(side * 0.025), (255 - colour).tolist(), -1, cv2.LINE_AA)
    plate, turned = cv2.GaussianBlur(plate, (0, 0), 1.6), list[Picture]()
    for number in range(frames):
        matrix = cv2.getRotationMatrix2D((side / 2, side / 2), 360 * number / frames, 1) / 4
        matrix[1] *= 0.55
        turned.append(cv2.warpAffine(plate, matrix, (width, int(width * 0.56)), borderValue=(235, 235, 235)))
    return np.stack(turned)


def draw_loop() -> Path:
    """Draw what is shown from the last frame of a loop to its first one, with and without `loop`."""
    frames, rows = turntable(24), list[list[Panel]]()
    for loop in (False, True):
        made, _ = interpolate_clip(frames, 16, factor=4, loop=loop, order="bgr")
        titles = ["last frame, 1.44 s", "1.45 s", f"1.47 s, loop={loop}", "1.48 s", "first frame, 1.5 s"]
        rows.append([Panel(*each) for each in zip(titles, [*made[-4:], frames[0]], strict=True)])
    return save("loop", rows)


def draw_turning() -> Path:
    """Draw one turn of the turntable beside what is made of it, at half of its speed; it plays as a loop."""
    before, rate, factor = turntable(24, 240), 8, 4
    after, _ = interpolate_clip(before, rate, factor=factor, loop=True, order="bgr")
    titles = f"{rate} frames a second", f"{rate * factor}, with loop"
    frames = [
        side_by_side(*map(labelled, pair, titles)) for pair in zip(before.repeat(factor, axis=0), after, strict=True)
    ]
    return save_animation("turning", frames, [31, 32, 31, 31] * len(before))  # 125 ms for each frame of the clip


def draw_repair() -> Path:
    """Draw a frame with a dropout and a displaced field, what replaces it, and the frame as it was."""
    frames, number = clip()[22:29], 3
    true, damaged = frames[number], frames[number].copy()
    damaged[1::2] = np.roll(damaged[1::2], 36, axis=1)
    damaged[200:240] = 128
    frames[number] = damaged
    caches = prepared(frames)
    found = find_damaged(SourceFrame(Frame(frame, Fraction(0))) for frame in frames)
    assert [each for each, (_, is_damaged) in enumerate(found) if is_damaged] == [number]
    method = methods["nlm"]
    before, pair, after = (method.pair(*two) for two in pairwise([*caches[1:3], *caches[4:6]]))
    ((repaired, _),) = method.images(pair.between(before, after), [0.5])
    panels = {"damaged, detected": damaged, "replaced": repaired, "as it was": true}
    return save("repair", [[Panel(title, smaller(picture, 320)) for title, picture in panels.items()]])


def draw_mask() -> Path:
    """Draw a counter in front of a clip halfway between two frames, with and without a mask."""
    frames, mask = clip()[20:26], np.zeros((360, 640), np.uint8)
    mask[10:50, 10:176] = 255
    for number, frame in enumerate(frames):
        text = f"SCORE {1475 + 37 * number}"
        cv2.putText(frame, text, (16, 40), cv2.FONT_HERSHEY_SIMPLEX, 0.8, (255, 255, 255), 2, cv2.LINE_AA)
    with TemporaryDirectory() as folder:
        cv2.imwrite(f"{folder}/hud.png", mask)
        masked = replace(methods["nlm"], mask=Mask(f"{folder}/hud.png"))
        without, kept = (
            interpolate_clip(frames, 24, method=each, order="bgr")[0][5] for each in (methods["nlm"], masked)
        )
    panels = {"frame 2": frames[2], "halfway": without, "halfway, with a mask": kept, "frame 3": frames[3]}
    return save("mask", [[Panel(title, larger(picture[8:62, 8:184], 2)) for title, picture in panels.items()]])


def draw_retime() -> Path:
    """Draw the curve of docs/retime.md, through its points in lines and smoothly, as an SVG."""
    text = (ROOT / "docs" / "retime.md").read_text(encoding="utf-8").split("```\n# output")[1].split("```")[0]
    lines, smooth = (parse_curve(f"{word}# {text}", Fraction(24), Fraction(24)) for word in ("", "smooth "))
    times = [Fraction(step, 20) for step in range(int(lines.length * 20))]
    with rc_context(SVG):
        figure = Figure(figsize=(8, 3.4), layout="constrained")
        axes = figure.add_subplot()
        for name, curve, colour, style in (("lines", lines, "#2f6f9f", "-"), ("smooth", smooth, "#b5532a", "--")):
            axes.plot(np.float64(times), [float(curve.source(time)) for time in times], style, color=colour, label=name)
        for segment, words in zip(lines.segments, re.findall(r"#\s+(.*)", text), strict=True):
            ends = [(segment.begin, segment.source0), (segment.end, segment.source1)]
            axes.plot(*np.float64(ends).T, "o", color="#2f6f9f", markersize=5)
            middle = np.mean(np.float64(ends), axis=0)
            falls = segment.source1 < segment.source0
            where = {"textcoords": "offset points", "va": "top", "ha": "right" if falls else "left"}
            axes.annotate(words, middle, (-6 if falls else 6, -4), color="#2f6f9f", **where)
        axes.set(xlabel="output, seconds", ylabel="source, seconds", xlim=(0, float(lines.length)), ylim=(0, 4))
        axes.legend(frameon=False, loc="lower right")
        axes.grid(color="#eeeeee")
        axes.spines[["top", "right"]].set_visible(False)
        return save_chart("retime", figure)


# ------------------------------------------------------------------------------------------------- similarity in numpy


def exp_of(v: float) -> Any:
    """Return the report's similarity of pixels as a function of their difference."""
    return lambda apart: np.exp(-np.square(apart).sum(axis=-1) / (2 * v * v))


def linear_of(v: float) -> Any:
    """Return the linear form of that similarity, also as a function of the difference."""
    return lambda apart: (1 - np.abs(apart).sum(axis=-1) / (4 * v)).clip(0)


def similarity_map(first: Picture, second: Picture, y: int, x: int, radius: int, reach: int, measure: Any) -> Picture:
    """Return the mean similarity of the patch around a point to those at all offsets within reach in another frame."""
    patch = first[y - radius : y + radius + 1, x - radius : x + radius + 1]
    size, found = 2 * radius + 1, np.empty((2 * reach + 1,) * 2, np.float32)
    padding = radius + reach
    padded = cv2.copyMakeBorder(second, *(padding,) * 4, cv2.BORDER_REPLICATE)
    for dy, dx in np.ndindex(found.shape):
        top, left = y + dy, x + dx  # the padding is reach plus radius
        found[dy, dx] = measure(padded[top : top + size, left : left + size] - patch).mean()
    return found


def alone_everywhere(fuse: MultiHypothesis, inputs: BlendInput, motion: Picture) -> tuple[Picture, Picture]:
    """Return the in-between frame made with one motion everywhere, and the similarity of every pixel along it."""
    listed = inputs.candidates
    motions, weights = np.zeros_like(listed.motions), np.zeros_like(listed.weights)
    motions[..., 0, :2], weights[..., 0] = motion[:2], 1
    alone = Candidates(np.ones_like(listed.listed), motions, weights, listed.spacing)
    image, confidence = fuse._mixed(inputs._replace(candidates=alone), with_confidence=True)
    return np.asarray(image), confidence ** (1 / 8)


# -------------------------------------------------------------------------------------------------------------- drawing


def smaller(picture: Picture, width: int) -> Picture:
    """Return a picture reduced to a width."""
    height = round(picture.shape[0] * width / picture.shape[1])
    return cv2.resize(picture, (width, height), interpolation=cv2.INTER_AREA)


def larger(picture: Picture, scale: int) -> Picture:
    """Return a picture enlarged so that its pixels can be seen."""
    return picture.repeat(scale, axis=0).repeat(scale, axis=1)


def mark_maximum(picture: Picture, values: Picture, scale: int) -> Picture:
    """Draw a ring around the maximum of `values` on a picture `scale` times as large; return the picture."""
    row, column = np.unravel_index(values.argmax(), values.shape)
    centre = int(column * scale + scale // 2), int(row * scale + scale // 2)
    picture = np.ascontiguousarray(picture)
    cv2.circle(picture, centre, 3 * scale, (255, 255, 255), 2, cv2.LINE_AA)
    return picture


def add_wheel(picture: Picture, side: int = 48) -> None:
    """Draw the colour wheel, which is the legend of motion, into the lower right corner."""
    radius = side / 2
    y, x = (np.mgrid[:side, :side].astype(np.float32) + 0.5 - radius) / radius
    inside = ((1 - np.hypot(x, y)) * radius + 0.5).clip(0, 1)[..., np.newaxis]  # a smooth rim
    corner = picture[-side - 6 : -6, -side - 6 : -6]
    corner[:] = np.rint(corner * (1 - inside) + in_colour(np.dstack([x, y]), 1) * inside)


def save(name: str, rows: Sequence[Sequence[Panel]]) -> Path:
    """Save rows of panels as a WebP image with 256 colours; return its path."""
    widths = [max(row[k].picture.shape[1] for row in rows if k < len(row)) for k in range(len(rows[0]))]
    tops, height = [], GAP // 2
    for row in rows:
        height += LINE if any(panel.title for panel in row) else 0
        tops.append(height)
        height += max(panel.picture.shape[0] for panel in row) + GAP
    width = sum(widths) + GAP * (len(widths) + 1)
    figure = Figure(figsize=(width / 100, height / 100), dpi=100, facecolor="white")
    canvas = FigureCanvasAgg(figure)
    left = GAP
    for k, column in enumerate(widths):
        for row, top in zip(rows, tops, strict=True):
            if k >= len(row):
                continue
            title, picture = row[k]
            figure.figimage(picture[..., ::-1], left, height - top - picture.shape[0], origin="upper")
            figure.text(left / width, 1 - (top - 6) / height, title, fontsize=TEXT * 0.72, color="#222222")
        left += column + GAP
    canvas.draw()
    drawn = np.ascontiguousarray(np.asarray(canvas.buffer_rgba())[..., :3])
    palette = Image.new("P", (1, 1))
    palette.putpalette(choose_colours(drawn).ravel().tolist())
    path = FIGURES / f"{name}.webp"
    few = Image.fromarray(drawn).quantize(palette=palette, dither=Image.Dither.NONE)
    few.save(path, lossless=True, quality=100, method=6)
    return path


def save_chart(name: str, figure: Figure) -> Path:
    """Save a chart as an SVG; return its path."""
    path = FIGURES / f"{name}.svg"
    figure.savefig(path, metadata={"Date": None, "Creator": None})
    return path


def choose_colours(picture: Picture, count: int = 256) -> Picture:
    """Choose a palette for a picture, (count, 3) uint8; a colour counts by the square root of its number of pixels."""
    colours, pixels = np.unique(picture.reshape(-1, 3) >> 3, axis=0, return_counts=True)
    random, share = np.random.default_rng(1), np.sqrt(pixels)
    points = colours[random.choice(len(colours), 20000, p=share / share.sum())].astype(np.float32) * 8 + 4
    cv2.setRNGSeed(1)
    stop = (cv2.TERM_CRITERIA_MAX_ITER, 20, 0)
    _, _, centres = cv2.kmeans(points, count - 2, None, stop, 1, cv2.KMEANS_PP_CENTERS)
    ends = np.array([[0, 0, 0], [255, 255, 255]], np.float32)
    return np.rint(np.vstack([ends, centres])).astype(np.uint8)


if __name__ == "__main__":
    main()
