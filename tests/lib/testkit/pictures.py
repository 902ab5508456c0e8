"""Draws the pictures of docs/machinist.md from the live demo: ``PYTHONPATH=tests/lib python -m
testkit.pictures``."""

import re
import tempfile
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from pathlib import Path
from queue import Empty, Queue
from threading import Event

from playwright.sync_api import Page, expect, sync_playwright

from stepdiag.base.messages import Words
from stepdiag.demo.files import FAST, WATCHED, Pace
from stepdiag.demo.live import END, GO, live
from stepdiag.demo.operator import READY_S
from testkit.browser import launch

FOLDER = Path(__file__).parents[3] / "docs" / "pictures"
NOBODYS_PATH = """document.querySelectorAll("[data-link=laser] small").forEach((one) => {
  one.textContent = one.textContent.replace(/^\\/[^,]+/, "/dev/ttyUSB0");
})"""
"""Where the virtual laser stands is a folder of this computer."""
SEED, COMPLETE_S = 1, 900.0
PANELS = {
    "lead": ".lead",
    "now": ".reading",
    "align": ".aid",
    "deviations": ".pass",
    "survey": ".survey",
    "findings": ".findings",
}


def draw(folder: Path) -> None:
    """Write one picture for each thing the guide speaks of: `stepdiag demo --live` with its laser
    unplugged, and a survey to its end."""
    with _demonstrated(WATCHED) as (hand, page):
        expect(page.locator("body")).to_have_attribute("data-stage", "set-up")
        _take(page, folder, "align", screen="next")
        hand.press(GO)
        expect(page.locator("#lead")).to_contain_text(re.compile("stop [4-9] of"))
        _take(page, folder, "deviations", "now", "survey", screen="drive")
        hand.press("u")
        expect(page.locator(".figures.stale")).to_be_visible()
        _take(page, folder, screen="trouble")
        page.locator(".reading").screenshot(path=folder / "old.png")
    with _demonstrated(FAST) as (hand, page):
        page.locator("#token").fill(hand.token)
        page.locator("#unlock button").click()
        hand.until_complete()
        expect(page.locator("#result figure")).to_have_count(9)
        _take(page, folder, "findings", screen="result")


class Hand:
    """The person at the demo: presses what is asked of it, and Enter wherever a program is waited
    for once it is to be completed."""

    def __init__(self) -> None:
        self.page: Queue[tuple[str, str]] = Queue()
        self._keys: Queue[str] = Queue()
        self.token = ""
        self._complete, self._hurried = Event(), False

    def opened(self, address: str, token: str) -> None:
        """Take the address of the page and its token."""
        self.page.put((address, token))

    def show(self, line: Words) -> None:
        """Take note of the end of the survey."""
        if str(line).startswith("complete: "):
            self._complete.set()

    def pressed(self) -> str:
        """Return the next key."""
        try:
            return self._keys.get_nowait()
        except Empty:
            return GO if self._hurried else ""

    def press(self, key: str) -> None:
        """Press a key."""
        self._keys.put(key)

    def until_complete(self) -> None:
        """Press Enter until the survey is complete."""
        self._hurried = True
        assert self._complete.wait(COMPLETE_S)


@contextmanager
def _demonstrated(pace: Pace) -> Iterator[tuple[Hand, Page]]:
    """Run the live demo and look at its page while the block runs."""
    hand = Hand()
    with (
        tempfile.TemporaryDirectory() as work,
        ThreadPoolExecutor(1) as running,
        sync_playwright() as playwright,
    ):
        demo = running.submit(live, Path(work) / "demo", SEED, hand, pace)
        try:
            address, token = hand.page.get(timeout=READY_S)
            browser = launch(playwright)
            page = browser.new_page(viewport={"width": 1024, "height": 768})
            page.goto(address)
            hand.token = token
            yield hand, page
            browser.close()
        finally:
            hand.press(END)
            demo.result()


def _take(page: Page, folder: Path, *panels: str, screen: str) -> None:
    page.wait_for_timeout(400)
    page.evaluate(NOBODYS_PATH)
    page.screenshot(path=folder / f"{screen}.png")
    for panel in panels:
        page.locator(PANELS[panel]).screenshot(path=folder / f"{panel}.png")


if __name__ == "__main__":
    FOLDER.mkdir(exist_ok=True)
    draw(FOLDER)
