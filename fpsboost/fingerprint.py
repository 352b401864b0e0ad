"""Identity of a job: its input files and options as text, by which a later run tells whether it would do the same."""

from __future__ import annotations

import hashlib
import json
import os
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import fields, is_dataclass
from pathlib import Path
from typing import Any, Protocol, runtime_checkable

IDENTIFYING_BYTES = 1 << 16  # bytes at the beginning and at the end of a file that identify it together with its size


@runtime_checkable
class ReadsFiles(Protocol):
    """Contract: option that refers to files whose content determines the output."""

    @property
    def files(self) -> Sequence[Path]:
        """All files."""


def fingerprint_options(state_of: Callable[[Iterable[Path]], str] | None = None, /, **values: Any) -> dict[str, str]:
    """Return the options of a job as text: the fields of dataclasses one by one, everything else by `str`.

    Options that read files contribute the state of the files, too, by `fingerprint_files` or another function.
    """
    facts = (_facts(name, value, state_of or fingerprint_files) for name, value in values.items())
    return dict(fact for facts_of_value in facts for fact in facts_of_value)


def _facts(name: str, value: Any, state_of: Callable[[Iterable[Path]], str]) -> Iterator[tuple[str, str]]:
    if isinstance(value, ReadsFiles):
        yield f"{name}_files", state_of(value.files)
    if not is_dataclass(value):
        yield name, str(value)
        return
    yield name, type(value).__name__
    for field in fields(value):
        yield from _facts(f"{name}.{field.name}", getattr(value, field.name), state_of)


def fingerprint_files(files: Iterable[Path]) -> str:
    """Return a digest of names, sizes and modification times, which changes if a file is replaced."""
    listed = json.dumps([(file.name, file.stat().st_size, file.stat().st_mtime_ns) for file in files])
    return hashlib.sha256(listed.encode()).hexdigest()


def identify_files(files: Iterable[Path]) -> str:
    """Return a digest of sizes, beginnings and ends, which are the same for copies of the files on other machines."""
    digest = hashlib.sha256()
    for path in files:
        with path.open("rb") as file:
            size = file.seek(0, os.SEEK_END)
            digest.update(f"{size}\n".encode())
            for begin in (0, max(0, size - IDENTIFYING_BYTES)):
                file.seek(begin)
                digest.update(file.read(IDENTIFYING_BYTES))
    return digest.hexdigest()
