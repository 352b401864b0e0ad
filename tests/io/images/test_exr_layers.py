"""Layers of OpenEXR files: which are there, what each is, and files that are made like others."""

from __future__ import annotations

import io
import struct
from contextlib import suppress
from pathlib import Path

import numpy as np
import OpenEXR
import pytest
from hypothesis import given
from hypothesis import strategies as st

from fpsboost.errors import InputError
from fpsboost.io.images.exr import decode_channels, encode_exr_like, read_exr
from fpsboost.io.images.exr_header import MAGIC, ExrHeader, parse_exr_header
from fpsboost.io.images.exr_layers import contents_of, kind_of
from fpsboost.io.images.files import read_image
from fpsboost.io.images.passes import Passes, encode_like

HEIGHT, WIDTH = 40, 60
HERE = Path("a.exr")
Channels = dict[str, np.ndarray]


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


def content(*parts: tuple[str, Channels], **header: object) -> bytes:
    """Return a file; of one part if that has no name."""
    kind = {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage, **header}
    stream = io.BytesIO()
    copies = [(name, {each: plane.copy() for each, plane in channels.items()}) for name, channels in parts]
    whole = [OpenEXR.Part(dict(kind), channels, name) for name, channels in copies]
    with OpenEXR.File(whole) if parts[0][0] else OpenEXR.File(kind, copies[0][1]) as file:
        file.write(stream)
    return stream.getvalue()


def parsed(data: bytes) -> ExrHeader:
    return parse_exr_header(HERE, data)


def tiles(side: int) -> dict[str, object]:
    description = OpenEXR.TileDescription()
    description.xSize = description.ySize = side
    return {"type": OpenEXR.tiledimage, "tiles": description}


def window(left: int, top: int, width: int, height: int) -> tuple[np.ndarray, np.ndarray]:
    return np.array([left, top], np.int32), np.array([left + width - 1, top + height - 1], np.int32)


# --------------------------------------------------------------------------------------------------------- which layers


def test_blenders_layers():
    """The combined colours lead; every other layer is what its name says."""
    found = contents_of(parsed(content(("", blender()))))
    assert found.picture == [f"ViewLayer.Combined.{each}" for each in "BGRA"]
    assert {layer.name.removeprefix("ViewLayer."): layer.kind for layer in found.layers} == {
        "DiffCol": "linear",
        "Normal": "normals",
        "Vector": "nearest",
        "CryptoObject00": "nearest",
        "Depth": "depth",
        "IndexOB": "nearest",
    }


@pytest.mark.parametrize(
    ("name", "channels", "kind"),
    [
        ("Scene.Mist", 1, "linear"),
        ("Z", 1, "depth"),
        ("Denoising Normal", 3, "normals"),
        ("N", 3, "normals"),
        ("N", 1, "linear"),
        ("crypto_object02", 4, "nearest"),
        ("cryptomatte", 3, "nearest"),
        ("P", 3, "linear"),
        ("motionvector", 3, "nearest"),
        ("VRayZDepth", 1, "depth"),
        ("sh_normal", 3, "normals"),
        ("shape_index", 1, "nearest"),
        ("ViewLayer.Object Index", 1, "nearest"),
        ("ViewLayer.Material Index", 1, "nearest"),
        ("Depth", 3, "linear"),
    ],
)
def test_what_a_layer_is(name, channels, kind):
    """By the last word of its name; depth has one channel and normals three."""
    assert kind_of(name, ["half"] * channels) == kind


def test_whole_numbers_are_never_mixed():
    """Whatever their layer is called."""
    assert kind_of("DiffCol", ["uint"]) == "nearest"


