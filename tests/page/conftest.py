"""A real browser for the tests of the page; what it complains about, and any request that leaves the machine, fails the test."""

from collections.abc import Iterator
from pathlib import Path

import pytest
from playwright.sync_api import Browser, Page, sync_playwright

from testkit.browser import Watched, launch
from testkit.played import Served, served


@pytest.fixture(scope="session")
def browser() -> Iterator[Browser]:
    with sync_playwright() as playwright:
        running = launch(playwright)
        yield running
        running.close()


@pytest.fixture
def daemon(tmp_path: Path) -> Iterator[Served]:
    """A page over a played survey, without a token: everybody may read, nobody may command."""
    with served(tmp_path) as running:
        yield running


@pytest.fixture
def watched(browser: Browser, request: pytest.FixtureRequest) -> Iterator[Watched]:
    """Opens pages and, at the end, fails on any complaint; closes them before the daemon of the test ends."""
    if "daemon" in request.fixturenames:
        request.getfixturevalue("daemon")
    watching = Watched(browser)
    yield watching
    watching.close()


@pytest.fixture
def page(watched: Watched, daemon: Served) -> Page:
    """The page as a desk computer shows it, its first picture drawn."""
    return watched.open(daemon.address)
