"""Compile the kernels in ``fpsboost/native`` into one library, which any Python of the platform can load.

pip runs this when it installs fpsboost or makes a wheel; ``python hatch_build.py`` compiles them again after a change.
The compiler is Zig's clang, a package on PyPI that pip brings for the build. Environment variables:

- ``CC``: another clang or gcc, instead of Zig's, and ``CFLAGS``: further options, such as those of a sanitizer
- ``FPSBOOST_PLATFORM``: one of `PLATFORMS` to compile for instead of this machine's, with Zig
"""

from __future__ import annotations

import ast
import os
import re
import runpy
import shlex
import shutil
import subprocess
import sys
import sysconfig
import tempfile
from concurrent.futures import ThreadPoolExecutor
from importlib.util import find_spec
from pathlib import Path
from typing import Any, NamedTuple
from zlib import crc32

from hatchling.builders.hooks.plugin.interface import BuildHookInterface

SOURCES = Path(__file__).parent / "fpsboost" / "native"
DESCRIPTIONS = SOURCES.parent / "kernels"

ZIG = "ziglang==0.17.1"
"""Package of the compiler: one version, as another one may give other bits."""

X86 = {"baseline": "x86_64", "avx2": "x86_64_v3", "avx512": "x86_64_v4"}
ARM = {"baseline": "generic"}  # with NEON
"""Levels of processors, and what Zig calls them."""


class Platform(NamedTuple):
    """Platform to compile for."""

    target: str
    """As Zig calls it, with the lowest version of its C library or system."""
    tag: str
    """Of wheels."""
    suffix: str
    """Of the library."""
    levels: dict[str, str]


PLATFORMS = {
    "linux-x86_64": Platform("x86_64-linux-gnu.2.17", "manylinux_2_17_x86_64", ".so", X86),
    "linux-aarch64": Platform("aarch64-linux-gnu.2.17", "manylinux_2_17_aarch64", ".so", ARM),
    "musllinux-x86_64": Platform("x86_64-linux-musl", "musllinux_1_2_x86_64", ".so", X86),
    "musllinux-aarch64": Platform("aarch64-linux-musl", "musllinux_1_2_aarch64", ".so", ARM),
    "macosx-arm64": Platform("aarch64-macos.11.0", "macosx_11_0_arm64", ".dylib", {"baseline": "apple_m1"}),
    "macosx-x86_64": Platform("x86_64-macos.11.0", "macosx_11_0_x86_64", ".dylib", X86),
    "win-amd64": Platform("x86_64-windows-gnu", "win_amd64", ".dll", X86),
}

# the order of operations is that of the sources, so that all levels and platforms give the same bits
FLAGS = shlex.split(
    "-std=c++17 -O3 -g0 -fno-exceptions -fno-rtti -fvisibility=hidden -fno-sanitize=all -ffp-contract=off "
    "-fno-math-errno -fno-trapping-math -Wall -Wextra -Wno-psabi"
)


def this_platform() -> str:
    """Return the name of the platform to compile for."""
    system, _, processor = sysconfig.get_platform().partition("-")
    if "musl" in (sysconfig.get_config_var("HOST_GNU_TYPE") or ""):
        system = "musllinux"
    return os.environ.get("FPSBOOST_PLATFORM") or f"{system}-{processor.rpartition('-')[2]}"  # macOS: 11.0-arm64


