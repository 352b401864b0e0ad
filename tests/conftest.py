"""What several test files need: small sequences of images, the contents of a folder, and a little less patience."""

import gc
import os
import signal
import sys
import threading
from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from hypothesis import settings
from numpy.typing import NDArray

from fpsboost.cli import app, stop_signals
from support.command_line import COLOUR_VARIABLES, Command, Result
from support.exr_truth import write_exr
from support.video_truth import scene

collect_ignore = ["integrations/blender_round_trip.py"]  # runs in Blender


os.environ.setdefault("OMP_WAIT_POLICY", "passive")  # the threads of FLIP would spin while they wait
cv2.setNumThreads(1)  # so would OpenCV's, for images of a few pixels; in the processes that tests start they may

# as in the background of a shell, and after nohup; processes that tests start would inherit it
for name, handler in (("SIGINT", signal.default_int_handler), ("SIGHUP", signal.SIG_DFL)):
    if hasattr(signal, name) and signal.getsignal(getattr(signal, name)) is signal.SIG_IGN:
        signal.signal(getattr(signal, name), handler)

settings.register_profile("fpsboost", deadline=None)  # no test asserts a time
settings.load_profile("fpsboost")

Snapshot = dict[str, bytes | None]
SaveImages = Callable[..., list[NDArray[Any]]]


def pytest_itemcollected(item: pytest.Item) -> None:
    """Mark what needs a browser as slow."""
    if "chromium" in getattr(item, "fixturenames", ()):
        item.add_marker(pytest.mark.slow)


def pytest_collection_finish() -> None:
    """Spare the thousands of tests and the modules from being walked through by every garbage collection."""
    gc.collect()
    gc.freeze()


def pytest_unconfigure() -> None:
    """Let OpenImageIO be torn down, which would print what is left of it."""
    gc.unfreeze()


def pytest_terminal_summary(terminalreporter: pytest.TerminalReporter, config: pytest.Config) -> None:
    """With ``--durations``, print how many seconds the tests of each folder took, in all processes together."""
    if config.getoption("durations") is None:
        return
    seconds: Counter[str] = Counter()
    for report in (each for reports in terminalreporter.stats.values() for each in reports):
        if isinstance(report, pytest.TestReport):
            folder = "/".join(Path(report.location[0]).parent.parts[:2])
            seconds.update({folder: report.duration, "total": report.duration})
    terminalreporter.section("seconds by folder")
    for folder, duration in seconds.most_common():
        terminalreporter.write_line(f"{duration:7.1f}  {folder}")


@pytest.fixture
def snapshot() -> Callable[[Path], Snapshot]:
    """A function that tells every file below a folder with its bytes, hidden ones too, and every folder (None)."""

    def take(folder: Path) -> Snapshot:
        paths = sorted(folder.rglob("*"))
        return {path.relative_to(folder).as_posix(): path.read_bytes() if path.is_file() else None for path in paths}

    return take


@pytest.fixture
def unchanged(snapshot: Callable[[Path], Snapshot]) -> Callable[[Path], AbstractContextManager[None]]:
    """A function that opens a block which leaves everything below a folder as it was, bytes and names."""

    @contextmanager
    def unchanged_block(folder: Path) -> Iterator[None]:
        before = snapshot(folder)
        yield
        assert snapshot(folder) == before

    return unchanged_block


@pytest.fixture
def no_thread_left() -> Iterator[None]:
    """No test leaves a thread behind."""
    before = set(threading.enumerate())
    yield
    assert set(threading.enumerate()) <= before


@pytest.fixture
def save_images() -> SaveImages:
    """A function that writes `count` scenes as ``folder/name`` with ``{}`` for the number, and returns the pixels."""

    def save(folder: Path, name: str = "shot_{:04d}.png", count: int = 5, dtype: type = np.uint8) -> list[NDArray[Any]]:
        folder.mkdir(parents=True, exist_ok=True)
        images = [scene(index).astype(dtype) * (257 if dtype is np.uint16 else 1) for index in range(count)]
        if dtype is np.uint16:  # the low bytes must not follow from the high ones
            images = [image + np.arange(image.size, dtype=dtype).reshape(image.shape) % 200 for image in images]
        if dtype is np.float32:
            images = [image / np.float32(255) for image in images]
        for index, image in enumerate(images):
            path = folder / name.format(index + 1)
            if path.suffix == ".exr":
                write_exr(path, dict(zip("BGR", np.moveaxis(image, -1, 0), strict=True)))
                continue
            path.write_bytes(cv2.imencode(path.suffix, image)[1].tobytes())
        return images

    return save


@pytest.fixture(scope="module")
def chromium() -> Iterator[Any]:
    """A browser; tests that need one are skipped where there is none."""
    from support.browser import BROWSER, launched  # noqa: PLC0415 (tests without a browser need no Playwright)

    if BROWSER is None:
        pytest.skip("there is no Chromium on the PATH")
    with launched() as browser:
        yield browser


@pytest.fixture
def opened(chromium: Any) -> Iterator[Any]:
    """A function that opens a page with a player; nothing is asked of a network, and no error is reported meanwhile."""
    pages: list[Any] = []
    complaints: list[str] = []

    def watch(request: Any) -> None:
        if not request.url.startswith(("file:", "data:", "blob:")):
            complaints.append(request.url)

    def open_page(address: str, width: int = 1200, height: int = 900, **options: Any) -> Any:
        page = chromium.new_page(viewport={"width": width, "height": height}, **options)
        page.on("request", watch)
        page.on("pageerror", lambda error: complaints.append(str(error)))
        page.on("console", lambda message: complaints.append(message.text) if message.type != "log" else None)
        pages.append(page)
        page.goto(address)
        page.locator(".place", has_text="frame").first.wait_for()
        return page

    yield open_page
    for page in pages:
        page.close()
    assert complaints == []


@pytest.fixture(autouse=True)
def impatient(monkeypatch: pytest.MonkeyPatch) -> None:
    """Let threads look for each other every few milliseconds, and wait for no disk: many short clips would add up."""
    monkeypatch.setattr("fpsboost.threads.POLL_INTERVAL", 0.005)
    monkeypatch.setattr("os.fsync", lambda file: None)


@pytest.fixture
def fpsboost_(monkeypatch, capfd, tmp_path) -> Iterator[Command]:
    """Run the command line in this process and in `tmp_path`, as if its output were piped."""
    handlers = {number: signal.getsignal(number) for number in stop_signals()}
    monkeypatch.chdir(tmp_path)
    for name in COLOUR_VARIABLES:
        monkeypatch.delenv(name, raising=False)

    def run(*arguments: object) -> Result:
        monkeypatch.setattr(sys, "argv", ["fpsboost", *map(str, arguments)])
        capfd.readouterr()
        code = 0
        try:
            app.main()
        except SystemExit as stop:
            code = int(stop.code or 0)
        return Result(code, *capfd.readouterr())

    yield run
    for number, handler in handlers.items():
        signal.signal(number, handler)
