"""What a person sees in a real browser while a survey is played."""

import contextlib
import re
import subprocess
import zipfile
from base64 import b64decode
from pathlib import Path

import numpy as np
import pytest
from msgspec.structs import replace
from playwright.sync_api import Error as PlaywrightError
from playwright.sync_api import Page, expect

from stepdiag.daq.records.status import FindingStatus, LinkStatus, StripStatus
from testkit.browser import Watched, violations
from testkit.played import Served
from testkit.running.slaves import wait_until

pytestmark = pytest.mark.page

SIZES = {"phone": (390, 844), "tablet": (820, 1180), "wall": (1920, 1080)}
WRITTEN_BELOW = """() => {
  const canvas = CanvasRenderingContext2D.prototype, write = canvas.fillText;
  window.below = [];
  canvas.fillText = function (text, ...rest) {
    const own = this.canvas.closest("#deviations") && this.textAlign === "center" && /^[0-9]/.test(text);
    if (own) window.below.push(text);
    return write.call(this, text, ...rest);
  };
}"""
"""Keeps from now on the figures that the chart of the deviations writes below its axis."""
HOSTILE = '<img src=x onerror="document.title=1"><b>bold</b>'


def test_it_says_what_to_do_next(page: Page) -> None:
    """Before a pass: which way to turn the laser, what to align, which program to start."""
    expect(page.locator("#lead")).to_have_text("Align, then start program O8002")
    expect(page.locator("#advice")).to_have_text(
        "Turn the laser to diagonal npp (from X high, Y low, Z low), align the mirror, then start program O8002."
    )


def test_a_survey_is_watched_to_its_end(page: Page, daemon: Served) -> None:
    """Stops, deviations with the return pass, progress, then the result with its nine functions and its files."""
    for stop in range(31):
        daemon.do(lambda stop=stop: daemon.survey.stop("npp", 1, stop))
    for stop in range(11):
        daemon.do(lambda stop=stop: daemon.survey.stop("npp", 2, stop))
    expect(page.locator("#lead")).to_have_text("To stop 11 of 30")
    expect(page.locator("#advice")).to_have_text("diagonal npp, pass 2: Y moves. Keep the beam free.")
    expect(page.locator("#progress-words")).to_have_text("104 / 310")
    expect(page.locator("#volume .stop")).to_have_count(42)
    expect(page.locator("#deviations")).to_have_attribute("data-points", "[31,11]")
    expect(page.locator("#tilt-drive")).to_contain_text("0.33 mrad (0.31 / −0.12)")
    expect(page.locator("#time-left")).to_have_text("about 10 min")
    daemon.do(daemon.survey.complete)
    expect(page.locator("#lead")).to_have_text("Done: all passes are in")
    expect(page.locator("#advice")).to_contain_text("Next step: Make the sign test on siemens")
    expect(page.locator("#conclusion .reached li").last).to_contain_text("1.3 to 2.6 µm (rms, k = 2)")
    expect(page.locator("#conclusion .load")).to_contain_text("siemens: nothing before its sign test (EEC).")
    expect(page.locator("#field figure")).to_have_count(2)
    expect(page.locator("#result figure")).to_have_count(9)
    expect(page.locator("#result")).to_contain_text("20.0 ± 0.8 µrad")
    expect(page.locator("#result")).to_contain_text("not identified")
    expect(page.locator("#bundles a")).to_have_text(["Open the report", "All files for siemens (zip)", "Restore siemens as it was (zip)"])
    expect(page.locator("#bundles .steps li").first).to_contain_text("Make the sign test")
    expect(page.locator("#downloads a")).to_contain_text(["result.json", "conclusion.json", "Open the report"])


def test_a_control_gets_one_bundle_whose_sums_hold(page: Page, daemon: Served, tmp_path: Path) -> None:
    """Clicked, saved, unpacked and checked as by hand: the export's own files under their own names, those that restore apart."""
    daemon.do(daemon.survey.complete)
    expect(page.locator("#bundles .steps li").first).to_contain_text("Make the sign test")
    held = {}
    for name in ("All files for siemens (zip)", "Restore siemens as it was (zip)"):
        with page.expect_download() as handed:
            page.locator("#bundles a", has_text=name).click()
        place = tmp_path / handed.value.suggested_filename.removesuffix(".zip")
        with zipfile.ZipFile(handed.value.path()) as packed:
            packed.extractall(place)
        checked = subprocess.run(["sha256sum", "--strict", "-c", "SHA256SUMS"], cwd=place, capture_output=True, text=True, check=False)
        assert checked.returncode == 0, checked.stdout + checked.stderr
        held[name] = {path.name: path.read_bytes() for path in place.iterdir() if path.name != "SHA256SUMS"}
        assert sorted(held[name]) == sorted(line.removesuffix(": OK") for line in checked.stdout.splitlines())
    load, restore = held.values()
    assert load
    assert restore
    assert {"_RESTORE" in name for name in load} == {False}
    assert {"_RESTORE" in name for name in restore} == {True}
    written = daemon.survey.place / "exports" / "siemens"
    assert load | restore == {path.name: path.read_bytes() for path in written.iterdir() if path.name != "SHA256SUMS"}


