"""What a person sees in a real browser while a survey is played."""

import pytest
from playwright.sync_api import Page, expect

from stepdiag.daq.records.status import FindingStatus, LinkStatus
from testkit.browser import Watched, violations
from testkit.played import Served

pytestmark = pytest.mark.page

SIZES = {"phone": (390, 844), "tablet": (820, 1180), "wall": (1920, 1080)}
HOSTILE = '<img src=x onerror="document.title=1"><b>bold</b>'


def test_it_says_what_to_do_next(page: Page) -> None:
    """Before a pass: which way to turn the laser, what to align, which program to start."""
    expect(page.locator("#phase")).to_have_text("Waiting for the NC program of diagonal npp")
    expect(page.locator("#instruction")).to_have_text(
        "Turn the laser to diagonal npp (from X high, Y low, Z low), align the mirror, then start program O8002."
    )


def test_a_survey_is_watched_to_its_end(page: Page, daemon: Served) -> None:
    """Stops, deviations with the return pass, progress, then the result with its nine functions and its files."""
    for stop in range(31):
        daemon.do(lambda stop=stop: daemon.survey.stop("npp", 1, stop))
    for stop in range(11):
        daemon.do(lambda stop=stop: daemon.survey.stop("npp", 2, stop))
    expect(page.locator("#phase")).to_have_text("Waiting for the machine to reach stop 11 of 30, Y move")
    expect(page.locator("#progress-words")).to_have_text("104 / 310")
    expect(page.locator("#volume .stop")).to_have_count(42)
    expect(page.locator("#deviations .dot.s0")).to_have_count(31)
    expect(page.locator("#deviations .dot.s1")).to_have_count(11)
    expect(page.locator("#tilt")).to_have_text("0.33 mrad (0.31 / −0.12)")
    expect(page.locator("#time-left")).to_have_text("about 10 min")
    daemon.do(daemon.survey.complete)
    expect(page.locator("#phase")).to_have_text("The survey is complete")
    expect(page.locator("#result figure")).to_have_count(9)
    expect(page.locator("#result")).to_contain_text("20.0 ± 0.8 µrad")
    expect(page.locator("#result")).to_contain_text("not identified")
    expect(page.locator(".prediction")).to_contain_text("improvement factor (rms) 6.2")
    expect(page.locator("#downloads a")).to_have_text(["result.json", "report.html"])


def test_the_return_pass_meets_the_outward_pass_at_the_far_end(page: Page, daemon: Served) -> None:
    """The return pass counts from zero at the far end; laid over the outward pass it starts where that one ended."""
    for stop in range(31):
        daemon.do(lambda stop=stop: daemon.survey.stop("ppp", 1, stop))
    daemon.do(lambda: daemon.survey.stop("ppp", 2, 0))
    expect(page.locator("#deviations .dot.s1")).to_have_count(1)
    places = [
        page.locator(f"#deviations .dot.{kind}").last.evaluate("dot => [dot.getAttribute('cx'), dot.getAttribute('cy')]")
        for kind in ("s0", "s1")
    ]
    assert places[0] == places[1]


def test_findings_appear_in_words(page: Page, daemon: Served) -> None:
    """A finding is shown as it arises, with its code; markup in it stays text."""
    findings = (FindingStatus(code="mirror-tilt", severity="warning", text=f"npp: 2.4 mrad {HOSTILE}"),)
    daemon.do(lambda: daemon.survey.publish(findings=findings, machine="VM 500", survey=HOSTILE, message=HOSTILE))
    expect(page.locator("#findings li")).to_contain_text(HOSTILE)
    expect(page.locator("#survey-name")).to_have_text(HOSTILE)
    assert page.locator("main img, main b").count() == 0


def test_a_finding_said_again_is_counted(page: Page, daemon: Served) -> None:
    """The same words in every pass stand once, with their number; the latest finding stands first."""
    again = FindingStatus(code="laser-device", severity="info", text="laser: firmware 264")
    other = FindingStatus(code="stop-doubtful", severity="warning", text="npp, stop 3: unsteady")
    daemon.do(lambda: daemon.survey.publish(findings=(again, other, again, again)))
    items = page.locator("#findings li")
    expect(items).to_have_count(2)
    expect(items.first).to_contain_text("laser: firmware 264 ×3")


