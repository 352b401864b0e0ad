"""A renderer's motion vectors: files, folders, and motion fields made of them."""

import pickle
import struct
from fractions import Fraction
from pathlib import Path

import numpy as np
import pytest

from fpsboost import FrameCache, InputError, OptionError, VectorFolder
from fpsboost.io.side.flow import encode_flow, read_flow
from fpsboost.motion.rendered import RenderedMotion
from support.exr_truth import write_exr
from support.truth import noise
from support.vector_truth import constant, save_depth, save_flows, save_translation, save_vectors

SIZE = HEIGHT, WIDTH = 12, 18


def placed(number: Fraction | int | None, size: tuple[int, int] = SIZE) -> FrameCache:
    return FrameCache(noise(*size), None if number is None else Fraction(number))


def random_flow(seed: int) -> np.ndarray:
    return np.random.default_rng(seed).normal(0, 5, (*SIZE, 2)).astype(np.float32)


def test_flow_files_are_as_others_write_them(tmp_path):
    """The bytes of the format, written out by hand."""
    data = b"PIEH" + struct.pack("<ii", 2, 1) + struct.pack("<4f", 1.5, -2, 3, 2e9)
    (tmp_path / "a.flo").write_bytes(data)
    flow = read_flow(tmp_path / "a.flo")
    np.testing.assert_array_equal(flow, np.array([[[1.5, -2], [3, np.nan]]], np.float32))
    assert flow.flags.writeable
    (tmp_path / "b.flo").write_bytes(encode_flow(flow))
    assert (tmp_path / "b.flo").read_bytes() == data[:-4] + struct.pack("<f", 1e10)


@pytest.mark.parametrize(
    ("data", "message"),
    [
        (b"", "no .flo file"),
        (b"PIEH", "no .flo file"),
        (b"HEIP" + bytes(20), "no .flo file"),
        (b"PIEH" + struct.pack("<ii", 2, 1) + bytes(15), "2x1 vectors but has 27 bytes"),
        (b"PIEH" + struct.pack("<ii", 2, 1) + bytes(17), "2x1 vectors but has 29 bytes"),
        (b"PIEH" + struct.pack("<ii", 2**31 - 1, 2**31 - 1), "2147483647x2147483647 vectors but has 12 bytes"),
        (b"PIEH" + struct.pack("<ii", -1, -1) + bytes(8), "-1x-1"),
        (b"PIEH" + struct.pack("<ii", 0, 5), "0x5"),
    ],
)
def test_damaged_flow_files_are_named(tmp_path, data, message):
    """By magic number and by length, before memory is taken."""
    (tmp_path / "a.flo").write_bytes(data)
    with pytest.raises(InputError, match=rf"a\.flo .*{message}"):
        read_flow(tmp_path / "a.flo")


def test_y_points_up_in_openexr(tmp_path):
    """What falls by 3 pixels was above (Y = 3) and will be below (W = 3); what goes right by 5 came from the left."""
    channels = {"X": -5.0, "Y": 3.0, "Z": -5.0, "W": 3.0}
    write_exr(tmp_path / "1.exr", {name: np.full(SIZE, value, np.float32) for name, value in channels.items()})
    vectors = VectorFolder(tmp_path).at(0)
    np.testing.assert_array_equal(vectors.backward, constant(*SIZE, -5, -3))
    np.testing.assert_array_equal(vectors.forward, constant(*SIZE, 5, 3))
    assert vectors.backward.dtype == vectors.forward.dtype == np.float32
    assert vectors.depth is None


@pytest.mark.parametrize("layer", ["", "View Layer.Vector.", "Vector.", "motion."])
def test_the_layer_with_vectors_is_found(tmp_path, layer):
    """Plain names, Blender's layers, and any other, among channels that are none."""
    save_vectors(tmp_path / "1.exr", random_flow(1), random_flow(2), layer)
    vectors = VectorFolder(tmp_path).at(0)
    np.testing.assert_array_equal(vectors.backward, random_flow(1))
    np.testing.assert_array_equal(vectors.forward, random_flow(2))


