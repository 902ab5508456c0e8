"""Which stage the page is at, and the one sentence that matters: rules on snapshots first, then
what a browser shows."""

import json
import re
import subprocess
import sys
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
import pytest
from playwright.sync_api import Browser, Page, expect

from stepdiag.base.messages import Place
from stepdiag.base.messages import message as say
from stepdiag.base.readings.runs import Plan, Run
from stepdiag.daq.records.status import (
    DriveStatus,
    FindingStatus,
    LinkStatus,
    SetupStatus,
    Snapshot,
)
from stepdiag.daq.service.geometry import geometry
from stepdiag.page.stage import Say, headline
from stepdiag.page.view import (
    FAST_FIELDS,
    SHAPED,
    SLOW_FIELDS,
    grouped,
    now_view,
    survey_view,
)
from stepdiag.texts import LANGUAGES, catalogue
from stepdiag.texts.patterns import sentences
from stepdiag.texts.texts import Language
from testkit.browser import Watched, violations
from testkit.exact.madeup import VOLUME
from testkit.played import COUNTS_LOST, PlayedSurvey, Served, served
from testkit.routes import make_route

GONE = LinkStatus(state="silent", address="x", age_s=9.0)


def snapshot(tmp_path: Path, **fields: Any) -> Snapshot:
    """Return a snapshot of the played survey with some fields changed."""
    return msgspec.structs.replace(PlayedSurvey(tmp_path).snapshot(), **fields)


def words(say: Say) -> str:
    """Return a sentence in English as the browser composes it, names of setups left as they are."""
    known = {
        name: ", ".join(map(words, value)) if isinstance(value, list) else value
        for name, value in say.values.items()
    }
    return catalogue("page", "en")[say.key].format(**known)


RUNNING: dict[str, Any] = {"phase": "waiting-stop", "expects_stop": 6, "moving_axis": "y"}


@pytest.mark.parametrize(
    ("fields", "stage", "alarm", "lead"),
    [
        ({"beam_lost": True, "beam": 0.0}, "set-up", False, "Set up npp"),
        ({"beam": 0.2}, "set-up", False, "Set up npp"),
        ({}, "align", False, "Align, then start program O8002"),
        (
            {"beam": None, "program": ""},
            "align",
            False,
            "Align, then start the program of npp",
        ),
        (RUNNING, "drive", False, "To stop 7 of 31, out"),
        ({**RUNNING, "phase": "dwelling"}, "drive", False, "Measuring stop 7 of 31, out"),
        ({**RUNNING, "beam_lost": True}, "trouble", True, "Beam lost"),
        (
            {**RUNNING, "counts_to": 5},
            "trouble",
            True,
            "Laser count lost: back to stop 6",
        ),
        (
            {**RUNNING, "counts_to": 5, "beam_lost": True},
            "trouble",
            True,
            "Beam lost: go back to stop 6 now",
        ),
        (
            {**RUNNING, "counts_to": 29, "beam_lost": True, "driven_out": True},
            "drive",
            False,
            "To stop 7 of 31, out",
        ),
        ({**RUNNING, "recording": False}, "trouble", True, "Nothing is being recorded!"),
        ({**RUNNING, "alarm": True}, "trouble", True, "Machine alarm"),
        ({**RUNNING, "laser": GONE, "plc": GONE}, "trouble", True, "The laser is silent"),
        ({"plc": GONE}, "trouble", True, "The PLC is silent"),
        ({"head": GONE}, "trouble", True, "The 4-DOF head is silent"),
        ({**RUNNING, "waits_in_vain": True}, "trouble", True, "The machine waits in vain"),
        ({"phase": "failed"}, "trouble", True, "The survey cannot go on"),
        ({"phase": "paused"}, "set-up", False, "Paused"),
        ({"phase": "solving"}, "done", False, "Computing the result"),
        ({"phase": "complete"}, "done", False, "Done: all passes are complete"),
        (
            {"phase": "complete", "proof": "info"},
            "done",
            False,
            "Proof run done: keep the tables",
        ),
        (
            {"phase": "complete", "proof": "warning"},
            "done",
            False,
            "Proof run done: no decision",
        ),
        (
            {"phase": "complete", "proof": "error"},
            "done",
            False,
            "Restore the control: a loaded table is wrong",
        ),
    ],
)
def test_what_blocks_the_survey_comes_first(
    tmp_path: Path, fields: dict[str, Any], stage: str, alarm: bool, lead: str
) -> None:
    """Every state has one stage and one sentence; an alarm is what a hand must see to at once."""
    found = headline(snapshot(tmp_path, **fields))
    assert (found.stage, found.alarm, words(found.lead)) == (stage, alarm, lead)
    assert words(found.advice)


