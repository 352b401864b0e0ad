"""Machine code that is kept: the same results as through numba, numba only where it is needed, no file is trusted."""

from __future__ import annotations

import resource
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from threading import Barrier
from typing import NamedTuple

import numba
import numpy as np
import pytest
from command_line import environment
from llvmlite import binding, ir
from numba import config
from numba.core import event

from fpsboost.kernels import machine_code
from fpsboost.kernels.arguments import SCALARS, NotKeptError
from fpsboost.kernels.deferred import COMPILE_EVENT
from fpsboost.kernels.entry import ENTRY, entry_of
from fpsboost.kernels.jit import JIT, njit
from fpsboost.kernels.machine_code import KeptKernel, linker

pytestmark = pytest.mark.skipif(
    sys.platform != "linux" or bool(config.DISABLE_JIT), reason="nothing is kept, or nothing is compiled"
)


class Inner(NamedTuple):
    factor: np.float32
    pair: tuple[np.ndarray, int]


class Outer(NamedTuple):
    flag: bool
    inner: Inner


def mixed(image, outer, offset, out):
    """Use arrays, named tuples in each other, a plain tuple, an array of its own, and another shape of an array."""
    (factor, (weights, step)), flat = outer.inner, out.reshape(out.size)
    row = np.empty(image.shape[1], np.float32)
    for y in range(image.shape[0]):
        for x in range(image.shape[1]):
            row[x] = image[y, x] * factor + weights[x, y] * step + offset
        for x in range(image.shape[1]):
            flat[y * image.shape[1] + x] = -row[x] if outer.flag else row[x]


def doubled(values, out):
    """Double some values."""
    for i in range(values.size):
        out[i] = 2 * values[i]


@njit(**JIT)
def largest(values):
    """Return the largest of some values, by a function of numba's."""
    return np.max(values)


def scaled(values, out):
    """Divide some values by the largest."""
    for i in range(values.size):
        out[i] = values[i] / largest(values)


@pytest.fixture
def kept(tmp_path, monkeypatch):
    """The folder in which machine code is kept."""
    monkeypatch.setattr(machine_code, "folder", lambda: tmp_path)
    return tmp_path


@pytest.fixture
def compiled():
    """What numba has compiled, one entry each time."""
    times: list[bool] = []

    class Counter(event.Listener):
        def on_start(self, _):
            times.append(True)

        def on_end(self, _):
            pass

    with event.install_listener(COMPILE_EVENT, Counter()):
        yield times


def run_doubled(values=None):
    """Double values by a kernel that nothing is known of yet in this process."""
    values = np.arange(5.0) if values is None else values
    out = np.zeros(values.size)
    KeptKernel(doubled, JIT)(values, out)
    np.testing.assert_array_equal(out, 2.0 * values)


def files(folder):
    return sorted(folder.glob("*.kernel"))


def test_results_are_those_of_numba(kept):
    """Compiled now, read from the file, and by numba's own way to call it, whatever is passed."""
    random = np.random.default_rng(0)
    image, weights = random.random((5, 7), np.float32), random.random((9, 5))[::1].T[:, ::-1].T[:7]
    arguments = image[:, ::1], Outer(True, Inner(np.float32(1.5), (weights, 3))), 0.25
    results = []
    for kernel in (KeptKernel(mixed, JIT), KeptKernel(mixed, JIT), KeptKernel(mixed, JIT).dispatcher):
        out = np.zeros((5, 7), np.float32)
        kernel(*arguments, out)
        results.append(out)
    expected = np.zeros((5, 7), np.float32)
    mixed(*arguments, expected)
    np.testing.assert_allclose(results[0], expected, rtol=1e-6)
    assert [out.tobytes() for out in results[1:]] == [results[0].tobytes()] * 2
    assert len(files(kept)) == 1


def take_scalar(value, out):
    """Store a number."""
    out[0] = value


@pytest.mark.parametrize("kind", SCALARS)
def test_scalars_arrive_as_they_are(kept, kind):
    """The least and the greatest number of every type."""
    dtype = np.dtype(kind)
    limits = np.finfo(dtype) if dtype.kind == "f" else None if dtype.kind == "b" else np.iinfo(dtype)
    for value in (False, True) if limits is None else (limits.min, limits.max):
        out = np.zeros(1, dtype)
        KeptKernel(take_scalar, JIT)(kind(value), out)
        assert out[0] == value
    assert len(files(kept)) == 1