def test_the_first_file_is_the_first_frame(tmp_path):
    """Whatever its number; a pattern chooses one sequence of a folder, and other files do not matter."""
    for number in range(98, 102):
        save_vectors(tmp_path / f"Vector{number}.exr", constant(*SIZE, number, 0), constant(*SIZE, 0, number))
        save_depth(tmp_path / f"Depth{number}.exr", np.full(SIZE, number, np.float32))
    (tmp_path / "notes.txt").write_text("mine")
    with pytest.raises(InputError, match=r"several sequences .*Depth##\.exr, Vector##\.exr.*pattern such as"):
        VectorFolder(tmp_path)
    folder = VectorFolder(tmp_path / "Vector##.exr", tmp_path / "Depth##.exr")
    for index in (3, 0, 2, 1, 0):
        vectors = folder.at(index)
        assert (vectors.backward[0, 0, 0], vectors.depth[0, 0]) == (98 + index, 98 + index)
    assert repr(folder) == f"VectorFolder({str(tmp_path / 'Vector##.exr')!r}, depth={str(tmp_path / 'Depth##.exr')!r})"


def depth_file(path: Path, *names: str) -> Path:
    write_exr(path, {name: np.full(SIZE, index, np.float32) for index, name in enumerate(names)}, half=False)
    return path


@pytest.mark.parametrize(
    ("names", "expected"),
    [
        (["anything"], 0),
        (["R", "G", "B", "Z"], 3),
        (["A", "Depth"], 1),
        (["A", "V", "Y"], 1),
        (["X", "Y", "Z", "W", "View.Depth.Z"], 4),
        (["View.Vector.X", "View.Vector.Z", "View.Depth.V"], 2),
        (["X", "Y", "Z", "W", "Depth"], 4),
    ],
)
def test_the_channel_with_depth_is_found(tmp_path, names, expected):
    """The only one, a layer's, or the plain name, but not the Z of a vector."""
    (tmp_path / "d").mkdir()
    depth_file(tmp_path / "d" / "1.exr", *names)
    save_translation(tmp_path / "v", 1, SIZE, 1, 0)
    depth = VectorFolder(tmp_path / "v", tmp_path / "d").at(0).depth
    np.testing.assert_array_equal(depth, np.full(SIZE, expected, np.float32))


def test_what_has_no_depth_is_infinitely_far(tmp_path):
    """NaN and infinity alike."""
    depth = np.full(SIZE, 3, np.float32)
    depth[0, :3] = np.nan, np.inf, 1e10
    save_depth(tmp_path / "d" / "1.exr", depth)
    read = VectorFolder(save_translation(tmp_path / "v", 1, SIZE, 1, 0), tmp_path / "d").at(0).depth
    assert read[0, :4].tolist() == [np.inf, np.inf, np.float32(1e10), 3]


