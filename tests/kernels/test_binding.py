"""Calls of compiled kernels: their records, and what they refuse."""

import ctypes
import re

import numpy as np
import pytest
from recorded_calls import KERNELS

from fpsboost.kernels import binding
from fpsboost.kernels.pair_context import count_landings

NATIVE = binding.LIBRARY.parent
SOURCES = "\n".join(path.read_text("utf-8") for path in sorted(NATIVE.glob("*.[ch]*")))
RECORDS = dict(re.findall(r"^struct (\w+) \{(.*?)^\};", re.sub(r"//.*", "", SOURCES), re.DOTALL | re.MULTILINE))
"""Fields of every record in C++, as they are written there."""

ENTRIES = re.findall(r"^KERNEL\((\w+), (\w+), (\w+)\)", SOURCES, re.MULTILINE)


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
    assert sorted(name for _, name, _ in ENTRIES) == sorted(KERNELS)


@pytest.mark.parametrize(("name", "record"), [entry[1:] for entry in ENTRIES])
def test_records_have_the_same_fields_in_python_and_in_cpp(name, record):
    """In one order, with one name and kind each; every field is a multiple of 8 bytes, so that none is padded."""
    structure, _ = binding.arguments_of(KERNELS[name])
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


def test_a_level_that_the_processor_does_not_have_is_refused(monkeypatch):
    """By name, instead of ending in an illegal instruction."""
    monkeypatch.setenv("FPSBOOST_CPU", "avx1024")
    with pytest.raises(ImportError, match="FPSBOOST_CPU is avx1024, and this processor has baseline"):
        binding.processor_level.__wrapped__()