def test_other_types_of_arguments_have_code_of_their_own(kept):
    """Another type of number, another layout, and an array that cannot be written."""
    frozen = np.arange(5.0)
    frozen.flags.writeable = False
    for count, values in enumerate((np.arange(5.0), np.arange(5), np.arange(10.0)[::2], frozen), 1):
        run_doubled(values)
        run_doubled(values)
        assert len(files(kept)) == count


def test_nothing_is_compiled_twice(kept, compiled):
    """Neither in one process nor, from the file, in another."""
    run_doubled()
    assert compiled.pop()
    run_doubled()
    assert not compiled


def make(factor):
    def scaled(values):
        for i in range(values.size):
            values[i] *= factor

    return KeptKernel(scaled, JIT)


def test_constants_of_a_kernel_tell_it_from_another(kept):
    """Two kernels of one function that differ in a variable around them."""
    for factor in (2, 3, 2):
        values = np.ones(3)
        make(factor)(values)
        assert values.tolist() == [factor] * 3
    assert len(files(kept)) == 2


@pytest.mark.parametrize(
    "damage",
    [
        pytest.param(lambda content: b"", id="empty"),
        pytest.param(lambda content: content[: len(content) // 2], id="truncated"),
        pytest.param(lambda content: content[:-100] + bytes([content[-100] ^ 1]) + content[-99:], id="one bit"),
        pytest.param(lambda content: content[:32], id="nothing but the digest"),
        pytest.param(lambda content: b"\x7fELF" + content, id="something in front"),
    ],
)
def test_a_damaged_file_is_written_anew(kept, compiled, damage):
    """It is not run, whatever is wrong with it."""
    run_doubled()
    (file,) = files(kept)
    file.write_bytes(damage(file.read_bytes()))
    compiled.clear()
    run_doubled()
    assert len(compiled) == 1
    assert len(file.read_bytes()) > 1000
    compiled.clear()
    run_doubled()
    assert not compiled


def test_the_file_of_another_kernel_is_not_taken(kept, compiled):
    """A whole file under the name of another."""
    run_doubled()
    run_doubled(np.arange(5))
    first, second = files(kept)
    content = second.read_bytes()
    first.write_bytes(content)
    compiled.clear()
    run_doubled()
    run_doubled(np.arange(5))
    assert len(compiled) == 1
    assert first.read_bytes() != content == second.read_bytes()


@pytest.mark.parametrize("place", [None, Path("no", "such", "folder")])
def test_where_nothing_can_be_written_nothing_is_kept(monkeypatch, place):
    """As on a full disk: the kernel is compiled each time."""
    monkeypatch.setattr(machine_code, "folder", lambda: place)
    run_doubled()


def test_threads_compile_a_kernel_once(kept, compiled):
    """All of them call it for the first time at once."""
    kernel, together = KeptKernel(doubled, JIT), Barrier(8)

    def run(number):
        values, out = np.full(1000, number), np.zeros(1000)
        together.wait()
        kernel(values, out)
        return (out == 2 * number).all()

    with ThreadPoolExecutor(8) as pool:
        assert all(pool.map(run, range(8)))
    assert len(compiled) == 1


def test_what_a_kernel_calls_can_be_called_elsewhere(kept):
    """A function that was compiled for a kernel is one for numba, too, and from Python; so is what it calls."""
    values, out = np.array([1.0, 4, 2]), np.zeros(3)
    KeptKernel(scaled, JIT)(values, out)
    np.testing.assert_array_equal(out, values / 4)

    @numba.njit
    def through_numba(values):
        return largest(values) + np.max(values)

    assert largest(values) == 4
    assert through_numba(values) == 8


def test_an_error_in_a_kernel_is_an_exception(kept):
    """The one that numba raises."""

    def fail(size, out):
        out[0] = np.empty(size).size

    for kernel in (KeptKernel(fail, JIT), KeptKernel(fail, JIT), KeptKernel(fail, JIT).dispatcher):
        with pytest.raises(ValueError, match="negative dimensions not allowed"):
            kernel(-1, np.zeros(1))
    assert files(kept)


def test_a_kernel_without_memory_raises_memory_error(kept):
    """More than any machine has."""

    def fill(size, out):
        out[0] = np.empty(size, np.uint8).size

    with pytest.raises(MemoryError):
        KeptKernel(fill, JIT)(2**60, np.zeros(1))
    assert files(kept)


def test_memory_of_a_kernel_is_freed(kept):
    """A thousand arrays of 16 MB do not stay."""

    def use(size, out):
        room = np.zeros(size, np.uint8)
        out[0] += room[size - 1] + 1

    kernel, out = KeptKernel(use, JIT), np.zeros(1)
    kernel(1 << 24, out)
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    for _ in range(1000):
        kernel(1 << 24, out)
    assert resource.getrusage(resource.RUSAGE_SELF).ru_maxrss < before + (1 << 20)
    assert out[0] == 1001


@pytest.mark.parametrize(
    "values", [np.asfortranarray(np.ones((3, 4))), np.ones(3, np.complex128), np.ones(3).view(np.recarray)]
)
def test_other_arguments_are_left_to_numba(kept, values):
    """Arrays in Fortran's order, of other numbers, and of other classes."""

    def count(values, out):
        out[0] = values.size

    out = np.zeros(1)
    KeptKernel(count, JIT)(values, out)
    assert (out[0], files(kept)) == (values.size, [])


def test_a_kernel_that_returns_something_is_left_to_numba(kept):
    """Only results in arrays are passed."""

    def total(values):
        return values.sum()

    assert KeptKernel(total, JIT)(np.arange(5)) == 10
    assert files(kept) == []


@pytest.mark.parametrize("taken", [[ir.IntType(32)], [ir.DoubleType()], [], [ir.IntType(8).as_pointer()]])
def test_a_function_that_takes_something_else_has_no_entry(taken):
    """Numbers of another size or kind, or more or fewer of them, than the record holds."""
    pointer = ir.IntType(8).as_pointer()
    kind = ir.FunctionType(ir.IntType(32), [pointer, pointer, *taken])
    with pytest.raises(NotKeptError, match="takes"):
        entry_of("function", kind, [int])


def test_an_unknown_symbol_is_an_error_and_no_crash():
    """Code that calls a function that is nowhere."""
    kind = ir.FunctionType(ir.IntType(32), [ir.IntType(8).as_pointer()] * 2)
    module = binding.parse_assembly(str(entry_of("no_such_function_anywhere", kind, [])))
    code = binding.Target.from_default_triple().create_target_machine(jit=True).emit_object(module)
    with pytest.raises(NotKeptError, match=ENTRY):
        linker().link([code])


def test_a_conversion_with_kept_kernels_never_imports_numba(save_images, tmp_path):
    """The first one may, the second one may not."""
    save_images(tmp_path / "in", count=3)
    code = """if True:
        import sys
        from fpsboost.cli import app
        try:
            app.main()
        finally:
            print("numba" in sys.modules)
    """
    said = [
        subprocess.run(
            [sys.executable, "-c", code, "in", f"out{number}", "-q"],
            cwd=tmp_path,
            env=environment(),
            capture_output=True,
            text=True,
            check=True,
        ).stdout
        for number in range(2)
    ]
    assert said[1] == "False\n"


def test_numba_is_imported_to_compile(tmp_path):
    """And not to call what has been kept."""
    code = """if True:
        import sys
        import numpy as np
        from fpsboost.kernels.points import find_gradients
        find_gradients(np.zeros((4, 4, 2), np.float32), np.float32(4), np.zeros((4, 4, 2, 2), np.float32))
        print("numba" in sys.modules)
    """
    kept = environment() | {"NUMBA_CACHE_DIR": str(tmp_path)}
    said = [
        subprocess.run([sys.executable, "-c", code], env=kept, capture_output=True, text=True, check=True).stdout
        for _ in range(2)
    ]
    assert said == ["True\n", "False\n"]


def test_what_is_set_for_numba_has_code_of_its_own(tmp_path):
    """Its variables change what it makes; the folder alone does not."""
    code = "from fpsboost.kernels.machine_code import surroundings; print(surroundings().hex())"
    said = [
        subprocess.run(
            [sys.executable, "-c", code], env=environment() | set_, capture_output=True, text=True, check=True
        ).stdout
        for set_ in ({}, {"NUMBA_CACHE_DIR": str(tmp_path)}, {"NUMBA_OPT": "1"}, {"NUMBA_BOUNDSCHECK": "1"})
    ]
    assert said[0] == said[1]
    assert len(set(said)) == 3