@pytest.fixture(scope="module")
def files(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Folders of vectors and of depth, sound and faulty ones."""
    files = tmp_path_factory.mktemp("files")
    for name in ("sound", "gap"):
        save_translation(files / name, 4, SIZE, 1, 0)
    (files / "gap" / "v_0002.exr").unlink()
    for name, size in {"depth": SIZE, "small depth": (5, 6)}.items():
        save_depth(files / name / "1.exr", np.ones(size, np.float32))
    for name in ("lone", "unnamed", "mixed"):
        save_flows(files / name, "0001", random_flow(1), random_flow(2))
    (files / "lone" / "0002_forward.flo").write_bytes(encode_flow(random_flow(3)))
    (files / "unnamed" / "0002.flo").touch()
    save_vectors(files / "mixed" / "0001.exr", random_flow(1), random_flow(2))
    save_flows(files / "unlike", "1", random_flow(1), random_flow(2)[:-1])
    for name in ("colours", "empty"):
        (files / name).mkdir()
    depth_file(files / "colours" / "1.exr", "R", "G", "B")
    (files / "file").touch()
    return files


@pytest.mark.parametrize(
    ("vectors", "depth", "frame", "message"),
    [
        ("none", None, 0, "none is not a folder with motion vectors"),
        ("file", None, 0, "file is not a folder with motion vectors"),
        ("empty", None, 0, "empty contains no motion vectors"),
        ("v_##.exr", None, 0, r"No image is named like .*v_##\.exr"),
        ("none/v_##.exr", None, 0, r"none/v_##\.exr .No such file"),
        ("v_##.flo", None, 0, "is not a folder"),
        ("sound", "none", 0, "none is not a folder with depth"),
        ("sound", None, 4, "sound has no vectors for output frame 4; .*4 are there"),
        ("sound", None, -1, "sound has no vectors for output frame -1; .*4 are there"),
        ("sound", "depth", 1, "depth has no depth for output frame 1; .*1 are there"),
        ("gap", None, 0, r"v_0002\.exr is missing"),
        ("lone", None, 0, r"0002_forward\.flo has no partner 0002_backward\.flo"),
        ("unnamed", None, 0, r"0002\.flo is neither"),
        ("mixed", None, 0, r"both \.exr and \.flo"),
        ("unlike", None, 0, r"1_backward\.flo and 1_forward\.flo differ in size"),
        ("sound", "small depth", 0, r"1\.exr has 6x5 pixels, and the vectors have 18x12"),
        ("colours", None, 0, r"1\.exr has no motion vectors among its channels \(B, G, R\).*X, Y, Z and W"),
        ("sound", "colours", 0, r"1\.exr has no depth among its channels \(B, G, R\)"),
    ],
)
def test_what_cannot_be_read_is_named(files, vectors, depth, frame, message):
    """Files that are missing, of mixed kinds, of unlike sizes, or without the channels; each is one sentence."""
    with pytest.raises(InputError, match=message):
        VectorFolder(files / vectors, depth and files / depth).at(frame)


def test_vectors_have_the_size_of_the_frames(files):
    """Others are refused when frames are known."""
    with pytest.raises(InputError, match="sound has vectors for 18x12 pixels, and the frames have 6x5"):
        RenderedMotion(VectorFolder(files / "sound")).estimate(placed(0, (5, 6)), placed(1, (5, 6)))


@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf])
def test_vectors_that_are_no_numbers_are_counted(tmp_path, value):
    """In either kind of file; the unknown motion of .flo files too."""
    spoiled = random_flow(1)
    spoiled[3, 4:6, 1] = value
    save_vectors(tmp_path / "e" / "1.exr", random_flow(2), spoiled)
    save_flows(tmp_path / "f", "1", random_flow(2), spoiled)
    for folder, name in (("e", "1.exr"), ("f", "1_forward.flo")):
        with pytest.raises(InputError, match=f"{name} has 2 motion vectors that are unknown"):
            VectorFolder(tmp_path / folder).at(0)


@pytest.mark.parametrize("span", [1, 2, 5])
def test_vectors_are_made_as_long_as_the_pair(tmp_path, span):
    """Forward from the first, backward from the second, times the output frames between."""
    for number in range(8):
        save_vectors(tmp_path / f"{number}.exr", random_flow(number), random_flow(50 + number))
    field01, field10 = RenderedMotion(VectorFolder(tmp_path)).estimate(placed(2), placed(2 + span))
    np.testing.assert_array_equal(field01.flow, random_flow(52) * np.float32(span))
    np.testing.assert_array_equal(field10.flow, random_flow(2 + span) * np.float32(span))
    assert field01.flow.dtype == field10.flow.dtype == field01.similarity.dtype == np.float32
    assert (field01.similarity == 1).all()


@pytest.mark.parametrize(("place0", "place1"), [(None, None), (0, Fraction(5, 2)), (Fraction(5, 2), 5), (0, None)])
def test_frames_between_output_frames_have_no_vectors(tmp_path, place0, place1):
    """A factor that is not whole, or images that nobody placed: the message asks for a whole factor."""
    motion = RenderedMotion(VectorFolder(save_translation(tmp_path, 6, SIZE, 1, 0)))
    with pytest.raises(OptionError, match=r"need a whole factor.*`factor=2`"):
        motion.estimate(placed(place0), placed(place1))


def test_vectors_in_another_process(tmp_path, monkeypatch):
    """Pickled, a folder is found from any place, with the same vectors."""
    save_vectors(tmp_path / "1.exr", random_flow(1), random_flow(2), "")
    monkeypatch.chdir(tmp_path.parent)
    sent = pickle.dumps(VectorFolder(tmp_path.name))
    monkeypatch.chdir("/")
    folder = pickle.loads(sent)
    assert folder.files == [tmp_path / "1.exr"]
    np.testing.assert_array_equal(folder.at(0).backward, random_flow(1))
