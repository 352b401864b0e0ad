"""Passes of a renderer: made with the weights of the picture, each as what it is, from file to file."""

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import OpenEXR
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import fpsboost
from fpsboost import FrameCache, InputError, Interpolator, OptionError, methods
from fpsboost.io.images.exr import read_exr, read_exr_header
from fpsboost.layered import Layer, LayeredImage, LayerKind
from fpsboost.synthesis.layers import Sources
from support.conversion_options import grouped
from support.exr_truth import content, save_exr, window

HEIGHT, WIDTH = 64, 96


def texture(seed: int, height: int = HEIGHT, width: int = WIDTH) -> np.ndarray:
    """Smooth noise between 0 and 1."""
    blurred = cv2.GaussianBlur(np.random.default_rng(seed).random((height, width), np.float32), (0, 0), 1.5)
    return (blurred - blurred.min()) / np.float32(np.ptp(blurred))


def planes_at(moment: float, brightness: float = 1) -> dict[str, np.ndarray]:
    """Layers of a scene: a card that moves to the right, 8 pixels from frame to frame, before another one at rest.

    ``glow`` has edges a hundred times as bright as white.
    """
    x = 20 + round(8 * moment)
    place = slice(16, 48), slice(x, x + 32)
    diffuse, glow, ids, depth = texture(1), np.zeros((HEIGHT, WIDTH), np.float32), np.ones((HEIGHT, WIDTH)), texture(5)
    diffuse[place] = texture(2, 32, 32)
    glow[place] = 100 * (texture(3, 32, 32) > 0.6)
    ids[place] = 2
    depth = np.where(ids == 2, np.float32(3), 10 + depth)
    normals = {"Normal.X": ids - 1, "Normal.Y": ids * 0, "Normal.Z": 2 - ids}
    crypto = {f"CryptoObject00.{each}": ids * (5 + k) for k, each in enumerate("rgba")}
    found = {"Diffuse.Y": brightness * diffuse, "Glow.Y": brightness * glow, "Depth.Z": depth, "IndexOB.X": ids}
    found |= {**normals, **crypto, "Combined.Y": brightness * (diffuse + glow)}
    return {name: plane.astype(np.float32) for name, plane in found.items()}


KINDS: dict[str, LayerKind] = {
    **{"Diffuse": "linear", "Glow": "linear", "Depth": "depth", "IndexOB": "nearest"},
    **{"Normal": "normals", "CryptoObject00": "nearest"},
}


def layered(planes: dict[str, np.ndarray]) -> LayeredImage:
    layers = {layer: {name: plane for name, plane in planes.items() if name.startswith(layer)} for layer in KINDS}
    picture = planes["Combined.Y"][..., np.newaxis]
    return LayeredImage(picture, tuple(Layer(name, KINDS[name], planes) for name, planes in layers.items()))


def between(method: Interpolator, image0: LayeredImage, image1: LayeredImage, t: float = 0.5) -> LayeredImage:
    pair = replace(method, cuts=None).pair(FrameCache(image0), FrameCache(image1))
    ((made, _),) = method.images(pair, [t])
    assert isinstance(made, LayeredImage)
    return made


@pytest.fixture(scope="module", params=["nlm", "dis", "blend"])
def made(request: pytest.FixtureRequest) -> dict[str, np.ndarray]:
    image = between(methods[request.param], *(layered(planes_at(moment)) for moment in (0, 1)))
    return {**image.planes(), "Combined.Y": image.colour[..., 0]}


def test_what_is_composed_of_layers_stays_so(made):
    """The sum of the linear layers between is the picture between, to rounding, at edges of high contrast too."""
    composed = made["Diffuse.Y"] + made["Glow.Y"]
    np.testing.assert_allclose(made["Combined.Y"], composed, rtol=1e-5, atol=1e-5 * 100)


def test_no_linear_layer_leaves_its_range(made):
    """Nothing is darker or brighter than it is in the two frames, although a spline overshoots at edges."""
    for name in ("Diffuse.Y", "Glow.Y", "Combined.Y"):
        both = [planes_at(moment)[name] for moment in (0, 1)]
        assert made[name].min() >= min(each.min() for each in both)
        assert made[name].max() <= max(each.max() for each in both)


