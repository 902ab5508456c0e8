"""What the charts and drawings show and say, in a real browser while a survey is played."""

import contextlib
import re
from base64 import b64decode

import numpy as np
import pytest
from msgspec.structs import replace
from playwright.sync_api import Error as PlaywrightError
from playwright.sync_api import Page, expect

from stepdiag.daq.records.status import StripStatus
from testkit.played import Served
from testkit.running.slaves import wait_until

pytestmark = pytest.mark.page

WRITTEN_BELOW = """() => {
  const canvas = CanvasRenderingContext2D.prototype, write = canvas.fillText;
  window.below = [];
  canvas.fillText = function (text, ...rest) {
    const own = this.canvas.closest("#deviations") && this.textAlign === "center" && /^[0-9]/.test(text);
    if (own) window.below.push(text);
    return write.call(this, text, ...rest);
  };
}"""  # noqa: E501
"""Keeps from now on the figures that the chart of the deviations writes below its axis."""


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


def test_every_chart_says_its_values_under_pointer_and_key(
    page: Page, daemon: Served
) -> None:
    """Deviations, the last ten seconds, noise, functions of the result: hover or arrow keys,
    figures as the language writes them."""
    page.locator("#language").click()
    for chart in ("#strip", "#trend"):
        expect(page.locator(f"{chart} canvas")).to_be_visible(timeout=60_000)
        wait_until(
            lambda chart=chart: all(
                re.fullmatch(r"[−\d,]+", value)
                for value in values_at(page, chart, key="End") or [""]
            )
        )
    for stop in range(9):
        daemon.do(lambda stop=stop: daemon.survey.stop("npp", 1, stop))
    expect(page.locator("#deviations")).to_have_attribute("data-points", "[9]")
    assert values_at(page, "#deviations", key="Home") == ["1", "0,00"]
    assert values_at(page, "#deviations", key="ArrowRight") == ["2", "0,89"]
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
    return [
        line.split(",")
        for line in handed.value.path().read_text(encoding="utf-8").splitlines()
    ]


def test_drawings_of_the_volume_say_their_values_and_every_figure_has_its_table(
    page: Page, daemon: Served
) -> None:
    """Stops and errors by pointer and key, in the numbers of the language; what is drawn as CSV
    with decimal points in either."""
    for stop in range(9):
        daemon.do(lambda stop=stop: daemon.survey.stop("npp", 1, stop))
    volume, value = page.locator("#volume"), page.locator("#volume .value")
    expect(page.locator("#volume .stop")).to_have_count(9)
    volume.press("PageDown")
    volume.press("PageDown")
    expect(value).to_have_text(
        "diagonal X+Y−Z− to X−Y+Z+ (npp), out, stop 2: 0.89 µm, X; Y; Z = 450; 0; −300 mm"
    )
    volume.press("ArrowLeft")
    page.locator("#language").click()
    expect(value).to_have_text(
        "Diagonale X+Y−Z− nach X−Y+Z+ (npp), hin, Messpunkt 2: 0,89 µm, X; Y; Z = 450; 0; −300 mm"
    )
    page.locator("#volume .stop").nth(8).hover()
    expect(value).to_contain_text("Messpunkt 9: 4,80 µm")
    page.mouse.move(0, 0)
    expect(value).to_have_text("")
    head, *rows = table_of(page, "#volume")
    assert head == [
        "setup",
        "pass",
        "stop",
        "x_mm",
        "y_mm",
        "z_mm",
        "deviation_um",
        "u_um",
        "doubtful",
    ]
    assert (len(rows), rows[1][:6]) == (9, ["npp", "1", "1", "450", "0", "-300"])
    head, *rows = table_of(page, "#deviations")
    assert head == ["stop", "pass_1_um", "u_pass_1_um"]
    assert (len(rows), rows[0], rows[9]) == (31, ["0", "0", "0.3"], ["9", "", ""])
    assert [name.partition("_")[0] for name in table_of(page, "#strip")[0]] == [
        "time",
        "high",
        "low",
    ], "in mm while the laser travels"
    daemon.do(daemon.survey.complete)
    expect(page.locator("#field figure a.csv")).to_have_count(2)
    expect(page.locator("#result figure a.csv")).to_have_count(9)
    report = (daemon.survey.place / "report.html").read_text(encoding="utf-8")
    for figure in ("#function-EXX", "#function-EZZ", "#field-before"):
        name = figure.removeprefix("#function-").removeprefix("#")
        written = re.search(
            rf'download="{name}.csv" href="data:text/csv;charset=utf-8;base64,([^"]+)"',
            report,
        )
        assert written is not None
        shown, wanted = (
            table_of(page, figure),
            [line.split(",") for line in b64decode(written[1]).decode().splitlines()],
        )
        columns = slice(0, len(shown[0]))
        assert shown[0] == wanted[0][columns], "the columns of the report"
        assert np.allclose(
            np.array(shown[1:], dtype=float),
            np.array([row[columns] for row in wanted[1:]], dtype=float),
            atol=6e-5,
        )
    before, value = page.locator("#field-before"), page.locator("#field-before .value")
    before.press("End")
    x, y, z, *vector = map(float, shown[-1])
    said = (
        "; ".join(f"{part:.2f}" for part in vector)
        + f" µm, |E| = {np.linalg.norm(vector):.2f} µm"
    )
    words = f"X; Y; Z = {x:.0f}; {y:.0f}; {z:.0f} mm: {said}".replace("-", "−").replace(
        ".", ","
    )
    expect(value).to_have_text(words)
    for event in ("pointermove", "pointerleave"):
        before.dispatch_event(event, {"pointerType": "mouse"})
        expect(
            value, "what a browser sends when the drawing changes below a pointer that rests"
        ).to_have_text(words)


