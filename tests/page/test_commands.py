"""Who may command, what a refusal says, and what a browser is allowed to do with the page."""

import http.client
import json
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any
from urllib.parse import quote

import pytest
from playwright.sync_api import Page, expect

from stepdiag.base.errors import UsageError
from stepdiag.base.messages import Place, message
from stepdiag.daq.records.status import AheadStatus, FindingStatus
from testkit.browser import Watched
from testkit.played import Served, served

pytestmark = pytest.mark.page
TOKEN = "a token of the tests: äöü ☃"


@pytest.fixture(scope="module")
def serving(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Served]:
    """A page over a played survey, with commands allowed."""
    with served(tmp_path_factory.mktemp("survey"), token=TOKEN) as running:
        yield running


def ask(
    daemon: Served, method: str, path: str, body: bytes = b"", token: str | None = None
) -> tuple[int, dict[str, str], bytes]:
    """Return status, headers and body of one request."""
    connection = http.client.HTTPConnection(
        daemon.address.removeprefix("http://"), timeout=60
    )
    headers = {"Origin": daemon.address} | (
        {"Authorization": f"Bearer {quote(token)}"} if token is not None else {}
    )
    connection.request(method, path, body, headers)
    answer = connection.getresponse()
    told = (
        answer.status,
        {name.lower(): value for name, value in answer.getheaders()},
        answer.read(),
    )
    connection.close()
    return told


def unlock(page: Page) -> None:
    page.locator("#token").fill(TOKEN)
    page.locator("#unlock button").click()
    expect(page.locator("#orders")).to_be_visible()


def test_a_changed_survey_file_is_shown_and_applied(page: Page, daemon: Served) -> None:
    """The lines that differ stand on the page for everybody; a person with the token applies them,
    but not while a pass runs."""
    daemon.do(
        lambda: daemon.survey.publish(
            phase="waiting-program", recording=False, corrects=("laser.sign: 1 -> -1",)
        )
    )
    expect(page.locator("#correction")).to_contain_text(
        "The survey file was changed: laser.sign: 1 -> -1."
    )
    unlock(page)
    daemon.do(lambda: daemon.survey.publish(recording=True))
    expect(page.locator("#correct")).to_be_hidden()
    daemon.do(lambda: daemon.survey.publish(recording=False, operator="A. Machinist"))
    expect(page.locator("#operator")).to_have_value("A. Machinist")
    page.locator("#correct").click()
    expect(page.locator("#answer")).to_have_text("Done.")
    assert daemon.do(lambda: list(daemon.survey.ordered)) == [
        ("correct", {"name": "A. Machinist"})
    ]
    daemon.do(lambda: daemon.survey.publish(corrects=()))
    expect(page.locator("#correct")).to_be_hidden()
    expect(page.locator("#correction")).to_be_empty()


def test_a_further_setup_is_offered_between_two_passes_and_taken(
    page: Page, daemon: Served
) -> None:
    """What it brings stands in the card, in the viewer's language; a person with the token may take
    it, but none while a pass runs."""
    line = message(
        "ahead-shifted",
        setup="ppp",
        offset=[message("ahead-offset", size_mm=150.0, axis="z")],
    )
    words = message("ahead-next", line=line, now_um=2.2, then_um=0.9, minutes=33.0)
    offer = AheadStatus(
        words=message("ahead-angles", angles_urad=30.0, what=words),
        setup="ppp+1",
        further=True,
    )
    daemon.do(
        lambda: daemon.survey.publish(phase="waiting-program", recording=False, ahead=offer)
    )
    expect(page.locator("#ahead")).to_have_text(
        "The angular errors are about 30 µrad. The largest gain comes from diagonal X−Y−Z− to "
        "X+Y+Z+ (ppp) on a line shifted by 150 mm in z: the error decreases from 2.2 to "
        "0.9 µm, in 33 min."
    )
    page.locator("#language").click()
    expect(page.locator("#ahead")).to_contain_text(
        "verschoben um 150 mm in z: die Abweichung sinkt von 2,2 auf 0,9 µm"
    )
    page.locator("#language").click()
    unlock(page)
    daemon.do(lambda: daemon.survey.publish(recording=True))
    expect(page.locator("#take")).to_be_hidden()
    daemon.do(lambda: daemon.survey.publish(recording=False))
    page.locator("#take").click()
    expect(page.locator("#answer")).to_have_text("Done.")
    assert daemon.do(lambda: list(daemon.survey.ordered)) == [("take", {})]
    daemon.do(lambda: daemon.survey.publish(ahead=AheadStatus()))
    expect(page.locator("#take")).to_be_hidden()
    expect(page.locator("#ahead")).to_be_empty()


