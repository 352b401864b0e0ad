"""Recorded calls of every kernel: their arguments, and digests of what the kernel made of them.

``python tests/kernels/recorded_calls.py`` records them anew, of conversions and of some tests. That is due if the
arguments of a kernel, or its results on purpose, have changed: the difference of ``recorded_calls.json`` shows which.
"""

import hashlib
import importlib
import json
import re
from collections.abc import Callable
from functools import wraps
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from drawn_scenes import CONVERSIONS, converted

from fpsboost.kernels import binding
from fpsboost.kernels.residual_search import relax_smoothness

ARGUMENTS = Path(__file__).with_suffix(".npz")
DIGESTS = Path(__file__).with_suffix(".json")

Kernel = Callable[..., Any]
KERNELS: dict[str, Kernel] = {
    name: getattr(importlib.import_module(f"fpsboost.kernels.{path.stem}"), name).__wrapped__
    for path in Path(binding.__file__).parent.glob("[a-z]*.py")
    for name in re.findall(r"^@compiled\ndef (\w+)", path.read_text("utf-8"), re.MULTILINE)
}
"""The description of every kernel."""


def digest(name: str, text: Any, arrays: dict[str, np.ndarray]) -> str:
    """Call a kernel with recorded arguments, and digest all arrays after it."""
    arguments = json.loads(
        json.dumps(text), object_hook=lambda place: arrays[place["array"]].copy().transpose(place["axes"])
    )
    parts = hashlib.sha256(repr(binding.compiled(KERNELS[name])(*arguments)).encode())
    json.dumps(arguments, default=lambda array: parts.update(np.ascontiguousarray(array)))
    return parts.hexdigest()[:16]


def record() -> None:
    """Write the last call of each kernel in each conversion and test, unless it gives what another one gives."""
    arrays: dict[str, np.ndarray] = {}
    calls: dict[tuple[str, str], Any] = {}
    reason, arguments_of = "", binding.arguments_of

    def as_text(value: Any) -> Any:
        if not isinstance(value, np.ndarray):
            return value.item()
        axes = np.argsort([-step for step in value.strides], kind="stable")
        held = np.ascontiguousarray(value.transpose(axes)).copy()
        name = hashlib.sha256(repr((held.dtype, held.shape)).encode() + held.tobytes()).hexdigest()[:12]
        arrays[name] = held
        return {"array": name, "axes": np.argsort(axes).tolist()}

    def noting(function: Kernel) -> binding.Field:
        field = arguments_of(function)

        def note(given: Any, compared: Any) -> bytes:
            arguments = given[: len(given) - ("scratch" in function.__annotations__)]
            calls[function.__name__, reason] = json.loads(json.dumps(arguments, default=as_text))
            return field.convert(given, compared)

        return field._replace(convert=note)

    # what nothing is written to would be another in every recording
    np.empty = wraps(np.empty)(lambda shape, dtype=float, **_: np.full(shape, 77, dtype))
    np.empty_like = wraps(np.empty_like)(lambda like, dtype=None, **_: np.full_like(like, 77, dtype))
    binding.arguments_of = noting
    for method, kind in CONVERSIONS:
        reason = f"{method}, {kind}"
        converted(method, kind, (31, 40))
    for reason in (
        "block",
        "guided",
        "level_search",
        "planes",
        "residual_regions",
        "residual_search",
        "search",
        "semi_global",
        "smooth_motion",
    ):
        tests = Path(__file__).with_name(f"test_kernels_{reason}.py")
        assert pytest.main(["-p", "no:cacheprovider", "--hypothesis-seed=1", str(tests)]) == 0
    reason, random = "limits", np.random.default_rng(1)
    motions = random.integers(-8, 9, (2, 2, 9, 12, 2)).astype(np.float32)  # of whole pixels: errors equal to the limits
    relax_smoothness(*motions, np.float32(4), np.float32(5), np.float32(0.25), motions[0, ..., 0].copy())
    binding.arguments_of = arguments_of

    # which only the program that fits the weights calls
    full, _, t, candidates, weighting, around, *_ = calls["blend_hypotheses", "nlm, float32"]
    room = arrays[candidates[2]["array"]].shape[2]
    sizes = (room, 24, 256), (room, 256), (room, 3, 1024), (room, 3, 1024)
    written = [as_text(np.zeros(size, np.float32)) for size in sizes]
    written.append(as_text(np.zeros(1, np.int64)))
    calls["extract_features", ""] = full, 1, 1, t, candidates, weighting, around, *written

    texts: dict[str, dict[str, Any]] = {}
    for (name, _), text in sorted(calls.items(), key=lambda call: call[0]):
        texts.setdefault(name, {}).setdefault(digest(name, text, arrays), text)
    listed = json.dumps({name: list(of_kernel.values()) for name, of_kernel in texts.items()})
    used = {name: array for name, array in arrays.items() if name in listed}
    np.savez_compressed(ARGUMENTS, calls=np.frombuffer(listed.encode(), np.uint8), **used)
    lines = (f"{json.dumps(name)}: {json.dumps(list(of_kernel))}" for name, of_kernel in texts.items())
    DIGESTS.write_text("{\n" + ",\n".join(lines) + "\n}\n")


if __name__ == "__main__":
    record()
