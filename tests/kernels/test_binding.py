"""Calls of compiled kernels: their records, and what they refuse."""

import shutil
import subprocess
import sys

import numpy as np
import pytest
from recorded_calls import KERNELS

from fpsboost.kernels import binding
from fpsboost.kernels.block import SearchPlan, match_blocks
from fpsboost.kernels.candidates import list_candidates, no_votes
from fpsboost.kernels.level_search import PADDING, OffsetLists, Proposals, search_tiles
from fpsboost.kernels.pair_context import count_landings
from fpsboost.kernels.planes import CodeLevels, split_planes
from fpsboost.kernels.reproject import fetch_both, splat
from support.planes import plane_pair
from support.truth import noise

ROOT = binding.LIBRARY.parents[2]

ENDS = ((), np.int32), ((2,), np.float32), ((2, 2), np.float32), ((), np.float32)
"""Of the shapes of lists of two offsets, and their types."""


@pytest.mark.parametrize("name", KERNELS)
def test_a_kernel_stands_in_files_of_one_name(name):
    """Its description in Python, and its definition in C++."""
    module = KERNELS[name].__module__.rpartition(".")[2]
    assert f", {name}, " in binding.LIBRARY.with_name(f"{module}.cpp").read_text("utf-8")


@pytest.mark.parametrize("name", KERNELS)
def test_records_have_the_same_layout_where_they_are_compiled(name):
    """The build, which only reads the annotations, finds the fields, types and axes that calls have."""
    build = pytest.importorskip("hatch_build")
    assert build.Descriptions().layouts[name.title().replace("_", "")] == binding.arguments_of(KERNELS[name]).layout


@pytest.mark.parametrize(
    ("points", "landings", "error", "said"),
    [
        (np.zeros((4, 4, 5)), np.zeros((4, 4), np.float32), TypeError, "points must be float32, not float64"),
        (np.zeros((4, 4), np.float32), np.zeros((4, 4), np.float32), ValueError, r"points must have the shape"),
        (np.zeros((4, 4, 6), np.float32), np.zeros((4, 4), np.float32), ValueError, r"columns, 5\), not \(4, 4, 6\)"),
        (np.zeros((4, 4, 5), np.float32), np.zeros((4, 8), np.float32)[:, ::2], ValueError, "must be contiguous"),
    ],
)  # fmt: skip
def test_wrong_arrays_are_refused(points, landings, error, said):
    """Before C++ reads or writes them."""
    with pytest.raises(error, match=said):
        count_landings(points, np.float32(0.5), 8, landings)


def test_an_array_that_is_written_must_not_be_read_only():
    """One that is only read may be."""
    points, landings = np.zeros((4, 4, 5), np.float32), np.zeros((4, 4), np.float32)
    points.flags.writeable = False
    count_landings(points, 0.5, 8, landings)
    landings.flags.writeable = False
    with pytest.raises(ValueError, match="count_landings: landings is written, so it must not be read-only"):
        count_landings(points, 0.5, 8, landings)


def test_a_level_that_the_processor_does_not_have_is_refused(monkeypatch):
    """By name, instead of ending in an illegal instruction."""
    monkeypatch.setenv("FPSBOOST_CPU", "avx1024")
    with pytest.raises(ImportError, match="FPSBOOST_CPU is avx1024, and this processor has baseline"):
        binding.processor_level.__wrapped__()


def code_planes(luma=(64, 64), cb=(32, 32), cr=(32, 32), planes=(3, 128, 128), kinds=("uint8",) * 3):
    """Split planes of these sizes and types, with a padding of 32 pixels."""
    given = [np.zeros(size, kind) for size, kind in zip((luma, cb, cr), kinds, strict=True)]
    levels = CodeLevels(*map(np.float32, (16, 1 / 219, 128, 1 / 224)))
    split_planes(*given, levels, np.float32(255), np.float32(128), 32, np.zeros(planes, np.uint8))


@pytest.mark.parametrize(
    ("wrong", "error", "said"),
    [
        ({"planes": (3, 40, 40)}, ValueError, r"with rows = 40, height = 64, padding = 32, not \(3, 40, 40\)"),
        ({"planes": (3, 128, 127)}, ValueError, "columns = 127, width = 64, padding = 32"),
        ({"cb": (1, 1), "cr": (1, 1)}, ValueError, r"cb_plane must have the shape .* not \(1, 1\)"),
        ({"cr": (32, 64)}, ValueError, r"with across = 32, width = 64, not \(32, 64\)"),
        ({"kinds": ("uint8", "uint16", "uint8")}, TypeError, "cb_plane must be uint8 here, not uint16"),
    ],
)  # fmt: skip
def test_arrays_that_do_not_fit_each_other_are_refused(wrong, error, said):
    """Sizes, sizes that follow from others and from numbers, and types, instead of damage to memory or garbage."""
    code_planes()
    code_planes(cb=(64, 32), cr=(64, 32))
    with pytest.raises(error, match=said):
        code_planes(**wrong)


def test_planes_with_too_narrow_edges_are_refused():
    """Where patches would reach beyond them: the padding must follow the radius, and the radius has a limit."""
    motions, lists = np.zeros((1, 1, 2), np.int32), OffsetLists(*(np.zeros((8, 8, *end), kind) for end, kind in ENDS))
    image = noise(32, 32, 3)
    for padding, radius in ((PADDING + 2, 3), (PADDING + 11, 11)):
        pair = plane_pair(image, image, padding, 255)
        with pytest.raises(ValueError, match=f"padding = {padding}|patch_radius = {radius}"):
            search_tiles(pair, Proposals(motions, motions, 64), 4, 1, 3, radius, 1, lists)


