"""How conversions share cores: several at once, or one of several workers, pinned to as many cores. Linux only."""

from __future__ import annotations

import json
import os
import sys
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from subprocess import PIPE, Popen
from typing import Any, NoReturn

from conversion_cost import READY

from fpsboost.errors import OptionError
from fpsboost.threads import available_cores


def worker_counts() -> list[int]:
    """Return the powers of two up to the number of available cores."""
    return [2**power for power in range(available_cores().bit_length())]


@contextmanager
def pinned(count: int) -> Iterator[None]:
    """Pin processes started in the block to the first `count` cores, before their libraries count the cores."""
    cores = os.sched_getaffinity(0)
    os.sched_setaffinity(0, sorted(cores)[:count])
    try:
        yield
    finally:
        os.sched_setaffinity(0, cores)


def convert_together(clip: str, folder: str, method: str, *, workers: int, conversions: int) -> list[dict[str, Any]]:
    """Run conversions at once, on as many cores as they have workers in all; return what `conversion_cost.py` prints.

    They begin together, when all have loaded their kernels, and each has this number of workers.
    """
    program = [sys.executable, str(Path(__file__).with_name("conversion_cost.py")), clip]
    options = ["--method", method, "--workers", str(workers)]
    commands = [[*program, str(Path(folder, f"out{number}.mp4")), *options] for number in range(conversions)]
    with ExitStack() as stack:
        with pinned(workers * conversions):
            running = [stack.enter_context(Popen(each, stdin=PIPE, stdout=PIPE, text=True)) for each in commands]
        for each in running:
            _wait_until_ready(each)
        for each in running:
            print(file=each.stdin, flush=True)
        return [_figures(each) for each in running]


def _wait_until_ready(process: Popen[str]) -> None:
    assert process.stdout is not None
    if process.stdout.readline().strip() != READY:
        process.wait()
        _stop(process)


def _figures(process: Popen[str]) -> dict[str, Any]:
    assert process.stdout is not None
    printed = process.stdout.read()
    if process.wait():
        _stop(process)
    figures: dict[str, Any] = json.loads(printed.splitlines()[-1])
    return figures


def _stop(process: Popen[str]) -> NoReturn:
    """Raise the error of a failed conversion; its own message is on standard error."""
    raise OptionError(f"A conversion ended with code {process.returncode}.")


def serial_share(busy: float, workers: int) -> float:
    """Return the share of work that is serial by Amdahl's law, by the share of the cores' time in which they work.

    With one unit of work, a run takes ``share + (1 - share) / workers``, and all cores are busy for a unit in all.
    """
    return max(0.0, (1 / busy - 1) / (workers - 1))


def times_faster(serial: float, workers: int) -> float:
    """Return the speed-up of several workers over one by Amdahl's law."""
    return 1 / (serial + (1 - serial) / workers)