def test_nothing_rings_around_highlights():
    """Two pixels from a spot a hundred times as bright as white, a picture and its layers are as its surroundings."""
    ground, images = 0.04 + 0.02 * texture(4), []
    for x in (40, 45):
        plane = np.roll(ground, x - 40, 1)
        plane[30:32, x : x + 3] = 100
        images.append(plane)
    layers = (LayeredImage(plane[..., np.newaxis], (Layer("Y", "linear", {"Y": plane}),)) for plane in images)
    layer = between(methods["nlm"], *layers)
    alone = fpsboost.interpolate(*(np.dstack([plane] * 3) for plane in images), 0.5)
    for found in (layer.colour[..., 0], layer.planes()["Y"], alone[..., 0]):
        assert found[30:32, 43:45].min() > 90
        found[29:33, 41:47] = ground.mean()
        assert ground.min() * 0.99 <= found.min() <= found.max() <= ground.max() * 1.01


def test_numbers_of_objects_are_never_mixed(made):
    """Every pixel has one of the frames' numbers, and all channels of a layer have theirs from one place."""
    assert set(np.unique(made["IndexOB.X"])) == {1, 2}
    np.testing.assert_array_equal(made["CryptoObject00.r"] / 5, made["IndexOB.X"])
    for k, each in enumerate("rgba"):
        np.testing.assert_array_equal(made[f"CryptoObject00.{each}"], made["IndexOB.X"] * (5 + k))


def test_depth_is_never_between_two_surfaces(made):
    """There is nothing between the card at 3 and the one at 10 to 11."""
    assert (((made["Depth.Z"] > 3.01) & (made["Depth.Z"] < 9.9)) | (made["Depth.Z"] < 2.99)).sum() == 0


def test_normals_are_as_long_as_before(made):
    """Directions of length 1 stay so where one is mixed with another."""
    np.testing.assert_allclose(np.sqrt(sum(made[f"Normal.{each}"] ** 2 for each in "XYZ")), 1, atol=1e-3)


@pytest.mark.parametrize("t", [0.25, 0.5, 0.75])
def test_numbers_and_depth_move_with_their_objects(t):
    """Most pixels are right, on both sides of the moving card and of what it hides."""
    image = between(methods["nlm"], *(layered(planes_at(moment)) for moment in (0, 1)), t)
    found, expected = image.planes(), planes_at(t)
    blended = between(methods["blend"], *(layered(planes_at(moment)) for moment in (0, 1)), t).planes()
    wrong, by_blending = ((each["IndexOB.X"] != expected["IndexOB.X"]).sum() for each in (found, blended))
    assert wrong < by_blending / 2
    assert (np.abs(found["Depth.Z"] - expected["Depth.Z"]) > 1).sum() < by_blending / 2


def test_depth_that_changes_is_mixed_by_time():
    """A surface that comes nearer is in between in between."""
    still = np.full((HEIGHT, WIDTH), 5, np.float32)
    places = tuple(np.indices(still.shape))
    everywhere = np.ones(still.shape, bool)
    sources = Sources(places, places, everywhere, everywhere, 0.25)
    np.testing.assert_allclose(sources.depth(still, still * np.float32(0.95)), 5 * (1 - 0.05 * 0.25), rtol=1e-6)
    np.testing.assert_array_equal(sources.depth(still, still * 2), still * 2)
    np.testing.assert_array_equal(sources.depth(still * np.inf, still * np.inf), still * np.inf)


@settings(max_examples=10)
@given(st.lists(st.tuples(st.integers(0, 1000), st.floats(0.01, 1000)), min_size=2, max_size=5), st.floats(0.1, 0.9))
def test_any_sum_of_layers_stays_a_sum(parts, t):
    """Whatever the layers are: edges, and values far beyond white."""
    image0, image1 = (
        [np.float32(scale) * (texture(seed) * (texture(seed) > 0.5))[:, k : WIDTH - 8 + k] for seed, scale in parts]
        for k in (0, 3)
    )
    frames = [
        LayeredImage(
            sum(planes)[..., np.newaxis], (Layer("light", "linear", dict(zip("abcde", planes, strict=False))),)
        )
        for planes in (image0, image1)
    ]
    made = between(methods["nlm"], *frames, t)
    total = sum(made.planes().values())
    np.testing.assert_allclose(made.colour[..., 0], total, atol=1e-5 * float(frames[0].colour.max()), rtol=1e-5)
    assert total.min() >= 0