def test_the_last_ten_seconds_are_drawn_at_full_rate(page: Page, daemon: Served) -> None:
    """Fifty bins a second, each with its lowest and highest sample, whatever the pictures a second;
    a machine that moves has no scatter."""
    seen = "JSON.parse(document.getElementById('strip').dataset.points ?? '[0, 0]')"
    wait_until(lambda: page.evaluate(seen)[0] >= 400)
    assert page.evaluate(f"(([high, low]) => high === low)({seen})")
    expect(page.locator("#scatter")).to_contain_text(
        re.compile(r"^Standstill at \S+ mm, scatter of 0\.\d\d µm")
    )
    moving = tuple(float(place) for place in range(75))
    daemon.do(
        lambda: daemon.survey.publish(
            strip=StripStatus(first=10**9, bin_s=0.02, low_mm=moving, high_mm=moving)
        )
    )
    expect(page.locator("#scatter")).to_have_text("")


def test_a_standing_machine_is_drawn_in_micrometres_about_its_plateau(
    page: Page, daemon: Served
) -> None:
    """The reading is 282 mm from its zero; the way to the plateau leaves the picture."""
    way = (*(282.0 + 0.01 * step for step in range(35)), *(282.35,) * 40)
    daemon.do(
        lambda: daemon.survey.publish(
            strip=StripStatus(first=10**9, bin_s=0.02, low_mm=way, high_mm=way)
        )
    )
    expect(page.locator("#scatter")).to_have_text(
        "Standstill at 282.3500 mm, scatter of 0.00 µm in half a second"
    )
    rows = table_of(page, "#strip")
    assert rows[0] == ["time_s", "high_um", "low_um"]
    assert [float(value) for value in rows[-1]] == [0.0, 0.0, 0.0]
    assert float(rows[-75][1]) == pytest.approx(-350.0)


def test_marks_of_an_axis_are_written_with_the_decimals_they_need(page: Page) -> None:
    """Marks every 2.5 s were written 3, 5, 8."""
    marks = "[[-10, -7.5, -5], [0, 2], [0, 0.1], [0, 0.25], [400]]"
    assert page.evaluate(
        f"import('/static/curves.js').then((curves) => {marks}.map(curves.places))"
    ) == [1, 0, 1, 2, 0]


def test_a_chart_zooms_and_comes_back_by_key(page: Page, daemon: Served) -> None:
    """Dragging shows a part, whose marks are stops, Escape the whole; a new stop does not take the
    part away."""
    for stop in range(20):
        daemon.do(lambda stop=stop: daemon.survey.stop("npp", 1, stop))
    chart, over = page.locator("#deviations"), page.locator("#deviations .u-over")
    expect(chart).to_have_attribute("data-range", "[1,31]")
    over.scroll_into_view_if_needed()
    page.evaluate(WRITTEN_BELOW)
    box = over.bounding_box()
    assert box is not None
    page.mouse.move(box["x"] + 0.2 * box["width"], box["y"] + 20)
    page.mouse.down()
    page.mouse.move(box["x"] + 0.3 * box["width"], box["y"] + 20, steps=4)
    page.mouse.up()
    expect(chart).not_to_have_attribute("data-range", "[1,31]")
    marks = page.wait_for_function(
        "() => window.below.length > 1 && window.below"
    ).json_value()
    assert [mark for mark in marks if not mark.isdigit()] == []
    part = chart.get_attribute("data-range")
    daemon.do(lambda: daemon.survey.stop("npp", 1, 20))
    expect(chart).to_have_attribute("data-points", "[21]")
    expect(chart).to_have_attribute("data-range", part or "")
    over.focus()
    page.keyboard.press("Escape")
    expect(chart).to_have_attribute("data-range", "[1,31]")


def test_a_doubtful_stop_differs_in_shape(page: Page, daemon: Served) -> None:
    """A cross among dots, in the volume and in the chart: colour alone tells a colour-blind person
    nothing. Doubted later it counts too."""
    for stop in range(5):
        daemon.do(lambda stop=stop: daemon.survey.stop("npp", 1, stop))
    expect(page.locator("#volume circle.stop")).to_have_count(5)
    doubted = [
        replace(one, doubtful="unsteady" if one.stop == 3 else "")
        for one in daemon.do(lambda: daemon.survey.fields["stops"])
    ]
    daemon.do(lambda: daemon.survey.publish(stops=tuple(doubted)))
    expect(page.locator("#volume path.stop.doubt")).to_have_count(1)
    expect(page.locator("#volume circle.stop")).to_have_count(4)


def test_the_volume_turns_by_keyboard(page: Page) -> None:
    """Tab reaches it, arrow keys turn it."""
    volume = page.locator("#volume")
    volume.focus()
    before = volume.locator("path").first.get_attribute("d")
    page.keyboard.press("ArrowLeft")
    expect(volume.locator("path").first).not_to_have_attribute("d", before or "")