@pytest.mark.parametrize(
    ("again_from", "lead"),
    [(4, "Repeat npp, pass 1 out, from stop 5"), (0, "Repeat npp, pass 1 out")],
)
def test_a_broken_pass_says_from_where_to_repeat(
    tmp_path: Path, again_from: int, lead: str
) -> None:
    """Once the pass is over, the card says what to repeat; nothing burns any more."""
    drives = (
        DriveStatus(
            setup="npp",
            pass_number=1,
            from_stop=again_from,
            stops=31 - again_from,
            again=True,
        ),
    )
    found = headline(snapshot(tmp_path, to_drive=drives))
    assert (found.stage, found.alarm, words(found.lead)) == ("trouble", False, lead)


def test_what_a_pass_lost_stays_on_the_card_while_the_next_one_runs(tmp_path: Path) -> None:
    """The mirror still stands: whoever reads of it when all is driven sets it up once more."""
    drives = (
        DriveStatus(setup="npp", pass_number=1, from_stop=26, stops=5, again=True),
        DriveStatus(setup="npp", pass_number=2, from_stop=6, stops=25),
        DriveStatus(setup="pnp", pass_number=1, stops=31),
    )
    found = headline(snapshot(tmp_path, **RUNNING, expects_pass=2, to_drive=drives))
    assert (found.stage, found.alarm, words(found.lead)) == (
        "trouble",
        False,
        "To stop 7 of 31, back",
    )
    assert (
        words(found.advice)
        == "The machine drives npp, pass 2: Y moves. Keep the beam free. Afterwards: "
        "Repeat npp, pass 1 out, from stop 27."
    )
    assert headline(snapshot(tmp_path, **RUNNING, to_drive=drives[1:])).stage == "drive"


@pytest.mark.parametrize("fields", [{"phase": "paused"}, {"expects_setup": ""}])
def test_the_card_asks_nobody_for_what_the_viewer_cannot_do(
    tmp_path: Path, fields: dict[str, Any]
) -> None:
    """Start and the choice of a setup are orders: without the token the card names neither."""
    view = now_view(snapshot(tmp_path, **fields))
    assert any(order in words(view["advice"]) for order in ("Press Start", "choose a setup"))
    assert not any(order in words(view["watching"]) for order in ("Press", "choose"))


@pytest.mark.parametrize("language", LANGUAGES)
def test_an_alarm_names_no_register(language: Language) -> None:
    """Whoever stands at the machine has no list of registers."""
    page = catalogue("page", language)
    shown = [
        words for key, words in page.items() if key.startswith(("alarm_", "do_", "phase_"))
    ]
    shown += [
        "".join(literal for literal, _ in pattern[language])
        for key, pattern in sentences().items()
        if key.startswith("handshake-waits") or key == "heartbeat-still"
    ]
    assert len(shown) > 40
    assert [
        words for words in shown if re.search("(?i)regist|stop_count|holding|coil", words)
    ] == []


def test_errors_stand_above_warnings_whatever_came_last() -> None:
    """Two hundred notes after it do not bury the one error; within a severity what is open stands
    first, then what is new."""
    rows = [
        ("lost", "error", "past"),
        ("old", "warning", "open"),
        ("new", "warning", "past"),
        ("newest", "warning", "past"),
        ("note", "info", "past"),
    ]
    findings = [
        FindingStatus(code=code, severity=severity, text="x", state=state)
        for code, severity, state in rows
    ]
    assert [entry["code"] for entry in grouped(findings)] == [
        "lost",
        "old",
        "newest",
        "new",
        "note",
    ]


@pytest.mark.parametrize(
    ("setup", "program", "advice"),
    [
        (
            "linear-y",
            "",
            (
                "Point the laser along Y, mount the retroreflector, then start the program of "
                "linear-y."
            ),
        ),
        ("fourdof-z", "O9", "Set the 4-DOF head along Z, then start program O9."),
        (
            "ppp+1",
            "O8002",
            ("Point the laser along ppp+1, align the mirror, then start program O8002."),
        ),
        (
            "npp",
            "O8002",
            ("Point the laser along npp, align the mirror, then start program O8002."),
        ),
    ],
)
def test_the_set_up_names_the_next_hand(
    tmp_path: Path, setup: str, program: str, advice: str
) -> None:
    """Which way the laser looks, what is mounted, which program is started."""
    assert (
        words(headline(snapshot(tmp_path, expects_setup=setup, program=program)).advice)
        == advice
    )


def test_every_field_of_a_snapshot_is_told_once() -> None:
    """The two events together hold the whole snapshot, but for what they tell in another form."""
    assert not set(FAST_FIELDS) & set(SLOW_FIELDS)
    assert set(FAST_FIELDS) | set(SLOW_FIELDS) | SHAPED == set(Snapshot.__struct_fields__)


