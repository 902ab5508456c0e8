"""The page on every screen, in light and dark, for eyes and fingers: a real browser while a survey
is played."""

import math

import pytest
from playwright.sync_api import expect

from testkit.browser import Watched, violations
from testkit.played import Served

pytestmark = pytest.mark.page

SIZES = {"phone": (390, 844), "tablet": (820, 1180), "wall": (1920, 1080)}


@pytest.mark.parametrize(
    ("size", "scheme"), [("phone", "dark"), ("tablet", "light"), ("wall", "dark")]
)
def test_contrast_and_labels(
    watched: Watched, daemon: Served, size: str, scheme: str
) -> None:
    """axe-core finds nothing, neither while all is live nor while all is old and an alarm, and
    nothing is wider than the screen.

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
def test_advice_that_is_old_can_still_be_read(
    watched: Watched, daemon: Served, scheme: str
) -> None:
    """Struck through as readings are, not faded: a laser that says nothing is when one looks at how
    the beam was to be set up."""
    page = watched.open(daemon.address, width=1024, height=768, scheme=scheme)
    daemon.do(lambda: daemon.survey.publish(beam=None))
    expect(page.locator("#no-beam")).to_be_visible()
    daemon.do(lambda: daemon.survey.silent.update({"laser", "plc"}))
    expect(page.locator(".stale #no-beam")).to_be_visible()
    expect(page.locator(".stale #tilt-advice")).to_be_visible()
    expect(page.locator(".stale #scatter")).to_be_attached()
    assert violations(page) == []


def test_the_smallest_phone_needs_no_sideways_scrolling(
    watched: Watched, daemon: Served
) -> None:
    """320 px: the reading still fits in one line."""
    page = watched.open(daemon.address, width=320, height=568)
    daemon.do(lambda: daemon.survey.publish(reading_mm=-12345.67891))
    expect(page.locator("#reading")).to_have_text("−12345.67891")
    assert page.evaluate("document.documentElement.scrollWidth") <= 320


MM_A_PIXEL = 531.4 / 1920
"""Of a screen of 24 inches, 16:9, with 1920 pixels in a row."""
CAPITAL = 0.72
"""Height of a capital letter in the page's font, in sizes of the font."""


def test_the_advice_can_be_read_from_two_metres(watched: Watched, daemon: Served) -> None:
    """On a screen of 24 inches a capital letter of lead and advice fills 16 minutes of arc, the
    least of ISO 9241-303 for reading."""
    page = watched.open(daemon.address, width=1920, height=1080)
    daemon.do(lambda: daemon.survey.stop("npp", 1, 12))
    for place in ("#lead", "#advice"):
        size = page.locator(place).evaluate(
            "one => parseFloat(getComputedStyle(one).fontSize)"
        )
        minutes = math.degrees(math.atan(size * CAPITAL * MM_A_PIXEL / 2000.0)) * 60.0
        assert minutes >= 16.0, (place, size, minutes)


def test_fingers_find_the_buttons(watched: Watched, daemon: Served) -> None:
    """Every control a greasy finger presses is at least 44 px high."""
    page = watched.open(daemon.address, width=390, height=844)
    heights = page.locator("button:visible, input:visible, select:visible").evaluate_all(
        "all => all.map(one => one.offsetHeight)"
    )
    assert heights
    assert min(heights) >= 44


def test_light_and_dark_follow_the_room_until_a_person_chooses(
    watched: Watched, daemon: Served
) -> None:
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
