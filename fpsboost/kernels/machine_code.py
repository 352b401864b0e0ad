"""Compiled kernels in files that can be called without numba.

numba keeps compiled functions, too, but finding out which of them fits some arguments takes most of numba. Here, the
types of the arguments are told by a few attributes, and the machine code is linked by LLVM alone. It is the code that
numba has made, to the bit, together with an entry: a function that reads all arguments from one packed record and
passes them on as numba would. The entry also holds what code that allocates arrays needs of numba's runtime.

A kernel whose code cannot be kept so, or that is called with arguments of other kinds, is left to numba and its cache.
"""

from __future__ import annotations

import ctypes
import os
import pickle
import struct
import sys
from collections.abc import Callable, Sequence
from contextlib import suppress
from functools import cache
from hashlib import sha256
from importlib.util import find_spec
from itertools import count
from pathlib import Path
from typing import Any, cast

import llvmlite
import numpy as np
from llvmlite import binding

from fpsboost.kernels.arguments import NotKeptError, flatten, name_of, record_format
from fpsboost.kernels.deferred import Kernel, compiler
from fpsboost.kernels.entry import ENTRY, entry_of

FOLDER_VARIABLE = "NUMBA_CACHE_DIR"

SUFFIX = ".kernel"
"""Of files with machine code: a digest of the rest, the size of the kernel's object file, that, and its entry's."""

SIZE = struct.Struct("<Q")

Entry = ctypes.CFUNCTYPE(ctypes.c_int32, ctypes.c_char_p, ctypes.POINTER(ctypes.c_void_p))
"""Record of arguments, and where an error is described; it returns whether there is one."""


@cache
def folder() -> Path | None:
    """Return the folder for machine code, where numba would keep its own; None if there is none that can be written."""
    chosen = os.environ.get(FOLDER_VARIABLE)
    beside = Path(__file__).with_name("__pycache__")
    of_user = Path(os.environ.get("XDG_CACHE_HOME") or "~/.cache", "numba").expanduser()
    for path in [Path(chosen)] if chosen else [beside, of_user / "fpsboost"]:
        with suppress(OSError):
            path.mkdir(parents=True, exist_ok=True)
            if os.access(path, os.W_OK | os.X_OK):
                return path
    return None


@cache
def surroundings() -> bytes:
    """Return a digest of all that machine code depends on besides its kernel and the types of its arguments.

    These are the sources of all kernels, the versions of everything that takes part, the processor, and what is set for
    numba.
    """
    numba = find_spec("numba")  # finding it does not import it
    if numba is None or numba.origin is None:
        raise NotKeptError("numba is not installed")
    settings = [f"{name} {value}" for name, value in sorted(os.environ.items()) if name.startswith("NUMBA_")]
    facts = (
        *(sys.version, np.__version__, llvmlite.__version__, *binding.llvm_version_info),
        *(binding.get_host_cpu_name(), binding.get_host_cpu_features().flatten()),
        *(each for each in settings if not each.startswith(FOLDER_VARIABLE)),
    )
    digest = sha256(repr(facts).encode())
    try:
        for file in (Path(numba.origin).with_name("_version.py"), *sorted(Path(__file__).parent.glob("*.py"))):
            digest.update(sha256(file.read_bytes()).digest())
    except OSError as error:
        raise NotKeptError(f"{error.filename} cannot be read") from None
    return digest.digest()


class Linker:
    """LLVM's linker for machine code in this process. An unknown symbol is an error of Python's."""

    def __init__(self) -> None:
        binding.initialize_native_target()
        binding.initialize_native_asmprinter()
        self._llvm = binding.create_lljit_compiler(suppress_errors=True)
        self._numbers = count()

    def link(self, objects: Sequence[bytes]) -> Callable[[bytes, Any], int]:
        """Return the entry among object files."""
        library = binding.JITLibraryBuilder().add_current_process().export_symbol(ENTRY)
        for each in objects:
            library.add_object_img(each)
        try:
            tracker = library.link(self._llvm, f"kernel{next(self._numbers)}")
        except RuntimeError as error:
            raise NotKeptError(str(error)) from None
        tracker.detach()  # the code is never unloaded
        return Entry(tracker[ENTRY])


@cache
def linker() -> Linker:
    """Return the linker of this process."""
    return Linker()


class MachineCode:
    """Machine code of a kernel for some types of arguments.

    Parameters
    ----------
    form : struct.Struct
        Format of the record of arguments.
    code, entry : bytes
        Object files of the kernel and of its entry.
    """

    def __init__(self, form: struct.Struct, code: bytes, entry: bytes) -> None:
        self._linker = linker()  # which owns the code; two threads may have made two
        self._pack, self._run = form.pack, self._linker.link([code, entry])

    def __call__(self, values: Sequence[Any]) -> None:
        """Run the kernel with numbers from `flatten`."""
        error = ctypes.c_void_p()
        if self._run(self._pack(*values), ctypes.byref(error)):
            raise _error_at(error.value)


