"""Draws the pictures of docs/machinist.md from a real survey: ``PYTHONPATH=tests/lib python -m testkit.pictures``."""

import re
import socket
import tempfile
from pathlib import Path

from playwright.sync_api import Page, expect, sync_playwright

from testkit.browser import launch
from testkit.running.hall import daemon, hall, until

FOLDER = Path(__file__).parents[3] / "docs" / "pictures"
PANELS = {"lead": ".lead", "now": ".reading", "align": ".aid", "deviations": ".pass", "survey": ".survey", "findings": ".findings"}


def draw(folder: Path) -> None:
    """Write one picture for each thing the guide speaks of."""
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        port = probe.getsockname()[1]
    with (
        tempfile.TemporaryDirectory() as work,
        hall(Path(work), back=True, handshake=True, dwell=4.0, page=True, page_port=port) as place,
        daemon(place.survey) as process,
        sync_playwright() as playwright,
    ):
        browser = launch(playwright)
        page = browser.new_page(viewport={"width": 1024, "height": 768})
        page.goto(f"http://127.0.0.1:{port}")
        expect(page.locator("body")).to_have_attribute("data-stage", "set-up", timeout=60_000)
        _take(page, folder, "align", screen="next")
        while place.bench.next(300.0, "bench")["event"] != "waiting":
            pass
        place.bench.say("start")
        expect(page.locator("#lead")).to_contain_text(re.compile("stop [2-6] of"), timeout=60_000)
        _take(page, folder, "now", "deviations", "survey", screen="drive")
        place.bench.say('fault {"kind": "laser-unplug", "duration_s": 4.0}')
        expect(page.locator(".figures.stale")).to_be_visible(timeout=60_000)
        _take(page, folder, screen="trouble")
        page.locator(".reading").screenshot(path=folder / "old.png")
        place.setups = place.setups[1:]
        place.start_setups()
        until(process, "survey-complete", timeout_s=900.0)
        expect(page.locator("#result figure")).to_have_count(9, timeout=60_000)
        _take(page, folder, "findings", screen="result")
        browser.close()


def _take(page: Page, folder: Path, *panels: str, screen: str) -> None:
    page.wait_for_timeout(400)
    page.screenshot(path=folder / f"{screen}.png")
    for panel in panels:
        page.locator(PANELS[panel]).screenshot(path=folder / f"{panel}.png")


if __name__ == "__main__":
    FOLDER.mkdir(exist_ok=True)
    draw(FOLDER)