@pytest.mark.parametrize(
    ("channels", "picture", "layers"),
    [
        ("R G B A Z id N.X N.Y N.Z", "BGRA", {"Z": "depth", "id": "linear", "N": "normals"}),
        ("a.R a.G a.B a.Z", ["a.B", "a.G", "a.R"], {"a.Z": "depth"}),
        ("Y A Depth", "YA", {"Depth": "depth"}),
        ("R G B a.R a.G a.B", "BGR", {"a": "linear"}),
        ("a.R a.G a.B b.R b.G b.B", "", {"a": "linear", "b": "linear"}),
        ("a.R a.G a.B beauty.R beauty.G beauty.B", ["beauty.B", "beauty.G", "beauty.R"], {"a": "linear"}),
    ],
)
def test_the_picture_and_the_rest(channels, picture, layers):
    """Plain colours first, then the only layer with colours, then the only one with the name of a picture."""
    found = contents_of(parsed(content(("", {name: numbers(1) for name in channels.split()}))))
    assert found.picture == list(picture)
    expected = {name: "nearest" if name == "id" else kind for name, kind in layers.items()}
    assert {layer.name: layer.kind for layer in found.layers} == expected


def test_of_several_view_layers_the_first_leads():
    """And the others are known by name."""
    names = [f"{layer}.Combined.{each}" for layer in ("Front", "Back") for each in "RGB"]
    found = contents_of(parsed(content(("", {name: numbers(1) for name in names}))))
    assert found.pictures == ["Back.Combined", "Front.Combined"]
    assert found.picture[0] == "Back.Combined.B"
    assert [layer.name for layer in found.layers] == ["Front.Combined"]


def test_parts_are_layers():
    """Named like their part, whether their channels say so too or not; the first part leads."""
    rgb = {each: numbers(seed) for seed, each in enumerate("RGB")}
    others = {"depth.Z": numbers(7, np.float32)}, {"X": numbers(8, np.uint32)}
    data = content(("main", rgb), ("depth", others[0]), ("id", others[1]))
    found = contents_of(parsed(data))
    assert found.picture == ["main.B", "main.G", "main.R"]
    assert {layer.name: layer.kind for layer in found.layers} == {"depth": "depth", "id": "nearest"}


# ---------------------------------------------------------------------------------------------------------- the numbers


def all_of(data: bytes) -> Channels:
    header = parsed(data)
    return decode_channels(HERE, data, header, list(header.channels), None)


@pytest.mark.parametrize("kind", [{}, tiles(16)], ids=["scanlines", "tiles"])
def test_several_parts_are_read(tmp_path, kind):
    """Each channel of each part, in its own type and to the bit; the picture as an image."""
    parts = [("rgba", {each: numbers(seed) for seed, each in enumerate("RGB")}), ("id", {"X": numbers(9, np.uint32)})]
    data = content(*parts, **kind)
    found = all_of(data)
    assert found.keys() == {"rgba.R", "rgba.G", "rgba.B", "id.X"}
    for part, channels in parts:
        for name, plane in channels.items():
            assert found[f"{part}.{name}"].dtype == plane.dtype
            np.testing.assert_array_equal(found[f"{part}.{name}"], plane)
    (tmp_path / "a.exr").write_bytes(data)
    np.testing.assert_array_equal(read_image(tmp_path / "a.exr"), np.dstack([parts[0][1][each] for each in "BGR"]))
    assert read_exr(tmp_path / "a.exr", lambda names: ["id.X"])["id.X"].dtype == np.float32


@pytest.mark.parametrize("kept", [200, 600, 900, 0.5, -1])
def test_several_parts_that_end_early_are_refused(capfd, kept):
    """Wherever the file is cut: one sentence, and nothing printed."""
    data = content(("a", {"Y": numbers(1)}), ("b", {"Z": numbers(2)}))
    with pytest.raises(InputError, match=r"a\.exr is damaged or no OpenEXR file"):
        all_of(data[: int(kept * len(data)) if isinstance(kept, float) else kept])
    assert capfd.readouterr() == ("", "")