def test_every_command_reaches_the_daemon(page: Page, daemon: Served) -> None:
    """Start, pause, zero, abort (pressed twice), write the certificate, choose the next setup, name
    operator and workpiece."""
    unlock(page)
    answer = page.locator("#answer")
    page.locator("#pause").click()
    expect(answer).to_have_text("Done.")
    daemon.do(lambda: daemon.survey.publish(phase="paused"))
    page.locator("#start").click()
    expect(page.locator("#pause")).to_be_hidden()
    daemon.do(lambda: daemon.survey.publish(phase="waiting-program"))
    page.locator("#abort").click()
    expect(page.locator("#abort")).to_have_text(
        "Press again to abort diagonal X+Y−Z− to X−Y+Z+ (npp)"
    )
    page.locator("#abort").click()
    page.locator("#more").click()
    page.locator("#zero").click()
    expect(page.locator("#certificate")).to_be_disabled()
    daemon.do(lambda: daemon.survey.publish(phase="complete"))
    page.locator("#certificate").click()
    page.locator("#choose-setup").select_option("pnp")
    page.locator("#choose button").click()
    page.locator("#operator").fill("Night shift")
    page.locator("#workpiece").fill("none")
    page.locator("#name button").click()
    expect(page.locator("#people")).to_have_text("Night shift · none")
    assert daemon.do(lambda: list(daemon.survey.ordered)) == [
        ("pause", {}),
        ("start", {}),
        ("abort-setup", {}),
        ("zero", {}),
        ("certificate", {}),
        ("choose-setup", {"setup": "pnp"}),
        ("name", {"operator": "Night shift", "workpiece": "none"}),
    ]


def test_what_is_doubted_is_accepted_with_name_and_reason(page: Page, daemon: Served) -> None:
    """Where it is the only finding, too: all findings stand on the page then, and what accepts it
    is behind "all"."""
    found = FindingStatus(
        code="stop-recovered",
        severity="warning",
        text="npp out, stop 5 of 30: ...",
        place="npp/1/5",
        at=Place(setup="npp", way="out", pass_number=1, stop=5, last=30),
        state="open",
    )
    unlock(page)
    daemon.do(lambda: daemon.survey.publish(findings=(found,)))
    page.locator("#all-findings").click()
    here = "diagonal X+Y−Z− to X−Y+Z+ (npp), pass 1 out, stop 6"
    expect(page.locator("#all-list button.accept")).to_have_text(f"Accept {here} …")
    page.locator("#all-list button.accept").click()
    expect(page.locator("#accept-place")).to_have_value(here)
    page.locator("#accept-name").fill("Kim")
    page.locator("#accept-reason").fill("a hand on the cable")
    page.locator("#accept button").click()
    expect(page.locator("#answer")).to_have_text("Done.")
    assert daemon.do(lambda: list(daemon.survey.ordered)) == [
        ("accept", {"place": "npp/1/5", "name": "Kim", "reason": "a hand on the cable"})
    ]


def test_a_refusal_says_why(watched: Watched, daemon: Served) -> None:
    """What the daemon cannot do now is told in its words."""
    page = watched.open(daemon.address)
    unlock(page)
    refusal = UsageError(
        "start", expected=message("closed-paused"), found=message("found-running")
    )
    daemon.do(lambda: setattr(daemon.survey, "refusal", refusal))
    daemon.do(lambda: daemon.survey.publish(phase="paused"))
    page.locator("#start").click()
    expect(page.locator("#answer")).to_have_text(
        "Refused: start: expected paused by the operator, found a daemon that runs"
    )
    page.locator("#language").click()
    page.locator("#start").click()
    expect(page.locator("#answer")).to_have_text(
        "Abgelehnt: start: erwartet war vom Bediener angehalten, gefunden ein Dienst, der läuft"
    )
    watched.complaints = [one for one in watched.complaints if "409" not in one]