@pytest.mark.parametrize("order", ["xyz", "zyx", "yxz"])
@pytest.mark.parametrize("outward", [True, False])
def test_the_route_drawn_is_the_route_driven(order: str, outward: bool) -> None:
    """Whatever order the axes move in, and on the way back: the page draws the recording's own
    route."""
    drawn = geometry(
        Plan(volume=VOLUME, runs=(Run(setup="npp"),), axis_order=order),
        (),
        "npp",
        1 if outward else 2,
    )
    assert [list(one) for one in drawn.route_mm] == make_route(
        VOLUME, "npp", order, outward=outward
    ).stops_mm.tolist()
    lengths = sorted(float(np.linalg.norm(np.subtract(*edge))) for edge in drawn.edges_mm)
    assert lengths == sorted([*VOLUME.size_mm] * 4)
    assert all(VOLUME.origin_mm in edge for edge in drawn.edges_mm[:3])


def test_the_page_knows_no_mathematics() -> None:
    """What runs with the fewest rights loads the least: no numpy in the page's process."""
    code = "import sys, stepdiag.page.process; sys.exit('numpy' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0


def test_what_the_daemon_says_goes_out_in_every_language(tmp_path: Path) -> None:
    """Reasons, link details and messages: no English inside a German page."""
    again = say("again-from-or-whole", stop=4)
    reason = say("pass-why", number=1, why=say("stops-missing", stops=[5, 6], again=again))
    setups = (
        SetupStatus(
            name="npp",
            passes_wanted=2,
            passes_done=0,
            stops_wanted=62,
            stops_done=9,
            state="again",
            reason=reason,
        ),
    )
    lost, at = (
        say("beam-lost", why=say("beam-was-lost")),
        Place(setup="npp", way="out", stop=5, last=30),
    )
    finding = FindingStatus(
        code="beam-lost", severity="error", text=str(lost), message=lost, at=at
    )
    refused = say(
        "refusal-with-code",
        refusal=say(
            "refusal", where="p.toml: axes.X.step_mm", expected="57.5 mm", found="60 mm"
        ),
        code="x",
    )
    now = snapshot(
        tmp_path,
        setups=setups,
        findings=(finding,),
        message=say("export-refused", control="siemens", why=refused),
    )
    view = {**survey_view(now), **now_view(now)}
    assert view["setups"][0]["reason"] == {
        "en": str(reason),
        "de": "Durchgang 1: Messpunkte 6–7 fehlen: den Durchgang ab Messpunkt 5 oder "
        "ganz wiederholen",
    }
    assert view["message"] == {
        "en": "the export for siemens was refused: p.toml: axes.X.step_mm: expected 57.5 mm, "
        "found 60 mm [x]",
        "de": "der Export für siemens wurde abgelehnt: p.toml: axes.X.step_mm: erwartet war "
        "57,5 mm, gefunden 60 mm [x]",
    }
    assert (
        view["findings"][0]["sentence"]["de"]
        == "Diagonale X+Y-Z- nach X-Y+Z+ (npp) hin, Messpunkt 6: Strahl verloren auf dem Weg zu "
        "diesem Messpunkt: "
        "die Zählung des Lasers ist hier nicht mit den früheren Messpunkten vergleichbar"
    )
    assert json.dumps(msgspec.to_builtins(view))


@dataclass(frozen=True, slots=True)
class Screens:
    """A played survey and the pages that look at it; ``pictures`` is where what they showed is
    kept."""

    daemon: Served
    pages: dict[str, Page]
    pictures: Path
    language: str


SIZES = {"phone": (390, 844), "tablet": (1024, 768), "wall": (1920, 1080)}


def set_up(daemon: Served) -> None:
    daemon.do(lambda: daemon.survey.publish(beam=0.1, beam_lost=True))


def align(daemon: Served) -> None:
    daemon.do(lambda: daemon.survey.publish(beam=None))


def drive(daemon: Served) -> None:
    for stop in range(31):
        daemon.do(lambda stop=stop: daemon.survey.stop("npp", 1, stop))


def trouble(daemon: Served) -> None:
    drive(daemon)
    daemon.do(
        lambda: daemon.survey.publish(counts_to=5, beam_lost=True, findings=COUNTS_LOST)
    )


def done(daemon: Served) -> None:
    daemon.do(daemon.survey.complete)


