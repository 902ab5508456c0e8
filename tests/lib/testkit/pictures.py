"""Draws the pictures of docs/machinist.md from the page over a played survey: ``PYTHONPATH=tests/lib python -m testkit.pictures``."""

import tempfile
from pathlib import Path

from playwright.sync_api import Page, expect, sync_playwright

from stepdiag.daq.records.status import FindingStatus
from testkit.browser import launch
from testkit.played import Served, served

FOLDER = Path(__file__).parents[3] / "docs" / "pictures"


def draw(folder: Path) -> None:
    """Write one picture for each thing the guide speaks of."""
    with tempfile.TemporaryDirectory() as work, served(Path(work)) as daemon, sync_playwright() as playwright:
        browser = launch(playwright)
        page = browser.new_page(viewport={"width": 820, "height": 1100})
        page.goto(daemon.address)
        expect(page.locator("#machine")).to_have_text("VM 500")
        _take(page, ".next", folder / "next.png")
        _drive(daemon)
        expect(page.locator("#deviations .dot.s1")).to_have_count(14)
        for panel in ("now", "survey", "align", "deviations", "findings"):
            _take(page, f".{panel}", folder / f"{panel}.png")
        daemon.do(lambda: daemon.survey.silent.add("laser"))
        expect(page.locator(".big.stale")).to_be_visible()
        _take(page, ".now", folder / "old.png")
        daemon.do(daemon.survey.complete)
        expect(page.locator("#result figure")).to_have_count(9)
        _take(page, ".result", folder / "result.png")
        browser.close()


def _drive(daemon: Served) -> None:
    for pass_number, stops in ((1, 31), (2, 14)):
        for stop in range(stops):
            daemon.do(lambda stop=stop, pass_number=pass_number: daemon.survey.stop("npp", pass_number, stop))
    text = "setup npp, pass 1, stop 12 of 30: scatter 0.9 um in the dwell"
    daemon.do(lambda: daemon.survey.publish(findings=(FindingStatus(code="stop-doubtful", severity="warning", text=text),)))


def _take(page: Page, panel: str, path: Path) -> None:
    page.wait_for_timeout(300)
    page.locator(f"section{panel}").screenshot(path=path)


if __name__ == "__main__":
    FOLDER.mkdir(exist_ok=True)
    draw(FOLDER)