def test_the_conclusion_is_words_and_open_to_everybody(
    watched: Watched, daemon: Served
) -> None:
    """The card says "read the conclusion": there it is, without the token. Curves and files stay
    locked."""
    daemon.do(daemon.survey.complete)
    page = watched.open(daemon.address)
    expect(page.locator("#conclusion .reached li").last).to_contain_text("(rms, k = 2)")
    expect(page.locator("#advice")).to_contain_text("Next step")
    expect(page.locator("#result")).to_have_text("Curves and files require the token.")
    assert ask(daemon, "GET", "/conclusion.json")[0] == 200
    for path in ("/result.json", "/downloads.json", "/download/conclusion.json"):
        assert ask(daemon, "GET", path)[0] == 403, path
    unlock(page)
    expect(page.locator("#result table").first).to_be_visible()


def test_a_doubt_offers_no_button_to_whom_cannot_accept_it(
    watched: Watched, daemon: Served
) -> None:
    """The button appears with the token."""
    found = FindingStatus(
        code="stop-recovered",
        severity="warning",
        text="npp out, stop 5 of 30: ...",
        place="npp/1/5",
        state="open",
    )
    daemon.do(lambda: daemon.survey.publish(findings=(found,)))
    page = watched.open(daemon.address)
    expect(page.locator("#all-list li")).to_have_count(1)
    expect(page.locator("#all-list button.accept")).to_have_count(0)
    unlock(page)
    expect(page.locator("#all-list button.accept")).to_have_count(1)


def test_a_token_outlives_a_reload(watched: Watched, daemon: Served) -> None:
    """A page that is loaded again still gives orders; one whose token was changed meanwhile asks
    for the new one and keeps nothing."""
    page = watched.open(daemon.address)
    unlock(page)
    page.reload()
    expect(page.locator("#orders")).to_be_visible()
    expect(page.locator("#unlock")).to_be_hidden()
    page.locator("#pause").click()
    expect(page.locator("#answer")).to_have_text("Done.")
    page.evaluate("sessionStorage.setItem('token', 'the one of yesterday')")
    page.reload()
    expect(page.locator("#answer")).to_have_text("The token is wrong.")
    expect(page.locator("#unlock")).to_be_visible()
    assert page.evaluate("sessionStorage.getItem('token')") is None
    watched.complaints = [one for one in watched.complaints if "403" not in one]


def test_a_wrong_token_opens_nothing(watched: Watched, daemon: Served) -> None:
    """The orders stay hidden, and a request without the token does nothing."""
    page = watched.open(daemon.address)
    page.locator("#token").fill("guess")
    page.locator("#unlock button").click()
    expect(page.locator("#answer")).to_have_text("The token is wrong.")
    assert not page.locator("#orders").is_visible()
    watched.complaints = [one for one in watched.complaints if "403" not in one]
    body = json.dumps({"name": "start", "arguments": {}}).encode()
    wrong = (None, "", "guess", TOKEN + " ", TOKEN[:-1])
    with ThreadPoolExecutor(
        len(wrong)
    ) as guessing:  # each is answered later than the one before
        answers = guessing.map(
            lambda token: ask(daemon, "POST", "/command", body, token)[0], wrong
        )
        assert list(answers) == [403] * len(wrong)
    assert daemon.do(lambda: daemon.survey.ordered) == []


def test_without_a_token_configured_it_only_shows(tmp_path: Path, watched: Watched) -> None:
    """Not even an empty token commands."""
    with served(tmp_path) as daemon:
        page = watched.open(daemon.address)
        expect(page.locator("#read-only")).to_be_visible()
        assert not page.locator("#unlock, #orders").first.is_visible()
        page.context.close()  # before the daemon ends, which the page would complain about
        for token in (None, "", "x"):
            assert ask(daemon, "POST", "/command", b'{"name":"start"}', token)[0] == 403


@pytest.mark.parametrize(
    "body",
    [
        b"",
        b"{",
        b"[]",
        b'{"name":"reboot"}',
        b'{"name":"start","arguments":{"a":1}}',
        b'{"name":"start"}' + b" " * 5000,
        b"\xff",
    ],
)
def test_a_command_that_is_none_is_refused(daemon: Served, body: bytes) -> None:
    """Unknown names, wrong types, too much: 400 and nothing done."""
    status, _, told = ask(daemon, "POST", "/command", body, TOKEN)
    assert status == 400
    assert "valid commands: start" in json.loads(told)["error"]
    assert daemon.do(lambda: daemon.survey.ordered) == []


