"""Masks: what is white stays as in the frame of the source that is nearest in time, and black changes nothing."""

import base64
import re
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

import fpsboost
from fpsboost.io.images.files import read_image
from support.video_truth import QUARTER_TURN, pictures_of, samples_of, scene, turntable, write_clip

SHARES = np.repeat([1, 128 / 255, 0], [20, 20, 24])
"""Share of the source in each column: white, gray and black."""

SHOTS = [scene(3 * index) for index in (0, 1, 2, 2)] + [scene(3 * index) // 2 for index in (3, 4)]
SHOTS += [np.rot90(scene(index, 64, 48)) for index in (5, 4, 3)]
"""A repeated picture, light that is switched off, and a cut."""


def save_mask(path: Path, shares: NDArray, turns: int = 0) -> None:
    """Write a mask of columns, turned clockwise by quarters."""
    cv2.imwrite(str(path), np.rot90(np.uint8(255 * shares + 0.5)[None].repeat(48, 0), -turns))


def frames_of(path: Path) -> list[list[NDArray]]:
    """The planes of every frame of a video, or the colours of every image of a folder."""
    images = [[read_image(file)] for file in sorted(path.glob("*.*"))]
    return images or [samples_of(each) for each in pictures_of(path)]


def check(
    run, source: Path, target: str, mask: str, options: str, nearest: str, shares: list[NDArray], slack: float = 0
) -> None:
    """Convert by the command line with and without a mask, and compare every pixel.

    `nearest` has the numbers of the source's frames that are nearest to those of the output, `shares` their shares;
    `slack` is what they may be off, as a share of the brightest sample.
    """
    results = []
    for more in ([], ["--mask", *mask.split()]):
        result = run(source, target, "-y", "-m", "nlm-fast", *options.split(), *more)
        assert result.code == 0, result.err
        results.append(frames_of(source.with_name(target.strip("/"))))
    originals = frames_of(source)
    for plain, found, number in zip(*results, map(int, nearest), strict=True):
        for without, plane, kept in zip(plain, found, originals[number], strict=True):
            share = shares[number][:: 64 // plane.shape[1]].reshape(-1, *[1] * (plane.ndim - 2))
            off = np.abs(plane - ((1 - share) * without + share * kept))
            assert (
                off <= (1e-3 if plane.dtype == np.float32 else 0.51) * (share % 1 > 0) + slack * without.max()
            ).all()


KINDS = {
    "8 bit": lambda folder, save: save(folder / "in", dtype=np.uint8),
    "16 bit": lambda folder, save: save(folder / "in", dtype=np.uint16),
    "OpenEXR": lambda folder, save: save(folder / "in", "{}.exr", dtype=np.float32),
    "4:2:0": lambda folder, _: write_clip(folder / "in.mkv", times=range(5)),
    "4:2:2, 10 bit": lambda folder, _: write_clip(folder / "in.mkv", times=range(5), pixel_format="yuv422p10le"),
    "turned by a tag": lambda folder, _: write_clip(folder / "in.mkv", times=range(5), matrix=QUARTER_TURN),
}
"""Functions that write a clip of five frames, images or a video."""


@pytest.mark.parametrize(
    ("more", "mask", "kept", "slack"),
    [
        ("", SHARES, SHARES, 0),
        (" --mask-as layer", 0 * SHARES, 0 * SHARES, 0),
        (" --mask-as layer", 0 * SHARES + 1, 0 * SHARES, 0.04),
    ],
    ids=["kept", "layer of nothing", "layer of all"],
)
@pytest.mark.parametrize("kind", KINDS)
def test_white_is_kept_and_black_is_interpolated(tmp_path, save_images, fpsboost_, kind, more, mask, kept, slack):
    """To the bit, in the planes of a video too, whose chroma has fewer pixels; gray is the mix."""
    save_mask(tmp_path / "mask.png", mask, kind == "turned by a tag")
    KINDS[kind](tmp_path, save_images)
    source, target, options, nearest = (
        ("in", "out/", "--factor 4", "00011112222333344")
        if (tmp_path / "in").is_dir()
        else ("in.mkv", "out.mkv", "--factor 4 --codec ffv1", "00011112222333344444")
    )
    check(fpsboost_, tmp_path / source, target, f"mask.png{more}", options, nearest, [kept] * 5, slack)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("options", "shown"),
    [
        ("--factor 2", "001122334455667788"),
        ("--factor 2 --start 3f", "334455667788"),
        ("--factor 2 --start 0.12", "334455667788"),
        ("--fps 30 --shutter 180", "01223456778"),
        ("--factor 2 --replace 3", "001122244455667788"),
        ("--speed 0.5@0-0.3", "00112233445566778"),
    ],
)
def test_each_frame_has_its_mask(tmp_path, fpsboost_, options, shown):
    """That of the nearest frame, a part of which is shown: a repeated one at its time, none that is damaged."""
    bars = [(np.arange(64) // 7 == number).astype(float) for number in range(9)]
    for number, bar in enumerate(bars):
        save_mask(tmp_path / f"{number}.png", bar)
    write_clip(tmp_path / "in.mkv", times=range(9), pixel_format="yuv444p", picture=lambda index, *_: SHOTS[index])
    check(fpsboost_, tmp_path / "in.mkv", "out.mkv", "#.png", f"--codec ffv1 {options}", shown, bars)


@pytest.mark.parametrize("scale", [np.uint8(1), np.uint16(257), np.float32(1 / 255)])
@pytest.mark.parametrize("slides", [True, False])
def test_a_layer_is_interpolated_by_itself(tmp_path, scale, slides):
    """A title that slides by 2 pixels a frame, or digits that change, over a pan of 6: better than kept and without it.

    What is far from it stays, to the rounding of filters.
    """
    masks = [
        cv2.putText(
            np.zeros((48, 120, 1), np.uint8),
            "GO" if slides else str(30 + 37 * (half // 2)),
            (10 + half * slides, 32),
            cv2.FONT_HERSHEY_SIMPLEX,
            fontScale=0.8,
            color=255,
            thickness=3,
        )
        for half in range(13)
    ]
    frames = np.stack(
        [pan + (255 - pan) * (mask / 255) for pan, mask in zip(turntable(40, 3)[:13], masks, strict=True)]
    )
    for number, mask in enumerate(masks[::2]):
        cv2.imwrite(str(tmp_path / f"{number}.png"), mask if slides else np.max(masks, axis=0))
    made = [
        fpsboost.interpolate_clip(
            np.rint(frames[::2]).astype(np.uint8) * scale,
            24,
            method=replace(fpsboost.find_method("nlm-fast"), mask=mask),
        )
        for mask in (
            None,
            *(fpsboost.Mask(tmp_path / ("" if slides else "0.png"), mask_as=use) for use in ("keep", "layer")),
        )
    ]
    without, kept, layer = (np.float64(pictures)[3:10:2] / scale - frames[3:10:2] for pictures, _ in made)
    assert np.abs(layer).mean() < (0.7 if slides else 0.97) * min(np.abs(without).mean(), np.abs(kept).mean())
    assert np.abs(layer - without)[:, :, -12:].max() <= 1


COUNTS = {
    "counter": [str(96 + 37 * number) for number in range(6)],
    "clock": [f"12:{58 + number}" if number < 2 else f"13:0{number - 2}" for number in range(6)],
    "a digit more": ["7", "77", "777", "778", "77", "7"],
    "subtitle": ["Who goes", "Who goes", "A friend", "A friend", "Pass then", "Pass then"],
    "appears": ["", "PAUSE", "PAUSE", "", "PAUSE", ""],
}
"""Texts that change where they stand, by frame."""

SIZE = 72, 160
"""Rows and columns of these frames."""


def over_a_pan(path: Path, drawn: Sequence[NDArray], scale: np.generic, *, with_panel: bool) -> NDArray:
    """Put white drawings, (H, W) of 255, over a picture that moves by 6 pixels a frame, and save one mask for all."""
    background = cv2.resize(turntable(80, 3)[0], None, fx=1, fy=1.5)[:72]
    mask = np.max(drawn, axis=0)
    if with_panel:
        mask = np.zeros_like(mask)
        mask[8:64, 12:148] = 255
    cv2.imwrite(str(path), mask)
    frames = []
    for number, text in enumerate(drawn):
        picture = np.roll(background, -6 * number, axis=1)[:, :160].astype(float)
        picture[mask > 0] = picture[mask > 0] * (not with_panel) + 30 * with_panel
        frames.append(picture + (245 - picture) * text[..., None] / 255)
    return np.rint(frames).astype(np.uint8) * scale


def written(text: str, column: float = 16) -> NDArray:
    """White letters on black, (72, 160) uint8."""
    large = np.zeros((288, 640), np.uint8)
    cv2.putText(large, text, (round(4 * column), 190), cv2.FONT_HERSHEY_SIMPLEX, 4, 255, 12, cv2.LINE_AA)
    return cv2.resize(large, (160, 72), interpolation=cv2.INTER_AREA)


def as_layer(path: Path, frames: NDArray, method: str) -> NDArray:
    """Twice the frames, the one mask as a layer, on the scale of 8 bits."""
    masked = replace(fpsboost.find_method(method), mask=fpsboost.Mask(path, mask_as="layer"))
    return fpsboost.interpolate_clip(frames, 24, method=masked)[0]


@pytest.mark.parametrize("scale", [np.uint8(1), np.uint16(257), np.float32(1 / 255)])
@pytest.mark.parametrize("with_panel", [True, False], ids=["panel", "letters"])
@pytest.mark.parametrize("kind", COUNTS)
def test_what_changes_in_a_still_layer_stays_legible(tmp_path, kind, with_panel, scale):
    """Every pixel of the layer that changes is, to the rounding, that of the nearer frame."""
    texts = [written(text) for text in COUNTS[kind]]
    frames = over_a_pan(tmp_path / "mask.png", texts, scale, with_panel=with_panel)
    made = as_layer(tmp_path / "mask.png", frames, "nlm-fast")
    in_layer = cv2.imread(str(tmp_path / "mask.png"), cv2.IMREAD_GRAYSCALE) == 255
    for number in range(5):
        before, after, between = (
            each / np.float64(scale) for each in (*frames[number : number + 2], made[2 * number + 1])
        )
        changed = (np.abs(after - before).max(axis=2) > 25) & in_layer
        assert np.abs(between - before)[changed].max(initial=0) < 1


def test_legible_digits_in_gray(tmp_path):
    """Images of one channel, too."""
    frames = over_a_pan(tmp_path / "mask.png", [*map(written, COUNTS["clock"])], np.uint8(1), with_panel=True)
    made = as_layer(tmp_path / "mask.png", frames[..., :1], "nlm-fast")
    assert np.abs(made[1:11:2].astype(int) - frames[:5, ..., :1])[:, 9:63, 13:147].max() <= 1


def test_legible_digits_in_the_planes_of_a_video(tmp_path, fpsboost_):
    """Of 4:2:0, to the rounding of its conversion to RGB and back."""
    texts = [written(text) for text in COUNTS["counter"]]
    frames = over_a_pan(tmp_path / "mask.png", texts, np.uint8(1), with_panel=True)
    write_clip(tmp_path / "in.mkv", times=range(6), size=SIZE, codec="ffv1", picture=lambda index, *_: frames[index])
    result = fpsboost_("in.mkv", "out.mkv", "--codec", "ffv1", "--mask", "mask.png", "--mask-as", "layer")
    assert result.code == 0, result.err
    source, made = ([planes[0].astype(int) for planes in frames_of(tmp_path / name)] for name in ("in.mkv", "out.mkv"))
    for number in range(5):
        changed = np.abs(source[number + 1] - source[number])[10:62, 14:146] > 25
        assert np.abs(made[2 * number + 1] - source[number])[10:62, 14:146][changed].max() <= 2


@pytest.mark.parametrize("method", ["nlm", "dis"])
def test_what_moves_in_a_still_layer_moves(tmp_path, method):
    """A ticker, a bar that grows and a counter that changes, in one mask: each is where it is halfway, or legible."""

    def drawn(half: int) -> NDArray:
        image = np.zeros(SIZE, np.uint8)
        image[9:34, 14:146] = written("HIJKLMNOPQR", 60 - 2 * half)[25:50, 14:146]
        image[46:56, 20 : 40 + half] = 255
        image[38:63, 100:146] = written(str(17 + 37 * (half // 2)), 104)[25:50, 100:146]
        return image

    halves = [drawn(half) for half in range(7)]
    frames = over_a_pan(tmp_path / "mask.png", halves[::2], np.uint8(1), with_panel=True)
    truth = over_a_pan(tmp_path / "truth.png", halves, np.uint8(1), with_panel=True)
    made = as_layer(tmp_path / "mask.png", frames, method)
    for half in (1, 3, 5):
        off = np.abs(made[half].astype(float) - truth[half])
        held = np.abs(frames[half // 2].astype(float) - truth[half])
        assert off[9:34, 30:130].mean() < held[9:34, 30:130].mean() / 5
        assert off[46:56, 14:90].mean() < held[46:56, 14:90].mean() * (0.2 if method == "nlm" else 0.8)
        assert off[38:63, 100:146].max() < 2


def test_preview_tints_what_is_kept(tmp_path, fpsboost_):
    """In magenta, in a frame of each passage."""
    write_clip(tmp_path / "in.mkv")
    save_mask(tmp_path / "mask.png", SHARES > 0.6)
    assert fpsboost_("preview", "in.mkv", "page.html", "--mask", "mask.png", "-m", "blend").code == 0
    (shown,) = re.findall('webp;base64,([^"]+)" alt="Frame with the mask"', (tmp_path / "page.html").read_text())
    picture = cv2.imdecode(np.frombuffer(base64.b64decode(shown), np.uint8), cv2.IMREAD_COLOR)
    tint = (picture @ [1, -2, 1]).mean(axis=0)
    assert tint[:18].min() > 150 > tint[22:].max()