def compile_kernels(platform: Platform, folder: Path) -> Path:
    """Compile every source for every level into a library in a folder; return its path."""
    zig = [sys.executable, "-m", "ziglang", "cc", "-target", platform.target]
    own = shlex.split(os.environ.get("CC", ""))
    compiler, further = own or zig, shlex.split(os.environ.get("CFLAGS", ""))
    if not own and not find_spec("ziglang"):
        sys.exit(f"The compiler of the kernels is missing; run pip install {ZIG}, or name a clang or gcc by CC.")
    print(f"Compiling the kernels for {platform.target} by {shlex.join(compiler)}", flush=True)
    flags = [*FLAGS, *(["-fPIC"] if platform.suffix != ".dll" else []), *further]
    with tempfile.TemporaryDirectory() as objects, ThreadPoolExecutor(os.cpu_count()) as pool:
        # Zig keeps its caches in the home folder otherwise, 50 MB, and fails where that cannot be written
        caches = dict.fromkeys(("ZIG_GLOBAL_CACHE_DIR", "ZIG_LOCAL_CACHE_DIR"), str(Path(objects, "zig")))
        environment = caches | os.environ
        headers(Path(objects))
        jobs = [
            (source, level, str(Path(objects, f"{source.stem}-{level}.o")))
            for source in sorted(SOURCES.glob("*.cpp"))
            for level in (["baseline"] if source.stem == "processor" else platform.levels)
        ]

        def compile_one(job: tuple[Path, str, str]) -> None:
            source, level, to = job
            processor = platform.levels[level].replace("_", "-") if own else platform.levels[level]
            options = [f"-march={processor}", f"-DLEVEL={level}", "-I", objects, "-I", str(SOURCES)]
            run_compiler([*compiler, *flags, *options, "-c", str(source), "-o", to], environment)

        list(pool.map(compile_one, jobs))
        library = Path(objects, f"kernels{platform.suffix}")
        link = [*compiler, *flags, "-shared", "-s", *(to for *_, to in jobs), "-o", library.name]
        run_compiler(link, environment, objects)  # macOS's linker writes the name that it is given into the library
        # under a name of its own at first, as a process may have loaded the old one
        new = Path(shutil.copy(library, folder / f"new-{library.name}"))
        return new.replace(folder / library.name)


class Descriptions:
    """What ``fpsboost/kernels`` says of the kernels, declared in C++: one record for each named tuple and kernel.

    The files are read, and not imported, as there is no NumPy where a wheel is made. `fpsboost.kernels.binding` makes
    the same layouts of the annotations themselves.
    """

    def __init__(self) -> None:
        constants = runpy.run_path(str(DESCRIPTIONS / "constants.py"))
        self.constants = {name: value for name, value in constants.items() if name.isupper()}
        # in each file: a definition, or the file it comes from
        self.names: dict[str, dict[str, ast.ClassDef | ast.expr | str]] = {}
        self.layouts: dict[str, str] = {}  # of each record
        self.lines: list[str] = []
        files = {path.stem: ast.parse(path.read_text("utf-8")) for path in sorted(DESCRIPTIONS.glob("*.py"))}
        for file, module in files.items():
            known = self.names[file] = {}
            for node in module.body:
                if isinstance(node, ast.ClassDef):
                    known[node.name] = node
                elif isinstance(node, ast.Assign) and isinstance(node.targets[0], ast.Name):
                    known[node.targets[0].id] = node.value
                elif isinstance(node, ast.ImportFrom) and str(node.module).startswith("fpsboost.kernels."):
                    known |= {each.name: str(node.module).rpartition(".")[2] for each in node.names}
        for file, module in files.items():
            for node in module.body:
                if isinstance(node, ast.FunctionDef) and "compiled" in map(ast.unparse, node.decorator_list):
                    self.declare_kernel(file, node)

    def declare_kernel(self, file: str, node: ast.FunctionDef) -> None:
        """Declare a kernel and its arguments; its definition begins with the name after `ENTRY_`."""
        arguments = node.name.title().replace("_", "")
        fields = {each.arg: each.annotation for each in node.args.args if each.annotation}
        checksum = f"{crc32(f'{self.declare_record(file, arguments, fields)}{self.constants}'.encode()):08x}"
        result = "Int" if "scratch" in fields else "void"
        self.lines += [
            f"#define ENTRY_{node.name} AT_LEVEL({node.name}_{checksum}, LEVEL)",
            f'extern "C" EXPORT {result} ENTRY_{node.name}(const {arguments} &);',
        ]

    def declare_record(self, file: str, name: str, fields: dict[str, ast.expr]) -> str:
        """Declare a record, after those in it, unless that is done; return its layout."""
        members, layouts = [], []
        for field, annotation in fields.items():
            kind, count, layout = self.field(file, annotation)
            members.append(f"  {kind} {field}{count};")
            layouts.append(f"{field} {layout}")
        layout = f"({', '.join(layouts)})"
        if self.layouts.setdefault(name, layout) != layout:
            sys.exit(f"Two records of fpsboost/kernels are called {name}; rename the one in {file}.py.")
        if (declared := [f"struct {name} {{", *members, "};"])[0] not in self.lines:
            self.lines += declared
        return layout

    def field(self, file: str, annotation: ast.expr) -> tuple[str, str, str]:
        """Return the type of a field, the number of its elements in brackets, if any, and its layout."""
        if isinstance(annotation, ast.BinOp):  # or None
            annotation = annotation.left
        if isinstance(annotation, ast.Subscript):
            return self.field_of_parts(file, annotation)
        name = ast.unparse(annotation)
        if kind := {"int": "Int", "bool": "Int", "np.uint8": "Int", "float": "double", "Float": "Float"}.get(name):
            return kind, "", "q" if kind == "Int" else "d"
        definition = self.names[file][name]
        if isinstance(definition, ast.ClassDef):
            members = [each for each in definition.body if isinstance(each, ast.AnnAssign)]
            fields = {ast.unparse(each.target): each.annotation for each in members}
            return name, "", self.declare_record(file, name, fields)
        return self.field(definition, annotation) if isinstance(definition, str) else self.field(file, definition)

    def field_of_parts(self, file: str, annotation: ast.Subscript) -> tuple[str, str, str]:
        """Return the same of a tuple, an array, or a record with a scope."""
        first, *others = annotation.slice.elts if isinstance(annotation.slice, ast.Tuple) else [annotation.slice]
        if ast.unparse(annotation.value) == "tuple":
            kind, _, layout = self.field(file, first)
            return kind, f"[{1 + len(others)}]", f"({', '.join(f'{n} {layout}' for n in range(1 + len(others)))})"
        if ast.unparse(first) != "Array":
            return self.field(file, first)
        pattern = r"^(out )?(?:\w+: )?([\w|]+) \((.*?),?\)[a-z ]*$"
        is_output, types, axes = re.findall(pattern, ast.literal_eval(others[0]))[0]
        element = {"bool": "bool", "float32": "float", "float64": "double"}.get(types, f"{types}_t")
        element = f"{'' if is_output else 'const '}{'Any' if '|' in types else element}"
        count = 1 + axes.count(",")
        return f"ArrayOf<{element}, {count}>", "", f"{types}[{count}]"