@pytest.mark.parametrize(("at_cuts", "shade"), [("repeat", 0), ("blend", 0.25)])
def test_across_cuts_all_layers_do_what_the_picture_does(at_cuts, shade):
    """They are repeated, or mixed as far as they can be."""

    class Everywhere(fpsboost.CutDetector):
        def is_cut(self, *scores: float) -> bool:
            return True

    method = replace(methods["nlm"], cuts=Everywhere(), at_cuts=at_cuts)
    image0, image1 = layered(planes_at(0)), layered(planes_at(5))
    ((made, _),) = method.images(method.pair(FrameCache(image0), FrameCache(image1)), [0.25])
    for layer0, layer1, layer in zip(image0.layers, image1.layers, made.layers, strict=True):
        for name, plane in layer.planes.items():
            share = shade if layer0.kind == "linear" else 0
            if layer0.kind != "normals":
                expected = layer0.planes[name] * (1 - share) + layer1.planes[name] * share
                np.testing.assert_allclose(plane, expected, atol=1e-4)


HALVES = ("Combined", "Diffuse", "Normal")


def save(path: Path, planes: dict[str, np.ndarray], *, several: bool = False, **said: object) -> None:
    """Write a file as renderers do: colours in half, data in float, numbers as whole numbers."""
    typed = {
        f"ViewLayer.{name}": plane.astype(np.float16 if name.startswith(HALVES) else np.float32)
        for name, plane in planes.items()
    }
    typed["ViewLayer.ids.id"] = planes["IndexOB.X"].astype(np.uint32)
    header = {"compression": OpenEXR.PIZ_COMPRESSION, **said}
    layers = sorted({name.rpartition(".")[0] for name in typed}) if several else []
    parts = [(each, {n.rpartition(".")[2]: p for n, p in typed.items() if n.startswith(each)}) for each in layers]
    save_exr(path, *(parts or [("", typed)]), **header)


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    (tmp_path / "in").mkdir()
    return tmp_path / "in"


@pytest.fixture
def clip(folder: Path) -> Path:
    """Frames 1, 3 and 5."""
    for number in (1, 3, 5):
        planes = planes_at((number - 1) / 2)
        save(folder / f"shot_{number:04d}.exr", planes, **{"cryptomatte/a/manifest": "{}", "Frame": f"{number}"})
    return folder


def convert(clip: Path, out: Path, **options: object) -> fpsboost.Summary:
    method = str(options.pop("method", "blend"))
    return fpsboost.convert(str(clip), str(out), method=method, **grouped(duplicates="keep", **options))


def names(folder: Path) -> Iterator[str]:
    return (path.name for path in sorted(folder.iterdir()))


@pytest.mark.parametrize("several", [False, True])
@pytest.mark.parametrize("method", ["blend", "nlm"])
def test_every_layer_comes_back(folder, tmp_path, method, several):
    """Originals are the same files; frames between have the same parts, channels, types and attributes."""
    for number in (1, 3, 5):
        save(folder / f"{number}.exr", planes_at((number - 1) / 2), several=several, owner="me")
    summary = convert(folder, tmp_path / "out", method=method)
    assert list(names(tmp_path / "out")) == [f"{number}.exr" for number in range(1, 6)]
    for number in (1, 3, 5):
        assert (tmp_path / "out" / f"{number}.exr").read_bytes() == (folder / f"{number}.exr").read_bytes()
    for number in (2, 4):
        made = tmp_path / "out" / f"{number}.exr"
        headers = [read_exr_header(path) for path in (folder / f"{number - 1}.exr", made)]
        assert [repr(part.attributes) for part in headers[0].parts] == [
            repr(part.attributes) for part in headers[1].parts
        ]
        planes = content(made)
        assert {str(plane.dtype) for plane in planes.values()} == {"float16", "float32", "uint32"}
        assert set(np.unique(planes["ViewLayer.ids.id"])) == {1, 2}
        composed = planes["ViewLayer.Diffuse.Y"].astype(np.float32) + planes["ViewLayer.Glow.Y"]
        np.testing.assert_allclose(planes["ViewLayer.Combined.Y"], composed, rtol=2e-3, atol=2e-3)
    assert not any("left out" in remark for remark in summary.remarks)


@pytest.mark.parametrize(
    ("options", "types", "sentence"),
    [
        ({"passes": "beauty"}, {"Combined.Y": "float16"}, "of which the frames between have fewer"),
        (
            {"passes": "Depth,ids"},
            {"Combined.Y": "float16", "Depth.Z": "float32", "ids.id": "uint32"},
            "of which the frames between have fewer",
        ),
        ({"out": "#.tif"}, None, "which were left out"),
    ],
)
def test_what_frames_between_hold_on_request(clip, tmp_path, options, types, sentence):
    """The picture alone, or with some layers in the types that they have; what is left out is said."""
    out = tmp_path / str(options.pop("out", "out"))
    assert any(sentence in remark for remark in convert(clip, out, **options).remarks)
    if types is not None:
        made = content(out / "shot_0002.exr")
        assert {name.removeprefix("ViewLayer."): str(plane.dtype) for name, plane in made.items()} == types
        assert (out / "shot_0003.exr").read_bytes() == (clip / "shot_0003.exr").read_bytes()


