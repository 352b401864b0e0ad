"""Build the Blender extension: ``python integrations/build_blender_extension.py FOLDER`` writes its zip file there.

The same as ``blender --command extension build --source-dir integrations/blender``, for machines without Blender.
"""

from __future__ import annotations

import argparse
import tomllib
import zipfile
from pathlib import Path

SOURCE = Path(__file__).parent / "blender"
EPOCH = (1980, 1, 1, 0, 0, 0)
"""The time of all files, so that the same files make the same zip file."""


def build(folder: Path) -> Path:
    """Write the zip file of the extension into a folder, and return its path."""
    manifest = tomllib.loads((SOURCE / "blender_manifest.toml").read_text(encoding="utf-8"))
    target = folder / f"{manifest['id']}-{manifest['version']}.zip"
    folder.mkdir(parents=True, exist_ok=True)
    with zipfile.ZipFile(target, "w", zipfile.ZIP_DEFLATED) as archive:
        for path in sorted(SOURCE.rglob("*")):
            if path.is_file() and path.suffix in {".py", ".toml"}:
                entry = zipfile.ZipInfo(path.relative_to(SOURCE).as_posix(), EPOCH)
                entry.compress_type, entry.external_attr = zipfile.ZIP_DEFLATED, 0o644 << 16
                archive.writestr(entry, path.read_bytes())
    return target


def main() -> None:
    """Build the zip file that the command line asks for."""
    parser = argparse.ArgumentParser(description="Build the Blender extension.")
    parser.add_argument("folder", type=Path, help="folder that takes the zip file")
    print(build(parser.parse_args().folder))


if __name__ == "__main__":
    main()
