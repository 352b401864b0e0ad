"""Layers of OpenEXR files: which are there, what each is, and files that are made like others."""

from pathlib import Path

import numpy as np
import OpenEXR
import pytest

from fpsboost.errors import InputError
from fpsboost.io.images.exr import encode_exr_like, read_exr_header
from fpsboost.io.images.files import read_image
from fpsboost.io.images.layers import Passes, contents_of, kind_of
from support.exr_truth import content, save_exr, tiles, window

HEIGHT, WIDTH = 40, 60
HERE = Path("a.exr")
Channels = dict[str, np.ndarray]


@pytest.fixture(autouse=True)
def _in_a_folder_of_its_own(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)


def numbers(seed: int, kind: type = np.float16) -> np.ndarray:
    values = np.random.default_rng(seed).random((HEIGHT, WIDTH))
    return (values * 2**32).astype(np.uint32) if kind is np.uint32 else values.astype(kind)


def blender() -> Channels:
    """The channels of a multilayer file as Blender writes it."""
    names = [f"ViewLayer.{layer}.{each}" for layer in ("Combined", "DiffCol") for each in ("R", "G", "B")]
    channels = {name: numbers(seed) for seed, name in enumerate([*names, "ViewLayer.Combined.A"])}
    channels |= {f"ViewLayer.Normal.{each}": numbers(20 + seed) for seed, each in enumerate("XYZ")}
    channels |= {f"ViewLayer.Vector.{each}": numbers(30 + seed, np.float32) for seed, each in enumerate("XYZW")}
    channels |= {f"ViewLayer.CryptoObject00.{each}": numbers(40 + seed, np.float32) for seed, each in enumerate("rgba")}
    return channels | {"ViewLayer.Depth.Z": numbers(50, np.float32), "ViewLayer.IndexOB.X": numbers(51, np.float32)}


def save(*parts: tuple[str, Channels], path: Path = HERE, **header: object) -> Path:
    return save_exr(path, *parts, **header)


@pytest.mark.parametrize(
    ("channels", "picture", "layers"),
    [
        ("R G B A Z id N.X N.Y N.Z", "B G R A", {"Z": "depth", "id": "nearest", "N": "normals"}),
        ("a.R a.G a.B a.Z", "a.B a.G a.R", {"a.Z": "depth"}),
        ("Y A Depth", "Y A", {"Depth": "depth"}),
        ("R G B a.R a.G a.B", "B G R", {"a": "linear"}),
        ("a.R a.G a.B b.R b.G b.B", "", {"a": "linear", "b": "linear"}),
        ("a.R a.G a.B beauty.R beauty.G beauty.B", "beauty.B beauty.G beauty.R", {"a": "linear"}),
        ("F.Combined.R F.Combined.G F.Combined.B B.Combined.R B.Combined.G B.Combined.B",
         "B.Combined.B B.Combined.G B.Combined.R", {"F.Combined": "linear"}),
        (" ".join(blender()), " ".join(f"ViewLayer.Combined.{each}" for each in "BGRA"), {
            "ViewLayer.DiffCol": "linear", "ViewLayer.Normal": "normals", "ViewLayer.Vector": "nearest",
            "ViewLayer.CryptoObject00": "nearest", "ViewLayer.Depth": "depth", "ViewLayer.IndexOB": "nearest",
        }),
    ],
)  # fmt: skip
def test_the_picture_and_the_rest(channels, picture, layers):
    """Plain colours first, then the only layer with colours, then the first with the name of a picture."""
    found = contents_of(read_exr_header(save(("", {name: numbers(1) for name in channels.split()}))))
    assert found.picture == picture.split()
    assert {layer.name: layer.kind for layer in found.layers} == layers


def test_parts_are_layers():
    """Named like their part, whether their channels say so too or not; the first part leads, also as an image."""
    rgb = {each: numbers(seed) for seed, each in enumerate("RGB")}
    others = {"depth.Z": numbers(7, np.float32)}, {"X": numbers(8, np.uint32)}
    found = contents_of(read_exr_header(save(("main", rgb), ("depth", others[0]), ("id", others[1]))))
    assert found.picture == ["main.B", "main.G", "main.R"]
    assert {layer.name: layer.kind for layer in found.layers} == {"depth": "depth", "id": "nearest"}
    np.testing.assert_array_equal(read_image(HERE), np.dstack([rgb[each] for each in "BGR"]))


@pytest.mark.parametrize(
    ("kind", "names"),
    [
        ("depth", "Z:1, VRayZDepth:1"),
        ("normals", "Denoising Normal:3, N:3, sh_normal:3"),
        ("nearest", "crypto_object02:4, cryptomatte:3, motionvector:3, shape_index:1"),
        ("nearest", "ViewLayer.Object Index:1, ViewLayer.Material Index:1"),
        ("linear", "Scene.Mist:1, N:1, P:3, Depth:3"),
    ],
)
def test_what_a_layer_is(kind, names):
    """By the last word of its name; depth has one channel and normals three; whole numbers are never mixed."""
    for name, count in (each.split(":") for each in names.split(", ")):
        assert kind_of(name, ["half"] * int(count)) == kind
        assert kind_of(name, ["uint"] * int(count)) == "nearest"


