"""Draw the pages of the documentation's guides: ``python docs/make_page_figures.py``, into ``docs/figures/``.

The pages of `fpsboost compare`, `preview` and `ui` for the sample clip, as Chromium shows them. Needs an installed
fpsboost with the extras ``dev`` and ``ui``, and Chromium; takes about a minute.
"""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from io import BytesIO
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from PIL import Image
from playwright.sync_api import Page, sync_playwright

ROOT = Path(__file__).parents[1]
FIGURES = ROOT / "docs" / "figures"

VIEW = {"width": 1280, "height": 800}

COMMAND = [sys.executable, "-m", "fpsboost"]

CHROMIUM = next(filter(None, map(shutil.which, ("chromium", "chromium-headless-shell"))), None)


def main() -> None:
    """Draw all pages, and print the size of each file."""
    with TemporaryDirectory() as folder, sync_playwright() as playwright:
        clip = Path(shutil.copy(ROOT / "samples" / "orbit.mp4", folder))
        browser = playwright.chromium.launch(args=["--no-sandbox"], executable_path=CHROMIUM)
        page = browser.new_page(bypass_csp=True, viewport=VIEW, color_scheme="light", reduced_motion="reduce")
        page.set_default_timeout(240_000)
        draw_compare(page, clip)
        draw_preview(page, clip)
        draw_ui(page, clip)
        browser.close()


def draw_compare(page: Page, clip: Path) -> None:
    """Draw the page of a comparison."""
    report = clip.parent / "report"
    methods = ["-m", "nlm,nlm-fast,dis,blend", "--range", "0:60"]
    subprocess.run([*COMMAND, "compare", str(clip), *methods, "--report", str(report), "--quiet"], check=True)
    page.goto((report / "index.html").as_uri())
    page.locator(".place").get_by_text("frame").wait_for()
    save(page, "page-compare")
    page.locator('[data-mode="boost"]').click()
    page.locator('[data-side="right"]').get_by_text("dis", exact=True).click()
    save(page, "page-compare-differences", page.locator(".player").first.bounding_box())


def draw_preview(page: Page, clip: Path) -> None:
    """Draw the page of a preview."""
    path = clip.parent / "preview.html"
    subprocess.run([*COMMAND, "preview", str(clip), str(path), "--quiet"], check=True)
    page.goto(path.as_uri())
    page.locator(".place").get_by_text("frame").wait_for()
    save(page, "page-preview")


def draw_ui(page: Page, clip: Path) -> None:
    """Draw the page of `fpsboost ui` after a conversion."""
    films = clip.parent / "films"
    films.mkdir()
    clip.rename(films / clip.name)
    with serving(films, clip.parent / "state") as address:
        page.goto(address)
        page.get_by_role("button", name=clip.name).click()
        page.get_by_text("In the middle between").wait_for()
        page.get_by_text("144 frames").first.wait_for()
        page.get_by_role("button", name="Convert").click()
        page.locator("#jobs video[controls]").wait_for()
        page.wait_for_function("[...document.querySelectorAll('#jobs video')].every((video) => video.readyState > 1)")
        page.mouse.move(0, 0)
        page.set_viewport_size({"width": VIEW["width"], "height": 1060})
        page.evaluate("scrollTo(0, 0)")
        for note in page.locator("#folder, .result .note").all():  # a place that readers have, too
            text = note.inner_text().replace(str(films), "~/Videos")
            note.evaluate("(note, text) => (note.textContent = text)", text)
        save(page, "page-ui")


@contextmanager
def serving(films: Path, state: Path) -> Iterator[str]:
    """Run `fpsboost ui` while the block lasts; return its address."""
    words = [*COMMAND, "ui", str(films), "--no-browser", "--port", "0"]
    environment = {**os.environ, "XDG_STATE_HOME": str(state)}
    with subprocess.Popen(words, stdout=subprocess.PIPE, text=True, env=environment) as process:
        assert process.stdout is not None
        try:
            yield process.stdout.readline().removeprefix("The page: ").strip()
        finally:
            process.terminate()


def save(page: Page, name: str, clip: Any = None) -> None:
    """Save what is seen of a page or in a rectangle, and print the size of the file."""
    page.wait_for_timeout(1000)  # until what moves has come to rest
    path = FIGURES / f"{name}.webp"
    Image.open(BytesIO(page.screenshot(clip=clip))).convert("RGB").save(path, quality=65, method=6)
    print(f"{path.relative_to(ROOT)}: {path.stat().st_size / 1000:.0f} kB")


if __name__ == "__main__":
    main()
