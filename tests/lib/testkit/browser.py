"""Debian's chromium without a window under Playwright, kept offline, and its complaints."""

import shutil
from collections.abc import Callable, Mapping
from functools import partial
from pathlib import Path
from typing import Any
from urllib.parse import urlsplit

from playwright.sync_api import Browser, BrowserContext, Page, Playwright, Route, expect

QUIET = [
    "--disable-quic",
    "--no-first-run",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-sync",
]
AXE = Path(__file__).parents[2] / "page" / "node" / "node_modules" / "axe-core" / "axe.min.js"
PATIENCE_MS = 60_000
AWAY = "net::ERR_"
"""What chromium says where the daemon is away; the tests that end the daemon expect it."""


def launch(playwright: Playwright) -> Browser:
    """Return chromium; it needs no sandbox for pages of ours alone. What is awaited may take as
    long as a busy computer takes.

    The same engine without the browser around it, which draws tabs and menus for every page: two
    thirds of the work.
    """
    expect.set_options(timeout=PATIENCE_MS)
    program = shutil.which("chromium-headless-shell")
    assert program, (
        "chromium-headless-shell is needed: apt-get install chromium-headless-shell"
    )
    return playwright.chromium.launch(
        executable_path=program, chromium_sandbox=False, args=QUIET
    )


class Watched:
    """Pages whose console, errors and requests are kept."""

    def __init__(self, browser: Browser, machine: str = "VM 500") -> None:
        self._browser = browser
        self._machine = machine
        self._contexts: list[BrowserContext] = []
        self._addresses: set[str] = set()
        self.complaints: list[str] = []
        self.requests: list[str] = []
        self.daemon_may_be_away = False

    def open(
        self,
        address: str,
        *,
        width: int = 1280,
        height: int = 900,
        scheme: Any = "light",
        path: str = "/",
        change: Mapping[str, tuple[str, str]] | None = None,
    ) -> Page:
        """Open the page in a context of its own and wait for the first picture; ``change`` puts
        other words into its scripts."""
        context = self._browser.new_context(
            viewport={"width": width, "height": height},
            color_scheme=scheme,
            accept_downloads=True,
        )
        self._contexts.append(context)
        self._addresses.add(address)
        context.set_default_timeout(PATIENCE_MS)
        page = context.new_page()
        page.on(
            "console",
            lambda message: self.complaints.append(f"console {message.type}: {message.text}"),
        )
        page.on("pageerror", lambda error: self.complaints.append(f"error: {error}"))
        page.on("request", lambda request: self.requests.append(request.url))
        for name, (old, new) in (change or {}).items():
            page.route(f"**/{name}", partial(_answer, old=old, new=new))
        self._go(page, address + path)
        return page

    def begin_again(self, page: Page, address: str) -> None:
        """Show an opened page that rests as it is shown the first time: half the work of a context
        of its own."""
        self._go(page, address)

    def rest(self, page: Page) -> None:
        """Raise as `close` does; then forget all that a person did at the page and leave it where
        no script of ours runs."""
        self._raise()
        page.evaluate("localStorage.clear(); sessionStorage.clear()")
        page.goto("about:blank")
        page.mouse.move(0, 0)
        # what the page that was left still asked or said is nobody's
        self.requests.clear()
        self.complaints.clear()

    def close(self) -> None:
        """Close the pages; raise where one complained or asked for anything but the daemon."""
        self.leave()
        self._raise()

    def leave(self) -> None:
        """Close the pages."""
        for context in self._contexts:
            context.close()
        self._contexts.clear()

    def _go(self, page: Page, address: str) -> None:
        page.goto(address)
        if urlsplit(address).path in ("", "/"):
            expect(page.locator("#machine")).to_have_text(self._machine, timeout=PATIENCE_MS)

    def _raise(self) -> None:
        foreign = [
            url
            for url in self.requests
            if not any(url.startswith(known) for known in self._addresses)
        ]
        assert foreign == [], "no request leaves the machine"
        assert self.requests, "a page that asks for nothing shows nothing"
        complaints = [
            one for one in self.complaints if not (self.daemon_may_be_away and AWAY in one)
        ]
        assert complaints == [], complaints


def _answer(route: Route, *, old: str, new: str) -> None:
    """Answer a request with the daemon's own answer, one piece of it changed."""
    answer = route.fetch()
    text = answer.text()
    assert old in text, old
    route.fulfill(response=answer, body=text.replace(old, new))


BEAT_MS = 20
"""A beat of the page itself. One that comes later than twice this was kept waiting by others: the
rest is no time of the page's."""
_BEAT = """(seen) => {
  const beat = { lived: 0, last: performance.now(), took: null };
  if (seen()) throw new Error("seen before it was brought about");
  beat.timer = setInterval(() => {
    const now = performance.now();
    beat.lived += Math.min(now - beat.last, 2 * PERIOD);
    beat.last = now;
    if (!seen()) return;
    beat.took = beat.lived / 1000;
    clearInterval(beat.timer);
  }, PERIOD);
  window.testBeat = beat;
}""".replace("PERIOD", str(BEAT_MS))


def lived_until(page: Page, seen: str, bring_about: Callable[[], object]) -> float:
    """Return how long a page lives, in s, from before something is brought about until ``seen``, an
    expression of its own, is true.

    Counted by the page's own beats: what a busy computer keeps from it does not count, and nothing
    else is taken off.
    """
    page.evaluate(f"({_BEAT})(() => {seen})")
    bring_about()
    for _ in range(PATIENCE_MS // BEAT_MS):
        took = page.evaluate("window.testBeat.took")
        if took is not None:
            return float(took)
        page.wait_for_timeout(BEAT_MS)
    raise AssertionError(f"not seen: {seen}")


def violations(page: Page) -> list[str]:
    """Return what axe-core finds wrong (WCAG 2.1 AA: contrast, labels, roles), one line a node."""
    if not page.evaluate("'axe' in window"):
        page.evaluate(AXE.read_text(encoding="utf-8"))
    tags = ["wcag2a", "wcag2aa", "wcag21a", "wcag21aa", "best-practice"]
    # of what is right axe describes each place too, which takes two thirds of its time
    run = (
        "tags => axe.run(document, { runOnly: tags, resultTypes: ['violations'] }).then((found) "
        "=> found.violations)"
    )
    return [
        f"{one['id']}: {node['html'][:120]} {node['failureSummary']}"
        for one in page.evaluate(run, tags)
        for node in one["nodes"]
    ]