STAGES = {"set-up": set_up, "align": align, "drive": drive, "trouble": trouble, "done": done}
MATTERS = {
    "set-up": ["#lead", "#advice"],
    "align": ["#lead", "#advice", "#no-beam"],
    "drive": ["#lead", "#advice", "#progress", "#time-left"],
    "trouble": ["#lead", "#advice", "#findings li >> nth=0"],
    "done": ["#lead", "#advice", "#conclusion .reached"],
}


@pytest.fixture(scope="module", params=LANGUAGES)
def screens(
    request: pytest.FixtureRequest, browser: Browser, tmp_path_factory: pytest.TempPathFactory
) -> Iterator[Screens]:
    """One survey on a phone, a tablet and a wall, in one language."""
    folder = tmp_path_factory.mktemp(f"screens-{request.param}")
    watching = Watched(browser)
    with served(folder, language=request.param) as running:
        pages = {
            name: watching.open(running.address, width=width, height=height)
            for name, (width, height) in SIZES.items()
        }
        yield Screens(running, pages, folder.parent, request.param)
    watching.daemon_may_be_away = True
    watching.close()


@pytest.mark.page
@pytest.mark.parametrize("stage", STAGES)
def test_each_stage_on_each_screen(screens: Screens, stage: str) -> None:
    """What matters is seen without scrolling, nothing is too wide, axe finds nothing, nothing is
    loaded from outside; pictures are kept."""
    screens.daemon.do(screens.daemon.survey.begin_anew)
    STAGES[stage](screens.daemon)
    for name, page in screens.pages.items():
        expect(page.locator("body")).to_have_attribute("data-stage", stage)
        page.evaluate("scrollTo(0, 0)")
        for place in MATTERS[stage]:
            expect(page.locator(place)).to_be_in_viewport(ratio=0.99)
        assert page.evaluate("document.documentElement.scrollWidth") <= SIZES[name][0]
        page.screenshot(path=str(screens.pictures / f"{stage}-{screens.language}-{name}.png"))
    assert violations(screens.pages["tablet"]) == []


@pytest.mark.page
def test_a_wrong_table_stands_under_no_green_done(
    page: Page, daemon: Served, tmp_path: Path
) -> None:
    """Keep, not decided and restore each have their colour on the card; a picture is kept."""
    done(daemon)
    expect(page.locator("body")).to_have_attribute("data-stage", "done")
    colours = {}
    for proof in (None, "info", "warning", "error"):
        daemon.do(lambda proof=proof: daemon.survey.publish(proof=proof))
        expect(page.locator("body")).to_have_attribute("data-proof", proof or "")
        colours[proof] = page.locator(".lead").evaluate(
            "each => new Promise(done => requestAnimationFrame(() => requestAnimationFrame("
            "() => done(getComputedStyle(each).borderLeftColor))))"
        )
    page.screenshot(path=str(tmp_path.parent / "proof-restore.png"))
    expect(page.locator("#lead")).to_have_text("Restore the control: a loaded table is wrong")
    assert colours[None] == colours["info"]
    assert len(set(colours.values())) == 3


@pytest.mark.page
def test_an_alarm_takes_the_whole_page(page: Page, daemon: Served) -> None:
    """Title, frame, text and sound; it ends by itself when the beam is back."""
    drive(daemon)
    page.locator("#volume").scroll_into_view_if_needed()
    trouble(daemon)
    expect(page.locator("body.alarm")).to_be_attached()
    expect(page.locator("#lead")).to_be_in_viewport(ratio=0.99)
    expect(page.locator("#lead")).to_have_text("Beam lost: go back to stop 6 now")
    assert page.title().startswith("⚠ ALARM: Beam lost")
    page.locator("#sound").click()
    expect(page.locator("#sound")).to_have_text("Sound off")
    daemon.do(lambda: daemon.survey.publish(counts_to=None, beam_lost=False))
    expect(page.locator("body.alarm")).not_to_be_attached()


@pytest.mark.page
def test_an_instrument_without_beam_strength_says_so(page: Page, daemon: Served) -> None:
    """No empty bar: the aid shows the noise of the reading instead."""
    align(daemon)
    expect(page.locator("#no-beam")).to_be_visible()
    expect(page.locator("#beam-meter")).to_be_hidden()
    expect(page.locator("#h-trend")).to_contain_text("Noise of the reading")


@pytest.mark.page
def test_a_tilt_of_the_setup_before_is_past(page: Page, daemon: Served) -> None:
    """Between setups the mirror is moved: its old tilt is struck through and advises nothing."""
    daemon.do(
        lambda: daemon.survey.publish(tilt_mrad=(2.0, 2.0), tilt_setup="ppp", tilt_live=False)
    )
    expect(page.locator("#tilt.past")).to_contain_text("X+Y+Z+ (ppp)")
    expect(page.locator("#tilt-advice")).to_have_class("note none")
