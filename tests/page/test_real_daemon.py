"""The page over `stepdiag run` beside the virtual machine: real processes, real Modbus, a real
serial line, a real browser."""

import os
import signal
from pathlib import Path

import pytest
from playwright.sync_api import Browser, expect

from stepdiag.demo.files import siemens_profile
from stepdiag.virtual.base.reserved import reserved_port
from testkit.browser import Watched, lived_until
from testkit.running.hall import daemon, hall, until

pytestmark = pytest.mark.page
SIEMENS = """
[[export]]
controller = "siemens"
profile = "siemens.toml"
"""


@pytest.fixture
def real(browser: Browser):
    """Opens the pages of a machine called ``virtual``; complaints fail the test."""
    watching = Watched(browser, machine="virtual")
    yield watching
    watching.close()


def fault(place, kind: str, duration_s: float) -> None:
    """Let something go wrong at the virtual machine for a while."""
    place.bench.say(f'fault {{"kind": "{kind}", "duration_s": {duration_s}}}')


def test_a_whole_survey_is_watched_to_its_end(tmp_path: Path, real: Watched) -> None:
    """Out and back: what to do first, stops as they come, the result, and in both languages why its
    export was refused."""
    port = reserved_port()
    other_machine = siemens_profile()
    (tmp_path / "siemens.toml").write_text(other_machine, encoding="utf-8")
    how = {
        "n": 1,
        "back": True,
        "handshake": True,
        "dwell": 0.5,
        "page": True,
        "page_port": port,
        "exports": SIEMENS,
    }
    with hall(tmp_path, **how) as place, daemon(place.survey) as process:
        page = real.open(f"http://127.0.0.1:{port}")
        expect(page.locator("#advice")).to_contain_text(
            "Point the laser along diagonal X−Y−Z− to X+Y+Z+ (ppp)"
        )
        expect(page.locator("#setups li")).to_have_count(4)
        expect(page.locator("#reading")).not_to_have_text("–")
        place.start_setups(stop_after=1)
        expect(page.locator("#lead")).to_contain_text("stop", timeout=60_000)
        expect(page.locator("#volume .stop").first).to_be_attached(timeout=60_000)
        place.setups = place.setups[1:]
        place.start_setups()
        assert until(process, "survey-complete")[-1]["exit_code"] == 0
        expect(page.locator("#result figure")).to_have_count(9, timeout=60_000)
        expect(page.locator("#result")).to_contain_text("C0Y")
        expect(page.locator("#conclusion .reached")).to_contain_text("As found")
        expect(page.locator("#conclusion .reached")).to_contain_text("No file may be loaded")
        expect(page.locator("#conclusion .load")).to_contain_text(
            "siemens: load nothing, because the export was refused: siemens.toml: "
            "machine.name"
        )
        expect(page.locator("#advice")).to_have_text(
            "Next step: Remove the cause of the refused export (siemens), then export again."
        )
        expect(page.locator("#bundles a")).to_have_count(1)
        page.locator("#language").click()
        expect(page.locator("#conclusion .load")).to_contain_text(
            "siemens: nichts laden, weil der Export abgelehnt wurde: siemens.toml: machine.name"
        )
        expect(page.locator("#conclusion .load")).to_contain_text("erwartet war")
        expect(page.locator("#advice")).to_have_text(
            "Nächster Schritt: Die Ursache des abgelehnten Exports (siemens) beheben, dann "
            "neu exportieren."
        )
        page.context.close()  # before the daemon ends, which the page would complain about


def test_the_page_asks_what_is_active_before_the_first_pass(
    tmp_path: Path, real: Watched
) -> None:
    """A survey that does not say whether a compensation is on says so on the page, in both
    languages, before anything is driven."""
    port = reserved_port()
    with hall(tmp_path, page=True, page_port=port, machine="") as place, daemon(place.survey):
        page = real.open(f"http://127.0.0.1:{port}")
        expect(page.locator("#findings")).to_contain_text(
            "does not state whether a compensation is active in the control", timeout=60_000
        )
        expect(page.locator("#findings")).to_contain_text("machine.compensation")
        expect(page.locator("#setups li")).to_have_count(4)
        page.locator("#language").click()
        expect(page.locator("#findings")).to_contain_text(
            "die Vermessungsdatei gibt nicht an, ob in der Steuerung eine Kompensation aktiv ist"
        )
        page.context.close()  # before the daemon ends, which the page would complain about


@pytest.mark.parametrize(("kind", "link"), [("laser-unplug", "laser"), ("plc-silent", "plc")])
def test_a_cable_that_is_pulled_is_seen_within_a_second(
    tmp_path: Path, real: Watched, kind: str, link: str
) -> None:
    """What came over it is old within a second of its last word, and young again by itself."""
    port = reserved_port()
    with hall(tmp_path, page=True, page_port=port) as place, daemon(place.survey):
        page = real.open(f"http://127.0.0.1:{port}")
        expect(page.locator(f"[data-link={link}]")).to_have_class("chip good")
        assert (
            lived_until(
                page,
                f"document.querySelector('[data-source={link}].stale') !== null",
                lambda: fault(place, kind, 3.0),
            )
            < 1.2
        )
        expect(page.locator(f"[data-source={link}].stale")).to_have_count(0)
        page.context.close()  # before the daemon ends, which the page would complain about


def test_a_killed_daemon_comes_back_to_the_page(tmp_path: Path, real: Watched) -> None:
    """kill -9: old within a second; once the daemon serves again the page is live within three, and
    shows the same survey."""
    port = reserved_port()
    real.daemon_may_be_away = True
    with hall(tmp_path, page=True, page_port=port) as place:
        with daemon(place.survey) as process:
            page = real.open(f"http://127.0.0.1:{port}")
            offline = "!document.getElementById('offline').hidden"
            assert (
                lived_until(
                    page, offline, lambda: os.kill(process.process.pid, signal.SIGKILL)
                )
                < 1.0
            )
            process.process.wait()
        with daemon(place.survey):
            expect(page.locator("#offline")).to_be_hidden()
            expect(page.locator("#lead")).to_contain_text(
                "Set up diagonal X−Y−Z− to X+Y+Z+ (ppp)"
            )
