"""What a person sees in a real browser while a survey is played."""

import subprocess
import zipfile
from pathlib import Path

import pytest
from playwright.sync_api import Page, expect

from stepdiag.base.messages import message
from stepdiag.daq.passes.pass_book import PassBook
from stepdiag.daq.records.status import FindingStatus, LinkStatus
from stepdiag.daq.service.finding_list import finding_list
from stepdiag.daq.survey.file import parse_survey
from testkit.played import COUNTS_LOST, Served
from testkit.timeline import survey_text

pytestmark = pytest.mark.page

HOSTILE = '<img src=x onerror="document.title=1"><b>bold</b>'


def test_it_says_what_to_do_next(page: Page) -> None:
    """Before a pass: which way to turn the laser, what to align, which program to start."""
    expect(page.locator("#lead")).to_have_text("Align, then start program O8002")
    expect(page.locator("#advice")).to_have_text(
        "Point the laser along diagonal X+Y−Z− to X−Y+Z+ (npp), align the mirror, then "
        "start program O8002."
    )


def test_a_survey_is_watched_to_its_end(page: Page, daemon: Served) -> None:
    """Stops, deviations with the return pass, progress, then the result with its nine functions and
    its files."""
    for stop in range(31):
        daemon.do(lambda stop=stop: daemon.survey.stop("npp", 1, stop))
    for stop in range(11):
        daemon.do(lambda stop=stop: daemon.survey.stop("npp", 2, stop))
    expect(page.locator("#lead")).to_have_text("To stop 12 of 31, back")
    expect(page.locator("#advice")).to_have_text(
        "The machine drives diagonal X+Y−Z− to X−Y+Z+ (npp), pass 2: Y moves. Keep the beam "
        "free."
    )
    expect(page.locator("#progress-words")).to_have_text("104 / 310")
    expect(page.locator("#volume .stop")).to_have_count(42)
    expect(page.locator("#deviations")).to_have_attribute("data-points", "[31,11]")
    expect(page.locator("#tilt-drive")).to_contain_text("0.33 mrad (0.31 / −0.12)")
    expect(page.locator("#time-left")).to_have_text("about 10 min")
    daemon.do(daemon.survey.complete)
    expect(page.locator("#lead")).to_have_text("Done: all passes are complete")
    expect(page.locator("#advice")).to_contain_text(
        "Next step: Make the sign test on siemens"
    )
    expect(page.locator("#conclusion .reached li").last).to_contain_text(
        "1.3 to 2.6 µm (rms, k = 2)"
    )
    expect(page.locator("#conclusion .load")).to_contain_text(
        "siemens: load nothing before the sign test of EEC."
    )
    expect(page.locator("#field figure")).to_have_count(2)
    expect(page.locator("#result figure")).to_have_count(9)
    expect(page.locator("#result")).to_contain_text("20.0 ± 0.8 µrad")
    expect(page.locator("#result")).to_contain_text("not identified")
    expect(page.locator("#bundles a")).to_have_text(
        [
            "Open the report",
            "All files for siemens (zip)",
            "Restore the earlier state of siemens (zip)",
        ]
    )
    expect(page.locator("#bundles .steps li").first).to_contain_text("Make the sign test")
    expect(page.locator("#downloads a")).to_contain_text(
        ["result.json", "conclusion.json", "Open the report"]
    )


def test_a_proof_run_ends_with_its_verdict_alone(page: Page, daemon: Served) -> None:
    """A diagonal and a line state nothing about the machine's errors: no empty panel stands
    there."""
    words = [{"en": "Proof run: keep them.", "de": "Nachweis: behalten."}]
    page.route("**/conclusion.json", lambda route: route.fulfill(json={"next_step": words}))
    daemon.do(daemon.survey.complete)
    expect(page.locator("#advice")).to_have_text("Next step: Proof run: keep them.")
    for name in ("conclusion", "field", "result"):
        expect(page.locator(f"#{name}")).to_be_hidden()
    expect(page.locator("#bundles")).to_be_visible()


def test_a_control_gets_one_bundle_whose_sums_hold(
    page: Page, daemon: Served, tmp_path: Path
) -> None:
    """Clicked, saved, unpacked and checked as by hand: the export's own files under their own
    names, those that restore apart."""
    daemon.do(daemon.survey.complete)
    expect(page.locator("#bundles .steps li").first).to_contain_text("Make the sign test")
    held = {}
    for name in ("All files for siemens (zip)", "Restore the earlier state of siemens (zip)"):
        with page.expect_download() as handed:
            page.locator("#bundles a", has_text=name).click()
        place = tmp_path / handed.value.suggested_filename.removesuffix(".zip")
        with zipfile.ZipFile(handed.value.path()) as packed:
            packed.extractall(place)
        checked = subprocess.run(
            ["sha256sum", "--strict", "-c", "SHA256SUMS"],
            cwd=place,
            capture_output=True,
            text=True,
            check=False,
        )
        assert checked.returncode == 0, checked.stdout + checked.stderr
        held[name] = {
            path.name: path.read_bytes()
            for path in place.iterdir()
            if path.name != "SHA256SUMS"
        }
        assert sorted(held[name]) == sorted(
            line.removesuffix(": OK") for line in checked.stdout.splitlines()
        )
    load, restore = held.values()
    assert load
    assert restore
    assert {"_RESTORE" in name for name in load} == {False}
    assert {"_RESTORE" in name for name in restore} == {True}
    written = daemon.survey.place / "exports" / "siemens"
    assert load | restore == {
        path.name: path.read_bytes()
        for path in written.iterdir()
        if path.name != "SHA256SUMS"
    }


