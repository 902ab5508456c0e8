"""Draws the pictures of docs/machinist.md from a real survey: ``PYTHONPATH=tests/lib python -m testkit.pictures``."""

import re
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from playwright.sync_api import Page, expect, sync_playwright

from stepdiag.demo.files import siemens_profile
from stepdiag.virtual.base.reserved import reserved_port
from testkit.browser import launch
from testkit.exact.siemens_files import HALL_EXPORT
from testkit.running.hall import Hall, daemon, hall, until

FOLDER = Path(__file__).parents[3] / "docs" / "pictures"
NOBODYS_PATH = """document.querySelectorAll("[data-link=laser] small").forEach((one) => {
  one.textContent = one.textContent.replace(/^\\/[^,]+/, "/dev/ttyUSB0");
})"""
"""Where the virtual laser stands is a folder of this computer."""
PANELS = {"lead": ".lead", "now": ".reading", "align": ".aid", "deviations": ".pass", "survey": ".survey", "findings": ".findings"}


def draw(folder: Path) -> None:
    """Write one picture for each thing the guide speaks of: a survey to its end, then one whose laser is unplugged."""
    with _surveyed() as (place, process, page):
        _take(page, folder, "align", screen="next")
        _until_driven(place, page)
        _take(page, folder, "deviations", "now", "survey", screen="drive")
        place.setups = place.setups[1:]
        place.start_setups()
        until(process, "survey-complete", timeout_s=600.0)
        expect(page.locator("#result figure")).to_have_count(9)
        _take(page, folder, "findings", screen="result")
    with _surveyed() as (place, _, page):
        _until_driven(place, page)
        place.bench.say('fault {"kind": "laser-unplug", "duration_s": 30.0}')
        expect(page.locator(".figures.stale")).to_be_visible()
        _take(page, folder, screen="trouble")
        page.locator(".reading").screenshot(path=folder / "old.png")


@contextmanager
def _surveyed() -> Iterator[tuple[Hall, Any, Page]]:
    """Serve a survey of the virtual machine and look at its page while the block runs."""
    port = reserved_port()
    how = {"back": True, "handshake": True, "dwell": 2.0, "page": True, "page_port": port, "exports": HALL_EXPORT}
    with (
        tempfile.TemporaryDirectory() as work,
        hall(Path(work), **how) as place,
        _profiled(place),
        daemon(place.survey) as process,
        sync_playwright() as playwright,
    ):
        browser = launch(playwright)
        page = browser.new_page(viewport={"width": 1024, "height": 768})
        page.goto(f"http://127.0.0.1:{port}")
        expect(page.locator("body")).to_have_attribute("data-stage", "set-up")
        yield place, process, page
        browser.close()


@contextmanager
def _profiled(place: Hall) -> Iterator[None]:
    """Let the profile of the machine that is measured stand beside its survey."""
    (place.folder / "siemens.toml").write_text(siemens_profile().replace("virtual machine", "virtual"), encoding="utf-8")
    yield


def _until_driven(place: Hall, page: Page) -> None:
    while place.bench.next(300.0, "bench")["event"] != "waiting":
        pass
    place.bench.say("start")
    expect(page.locator("#lead")).to_contain_text(re.compile("stop [2-6] of"))


def _take(page: Page, folder: Path, *panels: str, screen: str) -> None:
    page.wait_for_timeout(400)
    page.evaluate(NOBODYS_PATH)
    page.screenshot(path=folder / f"{screen}.png")
    for panel in panels:
        page.locator(PANELS[panel]).screenshot(path=folder / f"{panel}.png")


if __name__ == "__main__":
    FOLDER.mkdir(exist_ok=True)
    draw(FOLDER)