def test_axes_that_are_constants_have_their_size():
    """As that of the values of a motion, which is a number that C++ knows."""
    motions, floats = np.zeros((1, 1, 2, 7), np.float32), map(np.float32, (0.25, 20, 0.01, 0.04))
    listed, weights = np.zeros((1, 1), np.int32), np.zeros((1, 1, 2), np.float32)
    with pytest.raises(ValueError, match=r"motions must have the shape \(rows, columns, room, VALUES_PER_MOTION\)"):
        list_candidates(no_votes((1, 1), 4, 16), *floats, listed, motions, weights)


def test_images_of_two_types_are_refused():
    """And a result of the type that belongs to another one, although each type is a possible one."""
    places, lands = np.zeros((2, 3), np.int32), np.ones((2, 3), np.bool_)
    images = [noise(2, 3, 3, kind) for kind in (np.uint8, np.uint16)]
    with pytest.raises(TypeError, match="fetch_both: image1 must be uint8 here, not uint16"):
        fetch_both(*images, np.float32(0.5), np.float32(0.5), places, lands, places, lands, images[0].copy())
    plan = SearchPlan(np.zeros((1, 2), np.int32), np.array([0, 1], np.int32), np.zeros(1, np.bool_))
    row, motion = images[0].reshape(2, 9), np.zeros((1, 2, 2), np.int32)
    match_blocks(row, row, 3, 2, 1, plan, motion, np.zeros((1, 2), np.int64))
    with pytest.raises(TypeError, match="match_blocks: difference must be int64 here, not float32"):
        match_blocks(row, row, 3, 2, 1, plan, motion, np.zeros((1, 2), np.float32))


def test_a_record_that_is_needed_is_not_left_out():
    """None is no plan of a search, and would be read as one without offsets."""
    row, motion = noise(2, 3, 3, np.uint8).reshape(2, 9), np.zeros((1, 2, 2), np.int32)
    with pytest.raises(TypeError):
        match_blocks(row, row, 3, 2, 1, None, motion, np.zeros((1, 2), np.int64))


def test_a_call_that_was_right_does_not_vouch_for_the_next():
    """Calls with other shapes are compared anew."""
    for height in (4, 5):
        flow, similarity = np.zeros((height, 3, 2), np.float32), np.ones((4, 3), np.float32)
        sources = np.zeros((2, 4, 3), np.int32)
        if height == 4:
            splat(flow, similarity, np.float32(0), np.float32(0.5), *sources)
    with pytest.raises(ValueError, match=r"similarity must have the shape \(height, width\) with height = 5"):
        splat(flow, similarity, np.float32(0), np.float32(0.5), *sources)


def changed_copy(folder, file, before, after):
    """Copy the package with its compiled kernels, with a change of a description."""
    shutil.copytree(ROOT / "fpsboost", folder / "fpsboost", ignore=shutil.ignore_patterns("__pycache__"))
    path = folder / "fpsboost" / "kernels" / file
    text = path.read_text("utf-8")
    assert before in text
    path.write_text(text.replace(before, after), "utf-8")


@pytest.mark.parametrize(
    ("file", "before", "after"),
    [
        ("pair_context.py", "    step: int,\n    landings", "    step: Float,\n    landings"),
        ("constants.py", "MARGIN = 40", "MARGIN = 48"),
    ],
)
def test_a_library_of_other_descriptions_is_not_called(tmp_path, file, before, after):
    """Neither after a change of a record, nor of a number that C++ knows; the error says what to do."""
    changed_copy(tmp_path, file, before, after)
    program = """
import numpy as np
from fpsboost.kernels.pair_context import count_landings
count_landings(np.zeros((4, 4, 5), np.float32), np.float32(0.5), 8, np.zeros((4, 4), np.float32))
"""
    done = subprocess.run([sys.executable, "-c", program], cwd=tmp_path, capture_output=True, text=True, check=False)
    assert "ImportError: The compiled kernels in" in done.stderr
    assert "`python hatch_build.py`" in done.stderr


@pytest.mark.parametrize(
    ("file", "before", "after"),
    [
        ("candidates.py", '    listed: Annotated[Array, "int32 (rows, columns)"]\n    """Number', '    """Number'),
        ("candidates.py", 'weights: Annotated[Array, "float32 (', 'weights: Annotated[Array, "uint8 ('),
        ("candidates.py", '"out float32 (rows, columns, room)"', '"float32 (rows, columns, room)"'),
    ],
)
def test_kernels_that_read_a_record_otherwise_do_not_compile(tmp_path, file, before, after):
    """A field that is missing, of another type than C++ takes it for, or read-only is an error of the compiler."""
    pytest.importorskip("ziglang")
    changed_copy(tmp_path, file, before, after)
    shutil.copy(ROOT / "hatch_build.py", tmp_path)
    program = """
import subprocess, sys
from pathlib import Path
import hatch_build
hatch_build.headers(Path("."))
compiler = [sys.executable, "-m", "ziglang", "cc", "-std=c++17", "-I.", "-Ifpsboost/native", "-c", "-o", "out.o"]
print(subprocess.run([*compiler, "fpsboost/native/candidates.cpp"]).returncode)
"""
    done = subprocess.run([sys.executable, "-c", program], cwd=tmp_path, capture_output=True, text=True, check=False)
    assert done.stdout.strip() == "1", done.stderr
