"""Debian's chromium under Playwright, kept offline, and its complaints."""

import shutil
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

from playwright.sync_api import Browser, BrowserContext, Page, Playwright, expect

from testkit.running.steady import watched

QUIET = ["--disable-quic", "--no-first-run", "--disable-background-networking", "--disable-component-update", "--disable-sync"]
AXE = Path(__file__).parents[2] / "page" / "node" / "node_modules" / "axe-core" / "axe.min.js"
PATIENCE_MS = 60_000
AWAY = "net::ERR_"
"""What chromium says where the daemon is away; the tests that end the daemon expect it."""


def launch(playwright: Playwright) -> Browser:
    """Return chromium; it needs no sandbox for pages of ours alone. What is awaited may take as long as a busy computer takes."""
    expect.set_options(timeout=PATIENCE_MS)
    program = shutil.which("chromium")
    assert program, "chromium is needed: apt-get install chromium"
    return playwright.chromium.launch(executable_path=program, chromium_sandbox=False, args=QUIET)


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

    def open(self, address: str, *, width: int = 1280, height: int = 900, scheme: Any = "light", path: str = "/") -> Page:
        """Open the page in a context of its own and wait for the first picture."""
        context = self._browser.new_context(viewport={"width": width, "height": height}, color_scheme=scheme, accept_downloads=True)
        self._contexts.append(context)
        self._addresses.add(address)
        context.set_default_timeout(PATIENCE_MS)
        page = context.new_page()
        page.on("console", lambda message: self.complaints.append(f"console {message.type}: {message.text}"))
        page.on("pageerror", lambda error: self.complaints.append(f"error: {error}"))
        page.on("request", lambda request: self.requests.append(request.url))
        page.goto(address + path)
        if path == "/":
            expect(page.locator("#machine")).to_have_text(self._machine, timeout=PATIENCE_MS)
        return page

    def close(self) -> None:
        """Close the pages; raise where one complained or asked for anything but the daemon."""
        for context in self._contexts:
            context.close()
        foreign = [url for url in self.requests if not any(url.startswith(known) for known in self._addresses)]
        assert foreign == [], "no request leaves the machine"
        assert self.requests, "a page that asks for nothing shows nothing"
        complaints = [one for one in self.complaints if not (self.daemon_may_be_away and AWAY in one)]
        assert complaints == [], complaints


SHARERS = 3
"""What a busy computer takes away from this process it takes away from daemon and browser too, one after the other."""


def seconds_until(seen: Callable[[], bool], page: Page, limit_s: float = 60.0) -> float:
    """Return how long it takes until something is seen, without what a busy computer took away from daemon, test and browser."""
    begun = time.monotonic()
    with watched() as standstill:
        while not seen():
            assert time.monotonic() - begun < limit_s, f"not seen within {limit_s} s"
            page.wait_for_timeout(20)
    return time.monotonic() - begun - SHARERS * standstill.total_s


def violations(page: Page) -> list[str]:
    """Return what axe-core finds wrong (WCAG 2.1 AA: contrast, labels, roles), one line a node."""
    page.evaluate(AXE.read_text(encoding="utf-8"))
    tags = ["wcag2a", "wcag2aa", "wcag21a", "wcag21aa", "best-practice"]
    found = page.evaluate("tags => axe.run(document, { runOnly: tags })", tags)
    return [f"{one['id']}: {node['html'][:120]} {node['failureSummary']}" for one in found["violations"] for node in one["nodes"]]
