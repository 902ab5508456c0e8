"""Old data look old within a second, the page comes back by itself, and nobody who looks on disturbs the daemon."""

import socket
import time
from pathlib import Path

import pytest
from playwright.sync_api import Page, expect

from testkit.browser import Watched, seconds_until
from testkit.played import Served, served

pytestmark = pytest.mark.page


@pytest.mark.parametrize(("link", "place"), [("laser", ".figures"), ("plc", ".air")])
def test_a_silent_link_is_old_within_a_second(page: Page, daemon: Served, link: str, place: str) -> None:
    """Laser unplugged, PLC silent: what came from it is struck through within a second, the other stays."""
    old = page.locator(f"{place}.stale")
    assert old.count() == 0
    daemon.do(lambda: daemon.survey.silent.add(link))
    assert seconds_until(lambda: old.count() == 1, page) < 1.0
    assert page.locator("[data-source].stale").count() == page.locator(f"[data-source={link}]").count()
    daemon.do(daemon.survey.silent.clear)
    assert seconds_until(lambda: old.count() == 0, page) < 1.0


def test_a_dead_daemon_is_seen_and_its_return_too(watched: Watched, tmp_path: Path) -> None:
    """Daemon gone: everything is old within a second; back on the same address: live again within three, without a hand."""
    watched.daemon_may_be_away = True
    with served(tmp_path) as first:
        address = first.address
        page = watched.open(address)
    offline = page.locator("#offline")
    assert seconds_until(offline.is_visible, page) < 1.0
    assert page.locator("[data-source].stale").count() == page.locator("[data-source]").count()
    with served(tmp_path, port=int(address.rpartition(":")[2])) as second:
        second.do(lambda: second.survey.publish(reading_mm=77.0))
        assert seconds_until(lambda: not offline.is_visible(), page) < 3.0
        expect(page.locator("#reading")).to_have_text("77.00000")


def test_a_hanging_daemon_is_seen(page: Page, daemon: Served) -> None:
    """A daemon whose loop stands still says nothing, and the page says so within a second."""
    daemon.start(lambda: time.sleep(2.5))
    offline = page.locator("#offline")
    assert seconds_until(offline.is_visible, page) < 1.1
    assert seconds_until(lambda: not offline.is_visible(), page) < 3.0


def test_twenty_readers_and_one_that_never_reads(watched: Watched, daemon: Served) -> None:
    """The daemon's loop stays punctual, one encoding serves all, and the last reader gets the latest all the same."""
    asking = b"GET /stream HTTP/1.1\r\nHost: page\r\n\r\n"
    deaf = socket.create_connection(("127.0.0.1", int(daemon.address.rpartition(":")[2])))
    deaf.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 2048)
    deaf.sendall(asking)
    readers = [socket.create_connection(deaf.getpeername()) for _ in range(18)]
    for reader in readers:
        reader.sendall(asking)
    page = watched.open(daemon.address)
    for stop in range(31):
        daemon.do(lambda stop=stop: daemon.survey.stop("npp", 1, stop))
    before = daemon.do(lambda: daemon.survey.snapshots_taken)
    lateness = daemon.lateness(2.0)
    taken = daemon.do(lambda: daemon.survey.snapshots_taken) - before
    daemon.do(lambda: daemon.survey.publish(reading_mm=123.0))
    expect(page.locator("#reading")).to_have_text("123.00000")
    for one in (deaf, *readers):
        one.close()
    assert sorted(lateness)[int(0.95 * len(lateness))] < 0.02
    assert taken <= 25