@pytest.mark.parametrize(
    "path",
    [
        "/download/..%2Fresult.json",
        "/download/%2Fetc%2Fpasswd",
        "/download/secret",
        "/static/../app.py",
        "/static/..%2f..%2fapp.py",
        "/texts/fr.json",
    ],
)
def test_only_what_is_listed_can_be_fetched(daemon: Served, path: str) -> None:
    """A name that is not in the list of downloads does not exist, whatever it points at."""
    (daemon.survey.place / "secret").write_text("secret")
    daemon.do(daemon.survey.complete)
    status, _, body = ask(daemon, "GET", path, token=TOKEN)
    assert status == 404
    assert b"secret" not in body.replace(b"no such file", b"")


def listed_by(daemon: Served) -> list[dict[str, Any]]:
    found: list[dict[str, Any]] = json.loads(
        ask(daemon, "GET", "/downloads.json", token=TOKEN)[2]
    )
    return found


def test_downloads_are_whole(daemon: Served) -> None:
    """The list says name, kind and size, and the file comes byte for byte."""
    assert listed_by(daemon) == []
    assert ask(daemon, "GET", "/result.json", token=TOKEN)[0] == 404
    daemon.do(daemon.survey.complete)
    listed = listed_by(daemon)
    assert [one["kind"] for one in listed if one["kind"] != "export"] == [
        "result",
        "result",
        "report",
        "bundle",
        "restore",
    ]
    status, headers, body = ask(daemon, "GET", "/download/result.json", token=TOKEN)
    assert (status, len(body)) == (200, listed[0]["size_bytes"])
    assert headers["content-disposition"].startswith("attachment")
    assert body == (daemon.survey.place / "result.json").read_bytes()


@pytest.mark.parametrize(
    "path", ["/", "/static/main.js", "/about.json", "/texts/de.json", "/nothing"]
)
def test_the_policy_allows_nothing_from_elsewhere(daemon: Served, path: str) -> None:
    """No inline script or style, no foreign address, no frame, on every answer."""
    headers = ask(daemon, "GET", path)[1]
    policy = headers["content-security-policy"]
    assert policy.startswith("default-src 'none'; script-src 'self'; style-src 'self'")
    assert "unsafe" not in policy
    assert headers["x-content-type-options"] == "nosniff"


def test_the_report_opens_in_a_sandbox(watched: Watched, daemon: Served) -> None:
    """It is shown beside the page, draws and turns, and can reach neither the daemon nor the page's
    storage."""
    daemon.do(daemon.survey.complete)
    page = watched.open(daemon.address)
    unlock(page)
    page.goto(f"{daemon.address}/download/report.html")
    expect(page.locator("h1")).to_have_text("Calibration report")
    expect(page.locator("svg.turning")).to_have_count(1)
    assert page.evaluate("origin") == "null"
    first = page.locator("svg.turning path").nth(40)
    before = first.get_attribute("d")
    page.locator("svg.turning").focus()
    page.keyboard.press("ArrowRight")
    assert first.get_attribute("d") != before


def test_a_taken_port_is_refused_by_name(daemon: Served, tmp_path: Path) -> None:
    """The daemon says which address is taken, and what to do."""
    with (
        pytest.raises(ConnectionError, match=r"page\.port"),
        served(tmp_path, port=int(daemon.address.rpartition(":")[2])),
    ):
        pass


def test_what_the_walls_leave_open_is_named_in_both_languages(page: Page) -> None:
    expect(page.locator("#open")).to_be_hidden()
    page.route(
        "**/about.json",
        lambda route: route.fulfill(
            json=route.fetch().json() | {"open": ["signals", "UDP and other sockets"]}
        ),
    )
    page.reload()
    expect(page.locator("#open")).to_have_text(
        "An attacker who controls the page can reach here: signals, UDP and other sockets."
    )
    page.locator("#language").click()
    expect(page.locator("#open")).to_have_text(
        "Ein Angreifer mit Kontrolle über die Seite erreicht hier: Signale, UDP und andere "
        "Sockets."
    )
    page.unroute("**/about.json")