@given(st.integers(0, 900), st.integers(0, 255))
def test_any_other_byte_in_the_headers_of_parts_is_an_image_or_an_error(place, value):
    """Never another exception than ours."""
    small = np.ones((3, 4), np.float32)
    data = bytearray(content(("a", {"Y": small}), ("b", {"Z": small})))
    data[min(place, len(data) - 1)] = value
    with suppress(InputError):
        assert isinstance(all_of(bytes(data)), dict)


def test_a_chunk_of_another_part_is_damage():
    """The table of a part leads to its own chunks."""
    data = bytearray(content(("a", {"Y": numbers(1)}), ("b", {"Z": numbers(2)})))
    first = int(parsed(bytes(data)).parts[1].chunks[0])
    data[first : first + 4] = struct.pack("<i", 0)
    with pytest.raises(InputError, match="damaged"):
        parsed(bytes(data))


# ------------------------------------------------------------------------------------------------------- made like them

HEADERS = {
    "scanlines": {},
    "tiles": tiles(16),
    "from below": {"lineOrder": OpenEXR.DECREASING_Y},
    "piz": {"compression": OpenEXR.PIZ_COMPRESSION},
    "rows": {"compression": OpenEXR.ZIPS_COMPRESSION},
    "plain": {"compression": OpenEXR.NO_COMPRESSION},
}


@pytest.mark.parametrize("several", [False, True])
@pytest.mark.parametrize("header", HEADERS.values(), ids=HEADERS)
def test_a_file_made_like_another_is_that_file(header, several):
    """Byte for byte where its pixels are the same: parts, names, types, compression, order of lines, attributes."""
    said = {"cryptomatte/abc/name": "CryptoObject", "number": 3, "share": 0.5, "owner": "Ä"} | header
    parts = [("", blender())]
    if several:
        parts = [("View.Combined", {each: numbers(1) for each in "RGBA"}), ("View.id", {"X": numbers(2, np.uint32)})]
    data = content(*parts, **said)
    assert encode_exr_like(parsed(data), all_of(data)) == data


def test_lossy_compression_keeps_its_level():
    """DWAA as strong as it was."""
    smooth = np.linspace(0, 1, HEIGHT * WIDTH, dtype=np.float32).reshape(HEIGHT, WIDTH)
    data = content(("", {"Y": smooth}), compression=OpenEXR.DWAA_COMPRESSION, dwaCompressionLevel=200.0)
    again = encode_exr_like(parsed(data), {"Y": smooth})
    assert again == data


def test_attributes_keep_types_that_the_library_would_change():
    """A double, and a type that nobody knows."""
    data = content(("", {"Y": numbers(1)}))
    header = data.index(b"channels\0")
    strange = (
        b"weight\0double\0" + struct.pack("<id", 8, 0.1) + b"mystery\0vendortype\0" + struct.pack("<i", 3) + b"abc"
    )
    shifted = data[:header] + strange + data[header:]
    table = parsed(data).tables + len(strange)
    chunks = (parsed(data).parts[0].chunks + len(strange)).astype("<u8").tobytes()
    source = shifted[:table] + chunks + shifted[table + len(chunks) :]
    assert encode_exr_like(parsed(source), all_of(source)) == source


def test_only_the_planes_that_are_given_are_written():
    """A part without any is left out; what is left says the same as before."""
    parts = [("View.Combined", {each: numbers(1) for each in "RGB"}), ("id", {"X": numbers(2, np.uint32)})]
    data = content(*parts, owner="me")
    planes = {name: plane for name, plane in all_of(data).items() if name != "id.X"}
    header = parsed(encode_exr_like(parsed(data), planes))
    assert [set(part.channels) for part in header.parts] == [{"R", "G", "B"}]
    assert header.parts[0].attributes["owner"].value == b"me"


def test_data_fills_the_display_window():
    """Whatever window the source has pixels in."""
    data = content(("", {"Y": numbers(1)}), dataWindow=window(5, 7, WIDTH, HEIGHT), displayWindow=window(0, 0, 100, 80))
    planes = all_of(data)
    again = encode_exr_like(parsed(data), planes)
    assert parsed(again).parts[0].data == parsed(again).display == (0, 0, 99, 79)
    np.testing.assert_array_equal(all_of(again)["Y"], planes["Y"])


