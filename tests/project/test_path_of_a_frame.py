"""The path of a frame, as CONTRIBUTING.md tells it, is the one that a conversion takes."""

import re
import sys
import threading
from pathlib import Path
from types import CodeType, FrameType
from typing import Any

import av
import numpy as np

import fpsboost
from fpsboost import RunOptions, convert
from support.truth import as_type, waves
from support.video_truth import write_clip

PACKAGE = Path(fpsboost.__file__).parent
PLUMBING = {"options", "frame_cache", "image"}
"""Modules that pass on what they get: checks of arguments, caches and views."""

Step = tuple[str, str]
"""Module, and the type of an object that it hands to another module."""


def told() -> list[Step]:
    """The modules of the page's table, in order, each with the first type of its row."""
    page = (PACKAGE.parent / "CONTRIBUTING.md").read_text(encoding="utf-8")
    table = page.split("**The path of a frame**")[1].split("```")[1]
    return re.findall(r"^ ([a-z_/]+) +(?:av\.)?(\w+)", table, re.MULTILINE)


def carries(value: Any, depth: int = 4) -> bool:
    """Whether an object holds a packet, a decoded picture, pixels or motion."""
    if isinstance(value, np.ndarray):
        return value.ndim > 1
    if isinstance(value, av.VideoFrame | av.Packet) or depth == 0:
        return depth > 0
    if isinstance(value, tuple | list):
        return any(carries(each, depth - 1) for each in value)
    names = [*getattr(value, "__dict__", ()), *getattr(type(value), "__slots__", ())]
    of_package = type(value).__module__.startswith("fpsboost")
    return of_package and any(carries(getattr(value, name, None), depth - 1) for name in names)


class HandOvers:
    """Profiler that notes what modules hand to each other: what functions return, yield, and take as arguments."""

    def __init__(self) -> None:
        self.seen: dict[Step, None] = {}
        self._modules: dict[CodeType, str | None] = {}

    def __call__(self, frame: FrameType, event: str, value: Any) -> None:
        here = self._module(frame)
        there = self._module_outside(frame) if here else None
        if here is None or there is None or here == there:
            return
        code = frame.f_code
        if event == "return":
            self._note(here, [value])
        elif event == "call":
            names = code.co_varnames[: code.co_argcount + code.co_kwonlyargcount]
            self._note(there, [frame.f_locals.get(name) for name in names])

    def _note(self, giver: str, values: list[Any]) -> None:
        for value in values:
            for each in value if type(value) in (tuple, list) else [value]:
                step = giver, type(each).__name__
                if step not in self.seen and carries(each):
                    self.seen[step] = None

    def _module(self, frame: FrameType) -> str | None:
        """The module of the package that a function is of, unless it is plumbing."""
        code = frame.f_code
        if code not in self._modules:
            path = Path(code.co_filename)
            name = path.relative_to(PACKAGE).with_suffix("").as_posix() if path.is_relative_to(PACKAGE) else None
            self._modules[code] = None if name in PLUMBING else name
        return self._modules[code]

    def _module_outside(self, frame: FrameType) -> str | None:
        """The module that has called it, behind plumbing."""
        caller = frame.f_back
        while caller is not None and self._module(caller) is None:
            caller = caller.f_back
        return None if caller is None else self._module(caller)


def test_the_page_tells_the_path_of_a_frame(tmp_path):
    """Each row is an object that its module hands on, in this order; one module comes again, of 20 types in all."""
    y, x = np.mgrid[:64, :96] / 1.0
    moved = [as_type(waves(x - 3 * number, y, 3, 1), np.uint8) for number in range(4)]
    clip = write_clip(tmp_path / "in.mkv", times=range(4), picture=lambda number, *_: moved[number])
    noted = HandOvers()
    threading.setprofile(noted)
    sys.setprofile(noted)
    try:
        convert(clip, tmp_path / "out.mkv", run=RunOptions(threads=1))
    finally:
        sys.setprofile(None)
        threading.setprofile(None)  # type: ignore[arg-type]
    places = [list(noted.seen).index(step) for step in told()]
    assert places == sorted(places)
    modules = [module for module, _ in told()]
    assert len(modules) - len(set(modules)) <= 1
    assert len({name for _, name in noted.seen} - {"ndarray"}) <= 20