@pytest.mark.parametrize(
    ("fields", "words"),
    [
        ({"beam_lost": True, "phase": "waiting-stop"}, "The beam is lost: clear its path, or align the mirror again."),
        ({"phase": "dwelling"}, "Nothing: the machine drives and measures. Keep the beam free."),
        ({"phase": "paused"}, "Press start to go on."),
        ({"phase": "failed"}, "Read the findings; ask the service engineer."),
        (
            {"expects_setup": "linear-y", "program": ""},
            "Point the laser along Y, mount the retroreflector, then start program of setup linear-y.",
        ),
        ({"expects_setup": "fourdof-z", "program": "O9"}, "Set the 4-DOF head along Z, then start program O9."),
        (
            {"expects_setup": "ppp+1"},
            "Turn the laser to diagonal ppp+1 (from X low, Y low, Z low), align the mirror, then start program O8002.",
        ),
    ],
)
def test_the_next_step_follows_the_state(page: Page, daemon: Served, fields: dict[str, object], words: str) -> None:
    """What blocks the survey comes first, then the hand that the set-up needs."""
    daemon.do(lambda: daemon.survey.publish(**fields))
    expect(page.locator("#instruction")).to_have_text(words)


@pytest.mark.parametrize(("tilt", "grade"), [((0.3, 0.2), "good"), ((1.2, 0.3), "fair"), ((1.9, 1.1), "bad"), (None, "none")])
def test_the_tilt_gives_advice_during_the_pass(page: Page, daemon: Served, tilt: tuple[float, float] | None, grade: str) -> None:
    """Over 2 mrad: realign now, not after the pass (theory.md 6.5)."""
    daemon.do(lambda: daemon.survey.publish(tilt_mrad=tilt))
    expect(page.locator("#tilt-advice")).to_have_class(f"advice {grade}")


def test_a_head_has_its_own_light(page: Page, daemon: Served) -> None:
    """The 4-DOF head is listed only where one is configured."""
    expect(page.locator("#links li")).to_have_count(2)
    head = LinkStatus(state="lost", address="/dev/ttyUSB1", age_s=12.0)
    daemon.do(lambda: daemon.survey.publish(head=head))
    expect(page.locator("#links li").nth(2)).to_contain_text("4-DOF head lost, old: 12")


def test_both_languages(page: Page, daemon: Served) -> None:
    """One press, and everything speaks German, numbers too; it stays so after a reload."""
    page.locator("#language").click()
    expect(page.locator("#phase")).to_have_text("Warte auf das NC-Programm von Diagonale npp")
    expect(page.locator("#air")).to_have_text("20,41 °C")
    assert page.locator("html").get_attribute("lang") == "de"
    page.reload()
    expect(page.locator("#phase")).to_have_text("Warte auf das NC-Programm von Diagonale npp")


@pytest.mark.parametrize("size", SIZES)
@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_contrast_and_labels(watched: Watched, daemon: Served, size: str, scheme: str) -> None:
    """axe-core finds nothing, neither while all is live nor while all is old, and nothing is wider than the screen."""
    width, height = SIZES[size]
    page = watched.open(daemon.address, width=width, height=height, scheme=scheme)
    daemon.do(lambda: daemon.survey.stop("npp", 1, 12))
    daemon.do(daemon.survey.complete)
    expect(page.locator("#result figure")).to_have_count(9)
    assert violations(page) == []
    daemon.do(lambda: daemon.survey.silent.update({"laser", "plc"}))
    expect(page.locator(".big.stale")).to_be_visible()
    assert violations(page) == []
    assert page.evaluate("document.documentElement.scrollWidth") <= width


def test_the_smallest_phone_needs_no_sideways_scrolling(watched: Watched, daemon: Served) -> None:
    """320 px: the reading still fits in one line."""
    page = watched.open(daemon.address, width=320, height=568)
    daemon.do(lambda: daemon.survey.publish(reading_mm=-12345.67891))
    expect(page.locator("#reading")).to_have_text("−12345.67891")
    assert page.evaluate("document.documentElement.scrollWidth") <= 320


def test_fingers_find_the_buttons(watched: Watched, daemon: Served) -> None:
    """Every control a greasy finger presses is at least 44 px high."""
    page = watched.open(daemon.address, width=390, height=844)
    heights = page.locator("button:visible, input:visible, select:visible").evaluate_all("all => all.map(one => one.offsetHeight)")
    assert heights
    assert min(heights) >= 44


def test_the_volume_turns_by_keyboard(page: Page) -> None:
    """Tab reaches it, arrow keys turn it."""
    volume = page.locator("#volume")
    volume.focus()
    before = volume.locator("path").first.get_attribute("d")
    page.keyboard.press("ArrowLeft")
    expect(volume.locator("path").first).not_to_have_attribute("d", before or "")


def test_light_and_dark_follow_the_room_until_a_person_chooses(watched: Watched, daemon: Served) -> None:
    """The system's choice first; the button overrides it and is remembered."""
    page = watched.open(daemon.address, scheme="dark")
    paper = "getComputedStyle(document.body).backgroundColor"
    dark = page.evaluate(paper)
    page.locator("#theme").click()
    light = page.evaluate(paper)
    assert dark != light
    page.reload()
    expect(page.locator("#machine")).to_have_text("VM 500")
    assert page.evaluate(paper) == light