@pytest.mark.parametrize(
    ("options", "error", "sentence"),
    [
        ({"method": "dis-warp"}, OptionError, r"makes no layers.*choose nlm.*`passes='beauty'`"),
        ({"passes": "Gloss"}, InputError, r"shot_0001\.exr has no layer 'Gloss' .*: ViewLayer\.CryptoObject00, "),
        (
            {"passes": "all", "out": "#.tif"},
            OptionError,
            r"makes layers of OpenEXR images, which the output of .* cannot",
        ),
    ],
)
def test_what_cannot_be_made_is_refused(clip, tmp_path, options, error, sentence):
    """In one sentence that says what to do, and nothing is written."""
    before = sorted(tmp_path.rglob("*"))
    with pytest.raises(error, match=sentence):
        convert(clip, tmp_path / str(options.pop("out", "out")), **options)
    assert sorted(tmp_path.rglob("*")) == before


def test_layers_are_asked_of_openexr_alone(folder, tmp_path):
    """Other images and videos have none."""
    for number in (1, 2):
        cv2.imwrite(str(folder / f"{number}.png"), np.zeros((8, 8), np.uint8))
    with pytest.raises(OptionError, match=r"`passes` names layers of OpenEXR files"):
        convert(folder, tmp_path / "out", passes="Depth")
    (tmp_path / "a.mp4").write_bytes(b"")
    with pytest.raises(OptionError, match=r"`passes` is for a folder or a pattern of images"):
        convert(tmp_path / "a.mp4", tmp_path / "out", passes="all")


@pytest.mark.parametrize(
    ("planes", "header", "sentence"),
    [
        (
            {f"{layer}.Combined.{each}": texture(1) for layer in ("A", "B") for each in "RGB"},
            {},
            "hold several pictures (A.Combined, B.Combined), the first of which leads",
        ),
        (
            {each: texture(1, 32, 32) for each in "RGBZ"},
            {"dataWindow": window(-4, -4, 32, 32), "displayWindow": window(0, 0, 24, 24)},
            "pixels elsewhere than in the display window",
        ),
        (
            planes_at(1) | {f"Vector.{each}": texture(k) for k, each in enumerate("XYZW")},
            {},
            "Motion vectors lead from one original to the next",
        ),
    ],
    ids=["two view layers", "a larger data window", "vectors"],
)
def test_what_made_frames_hold_otherwise_is_said(folder, tmp_path, planes, header, sentence):
    """Which picture leads, that pixels are in the display window alone, and where vectors of new numbers lead."""
    for number in (1, 2, 3):
        save_exr(folder / f"{number}.exr", ("", planes), **header)
    summary = convert(folder, tmp_path / "out")
    assert any(sentence in remark for remark in summary.remarks)
    assert summary.frames_out == 5
    assert not header or content(tmp_path / "out" / "2.exr")["Z"].shape == (24, 24)


def test_half_of_a_pass_ends_where_half_does(folder, tmp_path):
    """Nothing becomes infinite between two frames that are not."""
    for number in (1, 2, 3):
        planes = {"R": np.full((16, 16), 65504, np.float16), "G": np.zeros((16, 16), np.float16)}
        planes |= {"B": np.zeros((16, 16), np.float16), "Light.Y": np.full((16, 16), 65504, np.float16)}
        save_exr(folder / f"{number}.exr", ("", planes))
    convert(folder, tmp_path / "out")
    for path in (tmp_path / "out").iterdir():
        assert read_exr(path, ["Light.Y"])["Light.Y"].max() == 65504


def test_memory_is_counted_by_layers(clip, tmp_path):
    """A limit that the picture alone would keep to."""
    limit = fpsboost.MemoryLimit(300_000_000 + 800 * HEIGHT * WIDTH)
    with pytest.raises(InputError, match=r"is 96x64 with \d+ planes of layers, which takes about"):
        convert(clip, tmp_path / "out", limit=limit)
    assert convert(clip, tmp_path / "out", limit=limit, passes="beauty").frames_in == 3