def values_at(page: Page, chart: str, *, key: str = "") -> list[str]:
    """Return what a chart says of the point under the pointer, or under the key pressed.

    A chart that is drawn anew meanwhile, in another language or unit, is asked once more.
    """
    over = page.locator(f"{chart} .u-over")
    for _ in range(20):
        with contextlib.suppress(PlaywrightError):
            page.locator(chart).scroll_into_view_if_needed()
            if key:
                over.press(key)
            else:
                over.hover()
            break
    return page.locator(f"{chart} .u-legend .u-series:not(.bound) .u-value").all_inner_texts()


def test_every_chart_says_its_values_under_pointer_and_key(page: Page, daemon: Served) -> None:
    """Deviations, the last ten seconds, noise, functions of the result: hover or arrow keys, figures as the language writes them."""
    page.locator("#language").click()
    for chart in ("#strip", "#trend"):
        expect(page.locator(f"{chart} canvas")).to_be_visible(timeout=60_000)
        wait_until(lambda chart=chart: all(re.fullmatch(r"[−\d,]+", value) for value in values_at(page, chart, key="End") or [""]))
    for stop in range(9):
        daemon.do(lambda stop=stop: daemon.survey.stop("npp", 1, stop))
    expect(page.locator("#deviations")).to_have_attribute("data-points", "[9]")
    assert values_at(page, "#deviations", key="Home") == ["0", "0,00"]
    assert values_at(page, "#deviations", key="ArrowRight") == ["1", "0,89"]
    assert len(values_at(page, "#deviations")) == 2
    daemon.do(daemon.survey.complete)
    expect(page.locator("#result figure")).to_have_count(9)
    for name in ("EXX", "EZZ"):
        by_key = values_at(page, f"#function-{name}", key="End")
        assert all(re.fullmatch(r"[−\d,]+", value) for value in by_key), by_key


def table_of(page: Page, figure: str) -> list[list[str]]:
    """Return the CSV that the link of a figure hands out, in rows."""
    with page.expect_download() as handed:
        page.locator(f"{figure} a.csv").click()
    return [line.split(",") for line in handed.value.path().read_text(encoding="utf-8").splitlines()]


def test_drawings_of_the_volume_say_their_values_and_every_figure_has_its_table(page: Page, daemon: Served) -> None:
    """Stops and errors by pointer and key, in the numbers of the language; what is drawn as CSV with decimal points in either."""
    for stop in range(9):
        daemon.do(lambda stop=stop: daemon.survey.stop("npp", 1, stop))
    volume, value = page.locator("#volume"), page.locator("#volume .value")
    expect(page.locator("#volume .stop")).to_have_count(9)
    volume.press("PageDown")
    volume.press("PageDown")
    expect(value).to_have_text("diagonal npp. Stop 1: 0.89 µm, X; Y; Z = 450; 0; −300 mm")
    volume.press("ArrowLeft")
    page.locator("#language").click()
    expect(value).to_have_text("Diagonale npp. Messpunkt 1: 0,89 µm, X; Y; Z = 450; 0; −300 mm")
    page.locator("#volume .stop").nth(8).hover()
    expect(value).to_contain_text("Messpunkt 8: 4,80 µm")
    page.mouse.move(0, 0)
    expect(value).to_have_text("")
    head, *rows = table_of(page, "#volume")
    assert head == ["setup", "pass", "stop", "x_mm", "y_mm", "z_mm", "deviation_um", "u_um", "doubtful"]
    assert (len(rows), rows[1][:6]) == (9, ["npp", "1", "1", "450", "0", "-300"])
    head, *rows = table_of(page, "#deviations")
    assert head == ["stop", "pass_1_um", "u_pass_1_um"]
    assert (len(rows), rows[0], rows[9]) == (31, ["0", "0", "0.3"], ["9", "", ""])
    assert [name.partition("_")[0] for name in table_of(page, "#strip")[0]] == ["time", "high", "low"], "in mm while the laser travels"
    daemon.do(daemon.survey.complete)
    expect(page.locator("#field figure a.csv")).to_have_count(2)
    expect(page.locator("#result figure a.csv")).to_have_count(9)
    report = (daemon.survey.place / "report.html").read_text(encoding="utf-8")
    for figure in ("#function-EXX", "#function-EZZ", "#field-before"):
        name = figure.removeprefix("#function-").removeprefix("#")
        written = re.search(rf'download="{name}.csv" href="data:text/csv;charset=utf-8;base64,([^"]+)"', report)
        assert written is not None
        shown, wanted = table_of(page, figure), [line.split(",") for line in b64decode(written[1]).decode().splitlines()]
        columns = slice(0, len(shown[0]))
        assert shown[0] == wanted[0][columns], "the columns of the report"
        assert np.allclose(np.array(shown[1:], dtype=float), np.array([row[columns] for row in wanted[1:]], dtype=float), atol=6e-5)
    before, value = page.locator("#field-before"), page.locator("#field-before .value")
    before.press("End")
    x, y, z, *vector = map(float, shown[-1])
    said = "; ".join(f"{part:.2f}" for part in vector) + f" µm, |E| = {np.linalg.norm(vector):.2f} µm"
    words = f"X; Y; Z = {x:.0f}; {y:.0f}; {z:.0f} mm: {said}".replace("-", "−").replace(".", ",")
    expect(value).to_have_text(words)
    for event in ("pointermove", "pointerleave"):
        before.dispatch_event(event, {"pointerType": "mouse"})
        expect(value, "what a browser sends when the drawing changes below a pointer that rests").to_have_text(words)


