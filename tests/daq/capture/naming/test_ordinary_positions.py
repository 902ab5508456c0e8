"""Positions as ordinary machines give them: encoders that scatter, registers in 1 µm steps,
programs of few decimals, G91.

A clean survey of any of them is complete, without a warning and without a doubt, and the readings
carry where the machine stood.
"""

import struct
from dataclasses import dataclass, replace

import numpy as np
import pytest
from hypothesis import Phase, given
from hypothesis import strategies as st

from stepdiag.base.findings import Finding
from stepdiag.base.volume import Volume
from stepdiag.daq.capture.capture import Capture
from stepdiag.daq.capture.captured_stop import CapturedStop
from stepdiag.daq.capture.standing.dwell import DwellTracker
from stepdiag.daq.formats.signals import Signals
from stepdiag.daq.passes.deviations import RecentStops
from stepdiag.daq.passes.pass_book import PassBook
from stepdiag.daq.passes.tabulate import tabulate
from stepdiag.daq.survey.file import parse_survey
from testkit.examples import few
from testkit.routes import make_route
from testkit.timeline import Timeline, diagonal, survey_text

SIZE = (300.07, 200.05, 100.09)
UNIT = np.array(SIZE) / np.linalg.norm(SIZE)
N = 9


@dataclass
class Encoders(Timeline):
    """A machine whose registers hold actual positions, anew at every poll: scatter in um, and the
    step of the register."""

    flicker_um: float = 0.0
    register_um: float = 0.1

    def registers(self, now, heartbeat):
        data = bytearray(super().registers(now, heartbeat))
        rng = np.random.default_rng([self.seed, heartbeat])
        place = np.array(struct.unpack_from(">iii", data, 8)) / 10.0 + rng.normal(
            0.0, self.flicker_um, 3
        )
        struct.pack_into(
            ">iii",
            data,
            8,
            *(
                int(round(value / self.register_um) * round(10 * self.register_um))
                for value in place
            ),
        )
        return bytes(data)


def standing_at(stops, places_mm):
    """Return standstills at other places; the laser reads where the machine is."""
    return [
        replace(stop, position=tuple(place), reading=float(place @ UNIT))
        for stop, place in zip(stops, places_mm, strict=True)
    ]


def absolute(places_mm, decimals):
    return np.round(places_mm, decimals)


def incremental(places_mm, decimals):
    """G91: every step is rounded, and the rounding adds up."""
    steps = np.diff(places_mm, axis=0, prepend=places_mm[:1])
    steps[0] = places_mm[0]
    return np.cumsum(np.round(steps, decimals), axis=0)


def captured(passes, **machine):
    """Return survey, book and findings of a survey, its passes one log each."""
    survey = parse_survey(survey_text(size=SIZE, n=N, back=True, dwell=0.8), "survey.toml")
    book, findings = PassBook(survey), []
    for stops in passes:
        capture = Capture(survey, book.start(skip_open_dwell=False))
        outcomes = [
            outcome
            for event in Encoders(stops, **machine).events()
            for outcome in capture.feed(event)
        ] + capture.finish()
        book.add_all(each for each in outcomes if isinstance(each, CapturedStop))
        findings += [each for each in outcomes if isinstance(each, Finding)]
    return survey, book, findings


def assert_clean(out, back, places_um, **machine):
    survey, book, findings = captured([out, back[::-1]], **machine)
    assert [(each.code, each.text) for each in findings if each.severity != "info"] == []
    assert [each.number for each in book.passes if each.complete] == [1, 2]
    readings = tabulate(survey, book.passes)
    told = np.array([stop.position for stop in (*out, *back[::-1])])
    assert np.max(np.abs(readings.position_mm - told)) <= 1e-3 * places_um
    for number in (1, 2):
        own = readings.pass_number == number
        off_um = 1e3 * (readings.reading_mm[own] - told[own] @ UNIT)
        assert np.ptp(off_um) < 1.0
    shown_um = [each.deviation_um for each in RecentStops().of(survey, book)]
    assert len(shown_um) == len(told)
    assert np.max(np.abs(shown_um)) < 1.0 + 3.0 * places_um


