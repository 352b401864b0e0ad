"""Calls of compiled kernels: their records, what they refuse, and the same bits at every level of processors."""

import ctypes
import importlib
import os
import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from fpsboost.kernels import binding
from fpsboost.kernels.node_support import count_landings

KERNELS = Path(binding.__file__).parent
NATIVE = binding.LIBRARY.parent
SOURCES = "\n".join(path.read_text("utf-8") for path in sorted(NATIVE.glob("*.[ch]*")))
RECORDS = dict(re.findall(r"^struct (\w+) \{(.*?)^\};", re.sub(r"//.*", "", SOURCES), re.DOTALL | re.MULTILINE))
"""Fields of every record in C++, as they are written there."""

ENTRIES = re.findall(r"^KERNEL\((\w+), (\w+), (\w+)\)", SOURCES, re.MULTILINE)
FUNCTIONS = {
    name: getattr(importlib.import_module(f"fpsboost.kernels.{path.stem}"), name).__wrapped__
    for path in KERNELS.glob("[a-z]*.py")
    for name in re.findall(r"^@compiled\ndef (\w+)", path.read_text("utf-8"), re.MULTILINE)
}


def fields_in_cpp(name: str) -> list[tuple]:
    """Names and kinds of a record's fields, with those of records within it in their place."""
    fields = []
    for kind, names in re.findall(r"(\w+) ([^;{}]+);", RECORDS[name]):
        for field, count in re.findall(r"(\w+)(?:\[(\d+)\])?", names):
            fields.append((field, fields_in_cpp(kind) if kind in RECORDS and kind != "Array" else kind, count))
    return fields


def fields_in_python(structure: type) -> list[tuple]:
    """The same of a structure of ctypes."""
    kinds = {ctypes.c_int64: "Int", ctypes.c_double: "double", binding.ArrayRecord: "Array"}
    fields = []
    for field, kind in structure._fields_:
        count = ""
        if issubclass(kind, ctypes.Array):
            kind, count = kind._type_, str(kind._length_)  # noqa: PLW2901
        fields.append((field, kinds.get(kind) or fields_in_python(kind), count))
    return fields


def test_every_kernel_is_described_in_python():
    """And everything that is described is there."""
    assert sorted(name for _, name, _ in ENTRIES) == sorted(FUNCTIONS)


@pytest.mark.parametrize(("name", "record"), [entry[1:] for entry in ENTRIES])
def test_records_have_the_same_fields_in_python_and_in_cpp(name, record):
    """In one order, with one name and kind each; every field is a multiple of 8 bytes, so that none is padded."""
    structure, _ = binding.arguments_of(FUNCTIONS[name])
    assert fields_in_python(structure) == fields_in_cpp(record)
    assert ctypes.sizeof(structure) % 8 == 0


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


MADE = """
import hashlib, sys
import numpy as np
from fpsboost import methods
from fpsboost.frame_cache import FrameCache
random = np.random.default_rng(3)
texture = np.kron(random.random((20, 25, 3)), np.ones((4, 4, 1)))
for method in ("nlm", "nlm-fast", "nlm-exhaustive", "block"):
    for kind, white in ((np.float32, 1), (np.uint8, 255)):
        moved = [np.roll(texture, (k, 3 * k), (0, 1))[:51, :67] * white for k in range(4)]
        frames = [FrameCache(image.astype(kind)) for image in moved]
        pairs = [methods[method].pair(*frames[k : k + 2]) for k in range(3)]
        for image in methods[method].images(pairs[1], [0.3], pairs[0], pairs[2], with_confidence=True):
            print(method, kind.__name__, *(hashlib.sha256(np.ascontiguousarray(part)).hexdigest() for part in image))
"""


def made_at(level: str) -> str:
    """Digests of images that a new process makes with the kernels of a level, with their confidence."""
    environment = {**os.environ, "FPSBOOST_CPU": level}
    return subprocess.run(
        [sys.executable, "-c", MADE], env=environment, capture_output=True, text=True, check=True
    ).stdout


def test_every_level_of_processors_gives_the_same_bits():
    """Of all that this processor has."""
    levels = binding.LEVELS[: binding.library().count_levels()]
    assert len({made_at(level) for level in levels}) == 1


def test_a_level_that_the_processor_does_not_have_is_refused():
    """By name, instead of ending in an illegal instruction."""
    with pytest.raises(subprocess.CalledProcessError) as raised:
        made_at("avx1024")
    assert "FPSBOOST_CPU is avx1024, and this processor has baseline" in raised.value.stderr