def test_the_last_ten_seconds_are_drawn_at_full_rate(page: Page, daemon: Served) -> None:
    """Fifty bins a second, each with its lowest and highest sample, whatever the pictures a second; a machine that moves has no scatter."""
    seen = "JSON.parse(document.getElementById('strip').dataset.points ?? '[0, 0]')"
    wait_until(lambda: page.evaluate(seen)[0] >= 400)
    assert page.evaluate(f"(([high, low]) => high === low)({seen})")
    expect(page.locator("#scatter")).to_contain_text(re.compile(r"half a second: 0\.\d\d µm"))
    moving = tuple(float(place) for place in range(75))
    daemon.do(lambda: daemon.survey.publish(strip=StripStatus(first=10**9, bin_s=0.02, low_mm=moving, high_mm=moving)))
    expect(page.locator("#scatter")).to_contain_text("half a second: – µm")


def test_marks_of_an_axis_are_written_with_the_decimals_they_need(page: Page) -> None:
    """Marks every 2.5 s were written 3, 5, 8."""
    marks = "[[-10, -7.5, -5], [0, 2], [0, 0.1], [0, 0.25], [400]]"
    assert page.evaluate(f"import('/static/curves.js').then((curves) => {marks}.map(curves.places))") == [1, 0, 1, 2, 0]


def test_a_chart_zooms_and_comes_back_by_key(page: Page, daemon: Served) -> None:
    """Dragging shows a part, whose marks are stops, Escape the whole; a new stop does not take the part away."""
    for stop in range(20):
        daemon.do(lambda stop=stop: daemon.survey.stop("npp", 1, stop))
    chart, over = page.locator("#deviations"), page.locator("#deviations .u-over")
    expect(chart).to_have_attribute("data-range", "[0,30]")
    over.scroll_into_view_if_needed()
    page.evaluate(WRITTEN_BELOW)
    box = over.bounding_box()
    assert box is not None
    page.mouse.move(box["x"] + 0.2 * box["width"], box["y"] + 20)
    page.mouse.down()
    page.mouse.move(box["x"] + 0.3 * box["width"], box["y"] + 20, steps=4)
    page.mouse.up()
    expect(chart).not_to_have_attribute("data-range", "[0,30]")
    marks = page.wait_for_function("() => window.below.length > 1 && window.below").json_value()
    assert [mark for mark in marks if not mark.isdigit()] == []
    part = chart.get_attribute("data-range")
    daemon.do(lambda: daemon.survey.stop("npp", 1, 20))
    expect(chart).to_have_attribute("data-points", "[21]")
    expect(chart).to_have_attribute("data-range", part or "")
    over.focus()
    page.keyboard.press("Escape")
    expect(chart).to_have_attribute("data-range", "[0,30]")


def test_a_doubtful_stop_differs_in_shape(page: Page, daemon: Served) -> None:
    """A cross among dots, in the volume and in the chart: colour alone tells a colour-blind person nothing. Doubted later it counts too."""
    for stop in range(5):
        daemon.do(lambda stop=stop: daemon.survey.stop("npp", 1, stop))
    expect(page.locator("#volume circle.stop")).to_have_count(5)
    doubted = [replace(one, doubtful="unsteady" if one.stop == 3 else "") for one in daemon.do(lambda: daemon.survey.fields["stops"])]
    daemon.do(lambda: daemon.survey.publish(stops=tuple(doubted)))
    expect(page.locator("#volume path.stop.doubt")).to_have_count(1)
    expect(page.locator("#volume circle.stop")).to_have_count(4)


