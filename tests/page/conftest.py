"""A real browser for the tests of the page; what it complains about, and any request that leaves the machine, fails the test."""

from collections.abc import Iterator
from pathlib import Path

import pytest
from playwright.sync_api import Browser, Page, sync_playwright

from testkit.browser import Watched, launch
from testkit.played import Served, served

TOKEN = "a token of the tests: äöü ☃"


@pytest.fixture(scope="session")
def browser() -> Iterator[Browser]:
    with sync_playwright() as playwright:
        running = launch(playwright)
        yield running
        running.close()


@pytest.fixture
def daemon(tmp_path: Path) -> Iterator[Served]:
    """A page over a played survey, with commands allowed."""
    with served(tmp_path, token=TOKEN) as running:
        yield running


@pytest.fixture
def watched(browser: Browser) -> Iterator[Watched]:
    """Opens pages and, at the end, fails on any complaint."""
    watching = Watched(browser)
    yield watching
    watching.close()


@pytest.fixture
def page(watched: Watched, daemon: Served) -> Page:
    """The page as a desk computer shows it, its first picture drawn."""
    return watched.open(daemon.address)
