"""A real browser for the tests of the page; what it complains about, and any request that leaves
the machine, fails the test."""

from collections.abc import Iterator

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


@pytest.fixture(scope="module")
def serving(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Served]:
    """The page's process over a played survey, one for all tests of a module, without a token:
    everybody may read, nobody may command."""
    with served(tmp_path_factory.mktemp("survey")) as running:
        yield running


@pytest.fixture
def daemon(serving: Served) -> Served:
    """A page over a played survey that begins anew with every test."""
    serving.do(serving.survey.begin_anew)
    return serving


@pytest.fixture
def watched(browser: Browser, request: pytest.FixtureRequest) -> Iterator[Watched]:
    """Opens pages and, at the end, fails on any complaint; closes them before the daemon of the
    test ends."""
    if "daemon" in request.fixturenames:
        request.getfixturevalue("daemon")
    watching = Watched(browser)
    yield watching
    watching.close()


@pytest.fixture(scope="module")
def resting(serving: Served) -> Iterator[list[tuple[Watched, Page]]]:
    """The page of a module's tests while none of them uses it: nothing before the first and after
    one that complained."""
    kept: list[tuple[Watched, Page]] = []
    yield kept
    for watching, _ in kept:
        watching.leave()


@pytest.fixture
def page(
    browser: Browser, resting: list[tuple[Watched, Page]], daemon: Served
) -> Iterator[Page]:
    """The page as a desk computer shows it, its first picture drawn; it remembers nothing of the
    test before."""
    watching, shown = resting.pop() if resting else (Watched(browser), None)
    try:
        if shown is None:
            shown = watching.open(daemon.address)
        else:
            watching.begin_again(shown, daemon.address)
        yield shown
        watching.rest(shown)
    except BaseException:
        watching.leave()
        raise
    resting.append((watching, shown))