def test_findings_appear_in_words(page: Page, daemon: Served) -> None:
    """A finding is shown as it arises, with its code; markup in it stays text."""
    findings = (FindingStatus(code="mirror-misaligned", severity="warning", text=f"npp: 2.4 mrad {HOSTILE}"),)
    daemon.do(lambda: daemon.survey.publish(findings=findings, machine="VM 500", survey=HOSTILE, message=HOSTILE))
    expect(page.locator("#findings li")).to_contain_text(HOSTILE)
    expect(page.locator("#survey-name")).to_have_text(HOSTILE)
    assert page.locator("main img, main b").count() == 0


def test_findings_of_one_cause_stand_together_with_their_stops(page: Page, daemon: Served) -> None:
    """Eight stops without a count are one finding, the newest cause first; what does not fit is behind "all"."""
    lost = [
        FindingStatus(code="beam-lost", severity="error", text=f"npp out, stop {stop} of 30: the count was lost") for stop in range(5, 13)
    ]
    older = [FindingStatus(code=f"older-{number}", severity="warning", text="something") for number in range(6)]
    daemon.do(lambda: daemon.survey.publish(findings=(*older, *lost)))
    items = page.locator("#findings li")
    expect(items).to_have_count(3)
    expect(items.first).to_contain_text("npp out, stops 5–12: the count was lost. ×8")
    assert items.first.evaluate("one => getComputedStyle(one).textDecorationLine") == "none"
    page.locator("#all-findings").click()
    expect(page.locator("#all-list li")).to_have_count(7)


@pytest.mark.parametrize(("tilt", "grade"), [((0.3, 0.2), "good"), ((1.2, 0.3), "fair"), ((1.9, 1.1), "bad"), (None, "none")])
def test_the_tilt_gives_advice_during_the_pass(page: Page, daemon: Served, tilt: tuple[float, float] | None, grade: str) -> None:
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
    named = "/dev/ttyUSB1, 115200 baud"
    daemon.do(lambda: daemon.survey.publish(head=LinkStatus(state="connected", address=named, age_s=0.1, detail=f"{named}, low latency")))
    expect(page.locator("#links li").nth(2).locator("small")).to_have_text("/dev/ttyUSB1, 115200 Baud, kurze Latenz")
    assert page.locator("html").get_attribute("lang") == "de"
    page.reload()
    expect(page.locator("#lead")).to_have_text("Justieren, dann Programm O8002 starten")


@pytest.mark.parametrize(("size", "scheme"), [("phone", "dark"), ("tablet", "light"), ("wall", "dark")])
def test_contrast_and_labels(watched: Watched, daemon: Served, size: str, scheme: str) -> None:
    """axe-core finds nothing, neither while all is live nor while all is old and an alarm, and nothing is wider than the screen.

    Light on phone and wall is asked stage by stage in `test_stages`.
    """
    width, height = SIZES[size]
    page = watched.open(daemon.address, width=width, height=height, scheme=scheme)
    daemon.do(lambda: daemon.survey.stop("npp", 1, 12))
    expect(page.locator("#deviations canvas")).to_be_visible()
    daemon.do(lambda: daemon.survey.silent.update({"laser", "plc"}))
    expect(page.locator(".figures.stale")).to_be_visible()
    expect(page.locator("body.alarm")).to_be_attached(timeout=60_000)
    assert violations(page) == [], "old, and an alarm: both links are silent"
    daemon.do(daemon.survey.complete)
    daemon.do(daemon.survey.silent.clear)
    expect(page.locator("#result figure")).to_have_count(9)
    assert violations(page) == []
    assert page.evaluate("document.documentElement.scrollWidth") <= width


@pytest.mark.parametrize("scheme", ["dark", "light"])
def test_advice_that_is_old_can_still_be_read(watched: Watched, daemon: Served, scheme: str) -> None:
    """Struck through as readings are, not faded: a laser that says nothing is when one looks at how the beam was to be set up."""
    page = watched.open(daemon.address, width=1024, height=768, scheme=scheme)
    daemon.do(lambda: daemon.survey.publish(beam=None))
    expect(page.locator("#no-beam")).to_be_visible()
    daemon.do(lambda: daemon.survey.silent.update({"laser", "plc"}))
    expect(page.locator(".stale #no-beam")).to_be_visible()
    expect(page.locator(".stale #tilt-advice")).to_be_visible()
    expect(page.locator(".stale #scatter")).to_be_attached()
    assert violations(page) == []


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