OUT = diagonal("ppp", SIZE, N)
PLAN = np.array([stop.position for stop in OUT])


@pytest.mark.parametrize("decimals", [1, 2, 3])
def test_programs_of_few_decimals(decimals):
    stops = standing_at(OUT, absolute(PLAN, decimals))
    assert_clean(stops, stops, 0.06)


def test_g91_adds_its_rounding_up():
    """In 27 steps of 33.3411, 22.2278 and 11.1211 mm, written with two decimals: 10 to 20 µm at the
    end, 0.2 mm with forty increments."""
    places = incremental(PLAN, 2)
    assert np.max(np.abs(places - PLAN)) > 0.019
    stops = standing_at(OUT, places)
    assert_clean(stops, stops, 0.06)


@few(2, phases=[Phase.explicit, Phase.generate])
@given(st.integers(0, 10_000), st.sampled_from([0.1, 0.5, 3.0]), st.sampled_from([0.1, 1.0]))
def test_encoders_that_scatter_from_stop_to_stop(seed, scatter_um, register_um):
    """The machine stood where they say, in both directions elsewhere."""
    rng = np.random.default_rng(seed)
    places = [PLAN + rng.normal(0.0, 1e-3 * scatter_um, PLAN.shape) for _ in range(2)]
    assert_clean(
        *(standing_at(OUT, each) for each in places),
        0.06 + 0.5 * register_um,
        seed=seed,
        register_um=register_um,
    )


@few(2, phases=[Phase.explicit, Phase.generate])
@given(st.integers(0, 10_000), st.sampled_from([0.3, 1.0, 3.0]), st.sampled_from([0.1, 1.0]))
def test_encoders_that_scatter_from_poll_to_poll(seed, flicker_um, register_um):
    """A standstill's median of some thirty polls: the machine stood still."""
    assert_clean(
        OUT,
        OUT,
        1.2 * flicker_um + register_um,
        seed=seed,
        flicker_um=flicker_um,
        register_um=register_um,
    )


@given(
    st.integers(1, 60), st.sampled_from([1, 2, 3]), st.tuples(*[st.floats(60.0, 4000.0)] * 3)
)
def test_every_stop_of_a_rounded_program_is_found(n, decimals, size_mm):
    """With G91 and up to forty increments, too."""
    route = make_route(
        Volume(origin_mm=(0.0, 0.0, 0.0), size_mm=size_mm, increments=n),
        "npp",
        "xyz",
        outward=True,
    )
    for places in (
        absolute(route.stops_mm, decimals),
        *([incremental(route.stops_mm, decimals)] if decimals > 1 and n <= 20 else []),
    ):
        assert [route.find(tuple(place), stop) for stop, place in enumerate(places)] == list(
            range(len(route))
        )


def test_a_position_beside_every_stop_is_none():
    route = make_route(
        Volume(origin_mm=(0.0, 0.0, 0.0), size_mm=SIZE, increments=N),
        "ppp",
        "xyz",
        outward=True,
    )
    assert route.find((0.3, 0.0, 0.0), 0) is None
    assert route.find((0.0, 0.0, 0.24), 0) == 0


def test_a_register_that_runs_in_and_flickers_gives_the_median():
    tracker, places = (
        DwellTracker(),
        [9.97, 9.999, *(10.0 + 1e-4 * k for k in (3, -1, 2, 0, -2, 1, -3))],
    )
    for poll, x_mm in enumerate(places):
        tracker.poll(
            Signals(stopped=True, x_mm=x_mm, y_mm=0.0, z_mm=0.0),
            poll * 25_000_000,
            poll * 25_000_000 + 1,
        )
    assert tracker.open is not None
    assert tracker.open.signals.x_mm == pytest.approx(10.0, abs=1.1e-4)