def test_the_library_reads_what_was_made():
    """The newer reader, too, with the attributes."""
    data = content(("one", {"Y": numbers(1)}), ("two", {"Z": numbers(2, np.float32)}), owner="me")
    again = encode_exr_like(parsed(data), {name: plane[::-1] for name, plane in all_of(data).items()})
    with OpenEXR.File(io.BytesIO(again), separate_channels=True) as file:
        assert [part.name() for part in file.parts] == ["one", "two"]
        assert file.header(1)["owner"] == "me"
        np.testing.assert_array_equal(file.channels(1)["Z"].pixels, numbers(2, np.float32)[::-1])


def test_long_names_are_marked():
    """As the format asks for names of more than 31 bytes."""
    name = "ViewLayer." + "long" * 10 + ".R"
    data = content(("", {name: numbers(1), "Y": numbers(2)}))
    again = encode_exr_like(parsed(data), all_of(data))
    assert again == data
    assert struct.unpack("<I", again[len(MAGIC) : 8])[0] & 0x400


def test_gray_with_alpha_comes_back_as_gray():
    """It is read as BGRA, and written as Y and A."""
    data = content(("", {"Y": numbers(1), "A": numbers(2)}))
    image = Passes.chosen(HERE, data, "beauty").decode(HERE, data, None)
    assert image.shape == (HEIGHT, WIDTH, 4)
    assert encode_like(parsed(data), image) == data


# --------------------------------------------------------------------------------------------------------------- chosen


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
    chosen = Passes.chosen(HERE, content(("", blender())), names)
    assert {layer.name.removeprefix("ViewLayer.") for layer in chosen.layers} == expected


def test_a_layer_that_is_not_there_is_named():
    """With those that are."""
    with pytest.raises(
        InputError, match=r"a\.exr has no layer 'Gloss' .*: ViewLayer\.CryptoObject00, ViewLayer\.Depth"
    ):
        Passes.chosen(HERE, content(("", blender())), "Depth,Gloss")


@pytest.mark.parametrize(
    ("change", "sentence"),
    [
        (lambda channels: channels.pop("ViewLayer.Depth.Z"), r"b\.exr has no layer ViewLayer\.Depth, which a\.exr has"),
        (lambda channels: channels.update(More=numbers(1)), r"b\.exr has a layer More, which a\.exr has not"),
        (
            lambda channels: channels.pop("ViewLayer.Vector.W"),
            r"b\.exr has other channels in the layer ViewLayer\.Vector",
        ),
        (
            lambda channels: channels.update({"ViewLayer.Depth.Z": numbers(1)}),
            r"b\.exr has ViewLayer\.Depth\.Z as half, and a\.exr as float",
        ),
    ],
)
def test_frames_with_other_layers_are_refused(change, sentence):
    """One sentence names the file, the layer and what to do."""
    chosen, channels = Passes.chosen(HERE, content(("", blender())), "all"), blender()
    change(channels)
    with pytest.raises(InputError, match=sentence + r".*; render all frames with the same passes"):
        chosen.decode(Path("b.exr"), content(("", channels)), None)


def test_views_are_refused_unless_the_picture_is_enough():
    """What one eye sees moves differently from what the other one does."""
    rgb = {each: numbers(seed) for seed, each in enumerate("RGB")}
    parts = [OpenEXR.Part({"view": view}, dict(rgb), view) for view in ("left", "right")]
    stream = io.BytesIO()
    with OpenEXR.File(parts) as file:
        file.write(stream)
    with pytest.raises(InputError, match=r"several views \(left, right\).*`passes='beauty'`"):
        Passes.chosen(HERE, stream.getvalue(), "all")
    assert Passes.chosen(HERE, stream.getvalue(), "beauty").layers == ()