HEADERS = {
    "scanlines": {},
    "tiles": tiles(16),
    "from below": {"lineOrder": OpenEXR.DECREASING_Y},
    "piz": {"compression": OpenEXR.PIZ_COMPRESSION},
    "rows": {"compression": OpenEXR.ZIPS_COMPRESSION},
    "plain": {"compression": OpenEXR.NO_COMPRESSION},
    "lossy": {"compression": OpenEXR.DWAA_COMPRESSION, "dwaCompressionLevel": 200.0},
}


@pytest.mark.parametrize("several", [False, True])
@pytest.mark.parametrize("header", HEADERS.values(), ids=HEADERS)
def test_a_file_made_like_another_is_that_file(header, several):
    """Byte for byte where its pixels are the same: parts, names, types, compression, order of lines, attributes."""
    said = {"cryptomatte/abc/name": "CryptoObject", "number": 3, "share": 0.5, "owner": "Ä", "two": (1, 2)} | header
    said |= {"chromaticities": (0.7, 0.3, 0.2, 0.7, 0.1, 0.1, 0.3, 0.3), "matrix": np.eye(3, dtype=np.float32)}
    parts = [("", blender() | {"x" * 40: numbers(3), "Y": numbers(4), "A": numbers(5)})]
    if several:
        parts = [("View.Combined", {each: numbers(1) for each in "RGBA"}), ("View.id", {"X": numbers(2, np.uint32)})]
    path = save(*parts, **said)
    data, before = path.read_bytes(), read_exr_header(path)
    channels = content(path)
    for part, own in parts:
        for name, plane in own.items():
            found = channels[f"{part}.{name}" if part else name]
            assert found.dtype == plane.dtype
            assert header.get("compression") == OpenEXR.DWAA_COMPRESSION or np.array_equal(found, plane)
    path.write_bytes(encode_exr_like(before, channels))
    if header.get("compression") != OpenEXR.DWAA_COMPRESSION:  # whose pixels change when they are encoded once more
        assert path.read_bytes() == data
    after = read_exr_header(path)
    assert [repr(part.attributes) for part in after.parts] == [repr(part.attributes) for part in before.parts]
    assert after.channels == before.channels


def test_data_fills_the_display_window():
    """Whatever window the source has pixels in."""
    path = save(("", {"Y": numbers(1)}), dataWindow=window(5, 7, WIDTH, HEIGHT), displayWindow=window(0, 0, 100, 80))
    planes = content(path)
    path.write_bytes(encode_exr_like(read_exr_header(path), planes))
    header = read_exr_header(path)
    assert header.parts[0].data == header.display == (0, 0, 99, 79)
    np.testing.assert_array_equal(content(path)["Y"], planes["Y"])


@pytest.mark.parametrize(
    ("names", "expected"),
    [
        ("beauty", set()),
        ("DiffCol", {"DiffCol"}),
        ("ViewLayer.DiffCol, Depth", {"DiffCol", "Depth"}),
        ("Combined,Depth", {"Depth"}),
        ("all", {"DiffCol", "Depth", "Normal", "Vector", "CryptoObject00", "IndexOB"}),
    ],
)
def test_layers_are_chosen_by_name(names, expected):
    """With their view layer or without."""
    chosen = Passes.chosen(save(("", blender())), names)
    assert {layer.name.removeprefix("ViewLayer.") for layer in chosen.layers} == expected


@pytest.mark.parametrize(
    ("change", "sentence"),
    [
        (lambda channels: channels.pop("ViewLayer.Depth.Z"), r"b\.exr has no layer ViewLayer\.Depth with the channels"),
        (lambda channels: channels.update(More=numbers(1)), r"b\.exr has a layer More, which a\.exr has not"),
        (lambda channels: channels.pop("ViewLayer.Vector.W"), r"b\.exr has no layer ViewLayer\.Vector with the"),
        (
            lambda channels: channels.update({"ViewLayer.Depth.Z": numbers(1)}),
            r"b\.exr has no layer ViewLayer\.Depth with the channels and types of a\.exr",
        ),
    ],
)
def test_frames_with_other_layers_are_refused(change, sentence):
    """One sentence names the file, the layer and what to do."""
    chosen, channels = Passes.chosen(save(("", blender())), "all"), blender()
    change(channels)
    with pytest.raises(InputError, match=sentence + r".*; render all frames with the same passes"):
        chosen.read(save(("", channels), path=Path("b.exr")), None)


def test_views_are_refused_unless_the_picture_is_enough():
    """What one eye sees moves differently from what the other one does."""
    rgb = {each: numbers(seed) for seed, each in enumerate("RGB")}
    parts = [OpenEXR.Part({"view": view}, dict(rgb), view) for view in ("left", "right")]
    with OpenEXR.File(parts) as file:
        file.write(str(HERE))
    with pytest.raises(InputError, match=r"several views \(left, right\).*`passes='beauty'`"):
        Passes.chosen(HERE, "all")
    assert Passes.chosen(HERE, "beauty").layers == ()
