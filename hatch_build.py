"""Compile the kernels in ``fpsboost/native`` into one library, which any Python of the platform can load.

pip runs this when it installs fpsboost or makes a wheel; ``python hatch_build.py`` compiles them again after a change.
The compiler is Zig's clang, a package on PyPI that pip brings for the build. Environment variables:

- ``CC``: another clang or gcc, instead of Zig's, and ``CFLAGS``: further options, such as those of a sanitizer
- ``FPSBOOST_PLATFORM``: one of `PLATFORMS` to compile for instead of this machine's, with Zig
"""

from __future__ import annotations

import os
import re
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

from hatchling.builders.hooks.plugin.interface import BuildHookInterface

SOURCES = Path(__file__).parent / "fpsboost" / "native"

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
        jobs = [
            (source, level, str(Path(objects, f"{source.stem}-{level}.o")))
            for source in sorted(SOURCES.glob("*.cpp"))
            for level in (["baseline"] if source.stem == "processor" else platform.levels)
        ]

        def compile_one(job: tuple[Path, str, str]) -> None:
            source, level, to = job
            processor = platform.levels[level].replace("_", "-") if own else platform.levels[level]
            options = [f"-march={processor}", f"-DLEVEL={level}", "-c", str(source), "-o", to]
            run_compiler([*compiler, *flags, *options], environment)

        list(pool.map(compile_one, jobs))
        library = Path(objects, f"kernels{platform.suffix}")
        link = [*compiler, *flags, "-shared", "-s", *(to for *_, to in jobs), "-o", library.name]
        run_compiler(link, environment, objects)  # macOS's linker writes the name that it is given into the library
        # under a name of its own at first, as a process may have loaded the old one
        new = Path(shutil.copy(library, folder / f"new-{library.name}"))
        return new.replace(folder / library.name)


def run_compiler(command: list[str], environment: dict[str, str], folder: str | None = None) -> None:
    """Run a compiler, in a folder if one is given; exit with a sentence below its output if it is missing or fails."""
    try:
        subprocess.run(command, check=True, cwd=folder, env=environment)
    except OSError as error:
        sys.exit(f"The compiler {command[0]} cannot be run ({error.strerror}); name a clang or gcc by CC, or unset it.")
    except subprocess.CalledProcessError as error:
        sys.exit(f"The compiler {command[0]} ended with {error.returncode} for {command[-1]}; see what it said above.")


class KernelsHook(BuildHookInterface):
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
