"""The commanded position as the machine gives it: it counts, and where it is not the planned one
that is said."""

from dataclasses import replace

import pytest

from stepdiag.base.findings import Finding
from stepdiag.daq.capture.capture import Capture
from stepdiag.daq.capture.captured_stop import CapturedStop
from stepdiag.daq.capture.remarks.unchecked import unchecked
from stepdiag.daq.formats.signals import SignalSpec, resolution
from stepdiag.daq.passes.pass_book import PassBook
from stepdiag.daq.passes.tabulate import tabulate
from stepdiag.daq.survey.file import parse_survey
from testkit.timeline import STOPPED_ONLY, Timeline, diagonal, survey_text

SIZE = (300.0, 200.0, 100.0)
LONG = (300.0**2 + 200.0**2 + 100.0**2) ** 0.5


def rounded(stops, places):
    """Return standstills of a program whose author wrote positions with so many decimals; the laser
    reads where the machine is."""
    written = [tuple(round(value, places) for value in stop.position) for stop in stops]
    return [
        replace(
            stop,
            position=place,
            reading=sum(p * s for p, s in zip(place, SIZE, strict=True)) / LONG,
        )
        for stop, place in zip(stops, written, strict=True)
    ]


def run(stops, text):
    """Return the book, the findings and the stops of a capture."""
    survey = parse_survey(text, "survey.toml")
    book = PassBook(survey)
    capture = Capture(survey, book.start(skip_open_dwell=False))
    outcomes = [
        outcome for event in Timeline(stops).events() for outcome in capture.feed(event)
    ] + capture.finish()
    book.add_all(each for each in outcomes if isinstance(each, CapturedStop))
    return survey, book, [each for each in outcomes if isinstance(each, Finding)]


def test_the_readings_carry_the_position_that_the_machine_gave():
    """Y and Z thirds of 200 and 100 mm, written with one decimal: 33.3 µm beside the plan, and said
    once with stop and size."""
    survey, book, findings = run(rounded(diagonal("ppp"), 1), survey_text())
    (only,) = book.passes
    readings = tabulate(survey, [only])
    assert readings.position_mm[2].tolist() == pytest.approx([100.0, 66.7, 0.0], abs=1e-9)
    assert readings.position_mm[6].tolist() == pytest.approx([200.0, 133.3, 66.7], abs=1e-9)
    differing = [each for each in findings if each.code == "position-differs"]
    assert [(each.stop, each.severity) for each in differing] == [(2, "info")]
    assert "Y 66.7000 mm, the plan has 66.6667 mm (+33.3 µm)" in differing[0].text
    assert not only.doubts(), "a position that is known is no doubt"


def test_a_program_of_three_decimals_is_a_note():
    _, _, findings = run(rounded(diagonal("ppp"), 3), survey_text())
    assert [(each.code, each.severity) for each in findings] == [("position-differs", "info")]


def test_what_a_register_rounds_is_no_difference():
    """The contract's registers count tenths of a micrometre: thirds of a millimetre are what they
    say."""
    assert run(diagonal("ppp"), survey_text())[2] == []


def test_a_real_number_resolves_its_last_bit():
    """float32 holds 24 bits: 2^-15 mm at 400 mm (IEEE 754, binary32)."""
    assert resolution(SignalSpec(address=4, type="float32"), 400.0) == pytest.approx(2.0**-15)
    assert resolution(
        SignalSpec(address=4, type="int32", scale=-1e-4), 400.0
    ) == pytest.approx(1e-4)


def test_what_cannot_be_checked_is_said():
    text = {
        each.code: each.text
        for each in unchecked(
            parse_survey(survey_text(signals=STOPPED_ONLY, setups=("ppp", "npp")), "s")
        )
    }
    assert set(text) == {"signals-absent"}
    assert "cannot distinguish" not in text["signals-absent"]
    cube = survey_text(size=(200.0, 200.0, 100.0), signals=STOPPED_ONLY)
    (without, _) = unchecked(parse_survey(cube, "s"))
    assert (
        "X and Y make the same step along the diagonal, so the laser cannot distinguish these axes"
        in without.text
    )
    assert unchecked(parse_survey(survey_text(), "s")) == ()
    named = "a program that does not drive the diagonal of its setup code is not noticed"
    (coded, _) = unchecked(
        parse_survey(
            survey_text(
                signals=f"{STOPPED_ONLY}\n[plc.signals.setup]\naddress = 3\n",
                setups=("ppp", "npp"),
            ),
            "s",
        )
    )
    assert named in coded.text
    assert named not in text["signals-absent"]
    assert (
        run(diagonal("ppp"), survey_text(signals=STOPPED_ONLY))[2][0].code == "signals-absent"
    )