def test_findings_appear_in_words(page: Page, daemon: Served) -> None:
    """A finding is shown as it arises, with its code; markup in it stays text."""
    findings = (
        FindingStatus(
            code="mirror-misaligned", severity="warning", text=f"npp: 2.4 mrad {HOSTILE}"
        ),
    )
    daemon.do(
        lambda: daemon.survey.publish(
            findings=findings, machine="VM 500", survey=HOSTILE, message=HOSTILE
        )
    )
    expect(page.locator("#findings li")).to_contain_text(HOSTILE)
    expect(page.locator("#survey-name")).to_have_text(HOSTILE)
    assert page.locator("main img, main b").count() == 0


def test_findings_of_one_cause_stand_together_with_their_stops(
    page: Page, daemon: Served
) -> None:
    """Eight stops without a count are one finding, the newest cause first; what does not fit is
    behind "all"."""
    older = [
        FindingStatus(code=f"older-{number}", severity="warning", text="something")
        for number in range(6)
    ]
    daemon.do(lambda: daemon.survey.publish(findings=(*older, *COUNTS_LOST)))
    items = page.locator("#findings li")
    expect(items).to_have_count(3)
    expect(items.first).to_contain_text(
        "diagonal X+Y−Z− to X−Y+Z+ (npp) out, stops 6–13: the count was lost. ×8"
    )
    assert items.first.evaluate("one => getComputedStyle(one).textDecorationLine") == "none"
    page.locator("#all-findings").click()
    expect(page.locator("#all-list li")).to_have_count(7)


@pytest.mark.parametrize(
    ("tilt", "grade"),
    [((0.3, 0.2), "good"), ((1.2, 0.3), "fair"), ((1.9, 1.1), "bad"), (None, "none")],
)
def test_the_tilt_gives_advice_during_the_pass(
    page: Page, daemon: Served, tilt: tuple[float, float] | None, grade: str
) -> None:
    """Over 2 mrad: realign now, not after the pass (theory.md 6.5)."""
    daemon.do(lambda: daemon.survey.publish(tilt_mrad=tilt, tilt_setup="npp", tilt_live=True))
    expect(page.locator("#tilt-advice")).to_have_class(f"note {grade}")


def test_a_head_has_its_own_light(page: Page, daemon: Served) -> None:
    """The 4-DOF head is listed only where one is configured."""
    expect(page.locator("#links li")).to_have_count(2)
    head = LinkStatus(state="lost", address="/dev/ttyUSB1", age_s=12.0)
    daemon.do(lambda: daemon.survey.publish(head=head))
    expect(page.locator("#links li").nth(2)).to_contain_text("4-DOF head lost, old: 12")


def test_both_languages(page: Page, daemon: Served) -> None:
    """One press, and everything speaks German, numbers too; it stays so after a reload."""
    page.locator("#language").click()
    expect(page.locator("#lead")).to_have_text("Justieren, dann Programm O8002 starten")
    expect(page.locator("#air")).to_have_text("20,41 °C")
    named = "/dev/ttyUSB1"
    settings = message(
        "port-settings", port=named, baud=115200, latency=message("low-latency")
    )
    daemon.do(
        lambda: daemon.survey.publish(
            head=LinkStatus(state="connected", address=named, age_s=0.1, detail=settings)
        )
    )
    expect(page.locator("#links li").nth(2).locator("small")).to_have_text(
        "/dev/ttyUSB1, 115200 Baud, kurze Latenz"
    )
    assert page.locator("html").get_attribute("lang") == "de"
    page.reload()
    expect(page.locator("#lead")).to_have_text("Justieren, dann Programm O8002 starten")


def test_a_clock_that_was_never_set_is_shown(page: Page, daemon: Served) -> None:
    """Before the first stop, in both languages, with what to do; no other finding is needed for it
    to be seen."""
    findings = finding_list(PassBook(parse_survey(survey_text(), "survey.toml")), (), 0.0)
    daemon.do(lambda: daemon.survey.publish(findings=findings))
    shown = page.locator("#all-list li")
    expect(shown).to_have_count(1)
    expect(shown).to_contain_text("1970-01-01")
    expect(shown).to_contain_text("enter the time of the first stop")
    page.locator("#language").click()
    expect(shown).to_contain_text("die Uhr des Rechners wurde nie gestellt")
    expect(shown).to_contain_text("1970-01-01")