def headers(folder: Path) -> None:
    """Write the headers that declare in C++ what is described in Python."""
    descriptions = Descriptions()
    numbers = [
        f"constexpr {'float' if isinstance(value, float) else 'Int'} {name} = {value}{'f' * isinstance(value, float)};"
        for name, value in descriptions.constants.items()
        if isinstance(value, int | float)
    ]
    kinds = f"enum Kind : Int {{ {', '.join(descriptions.constants['KINDS']).upper()} }};"
    lines = ["#pragma once", "#include <stdint.h>", "typedef int64_t Int;", kinds, "namespace {", *numbers, "}"]
    (folder / "constants.h").write_text("\n".join(lines) + "\n", "utf-8")
    lines = ["#pragma once", '#include "arrays.h"', *descriptions.lines]
    (folder / "records.h").write_text("\n".join(lines) + "\n", "utf-8")


def run_compiler(command: list[str], environment: dict[str, str], folder: str | None = None) -> None:
    """Run a compiler, in a folder if one is given; exit with a sentence below its output if it is missing or fails."""
    try:
        subprocess.run(command, check=True, cwd=folder, env=environment)
    except OSError as error:
        sys.exit(f"The compiler {command[0]} cannot be run ({error.strerror}); name a clang or gcc by CC, or unset it.")
    except subprocess.CalledProcessError as error:
        sys.exit(f"The compiler {command[0]} ended with {error.returncode} for {command[-1]}; see what it said above.")


class KernelsHook(BuildHookInterface[Any]):
    """Step of a build that adds the compiled kernels to the package."""

    PLUGIN_NAME = "custom"

    def dependencies(self) -> list[str]:
        """Return what pip installs for the build beside hatchling; a compiler of `CC` needs none."""
        return [] if os.environ.get("CC") else [ZIG]

    def initialize(self, version: str, build_data: dict[str, Any]) -> None:
        """Compile the kernels beside their sources, where an editable installation finds them, too."""
        platform = PLATFORMS[this_platform()]
        library = compile_kernels(platform, SOURCES)
        # another compiler links with this machine's C library, which may be newer
        tag = re.sub(r"\W", "_", sysconfig.get_platform()) if os.environ.get("CC") else platform.tag
        build_data.update(tag=f"py3-none-{tag}", pure_python=False)
        build_data["artifacts"].append(f"/fpsboost/native/{library.name}")


if __name__ == "__main__":
    print(compile_kernels(PLATFORMS[this_platform()], SOURCES))