def _error_at(address: int | None) -> Exception:
    """Return the exception that numba describes at an address: its pickled class and arguments, and their size."""
    if address is None:
        return RuntimeError("a kernel failed")
    size = ctypes.c_int32.from_address(address + ctypes.sizeof(ctypes.c_void_p)).value
    pickled = ctypes.string_at(ctypes.c_void_p.from_address(address).value or 0, size)
    kind, arguments, _ = pickle.loads(pickled)
    return cast("Exception", kind(*arguments or ()))


class KeptKernel(Kernel):
    """Kernel whose machine code is kept in files; numba is imported where one is lacking."""

    def __init__(self, function: Callable[..., Any], options: dict[str, Any]) -> None:
        super().__init__(function, options)
        self._known: dict[tuple[Any, ...], MachineCode | None] = {}

    def __call__(self, *arguments: Any) -> Any:
        """Run the kernel, compiling it if no file holds its machine code."""
        kinds: list[Any] = []
        values: list[Any] = []
        try:
            flatten(arguments, kinds, values)
            key = tuple(kinds)
            code = self._known[key] if key in self._known else self._find(key, arguments)
        except NotKeptError:
            code = None
        return self.dispatcher(*arguments) if code is None else code(values)

    def _find(self, kinds: tuple[Any, ...], arguments: Sequence[Any]) -> MachineCode | None:
        """Return machine code for the arguments, read or made, and remember it; None if there can be none."""
        form, digest = record_format(kinds), self._digest(kinds)
        found = self._read(digest, form)
        if found is None:
            compiler.tell()  # before numba is imported, which takes a while
            with compiler.ready():
                if kinds in self._known:  # another thread has compiled it meanwhile
                    return self._known[kinds]
                with suppress(NotKeptError):
                    found = self._compile(digest, kinds, form, arguments)
                self._known[kinds] = found
        return self._known.setdefault(kinds, found)

    def _digest(self, kinds: tuple[Any, ...]) -> bytes:
        """Return what tells machine code from any other."""
        constants = [cell.cell_contents for cell in self.py_func.__closure__ or ()]
        names = [self.py_func.__module__, self.py_func.__qualname__, *map(name_of, kinds)]
        return sha256(surroundings() + repr(names).encode() + pickle.dumps(constants)).digest()

    def _file(self, digest: bytes) -> Path | None:
        kept_in = folder()
        name = f"{self.py_func.__module__.rpartition('.')[2]}.{self.py_func.__name__}-{digest[:16].hex()}{SUFFIX}"
        return kept_in and kept_in / name

    def _read(self, digest: bytes, form: struct.Struct) -> MachineCode | None:
        """Return what a file holds if it was written under this digest and is as it was written, else None."""
        file = self._file(digest)
        try:
            content = file.read_bytes() if file else b""
            check, rest = content[: len(digest)], content[len(digest) :]
            if check != sha256(digest + rest).digest():
                return None
            (size,) = SIZE.unpack_from(rest)
            objects = rest[SIZE.size :]
            return MachineCode(form, objects[:size], objects[size:])
        except (OSError, NotKeptError):
            return None

    def _compile(
        self, digest: bytes, kinds: tuple[Any, ...], form: struct.Struct, arguments: Sequence[Any]
    ) -> MachineCode:
        """Return machine code that is compiled now, and write it to a file."""
        from numba import typeof, types  # noqa: PLC0415 (a run may not need it)

        from fpsboost.kernels.intermediate_code import intermediate  # noqa: PLC0415

        made, signature = self._make(wrapped=False), tuple(map(typeof, arguments))
        with intermediate(made.targetctx.codegen()):
            made.compile(signature)
        compiled = made.overloads[signature]
        about = compiled.fndesc
        if about.restype != types.none or compiled.environment.consts or compiled.library.has_dynamic_globals:
            raise NotKeptError(f"{about.qualname} needs objects of Python")
        kind = made.targetctx.call_conv.get_function_type(about.restype, about.argtypes)
        code = compiled.library.machine_code()
        module = binding.parse_assembly(str(entry_of(about.llvm_func_name, kind, kinds)))
        machine = binding.Target.from_default_triple().create_target_machine(jit=True, codemodel="jitdefault")
        entry = machine.emit_object(module)
        found = MachineCode(form, code, entry)
        self._write(digest, SIZE.pack(len(code)) + code + entry)
        return found

    def _write(self, digest: bytes, content: bytes) -> None:
        """Write a file that is there as a whole or not at all; where it cannot be written, nothing is kept."""
        file = self._file(digest)
        if file is None:
            return
        staged = file.with_suffix(f".{os.urandom(8).hex()}")
        with suppress(OSError):
            try:
                staged.write_bytes(sha256(digest + content).digest() + content)
                staged.replace(file)
            finally:
                staged.unlink(missing_ok=True)


def njit(**options: Any) -> Callable[[Callable[..., Any]], Kernel]:
    """Decorate a function like `numba.njit`; its machine code is kept if ``cache=True`` and it is one of the package.

    That has been tried on Linux alone; elsewhere numba keeps it.
    """

    def decorate(function: Callable[..., Any]) -> Kernel:
        is_ours = function.__module__.startswith(f"{__package__}.")
        kept = options.get("cache") and is_ours and sys.platform == "linux" and sys.maxsize > 2**32
        return (KeptKernel if kept else Kernel)(function, options)

    return decorate
