"""What is still to be driven: one list for the card, the progress, the time left and `status`."""

import msgspec
import pytest
from hypothesis import given
from hypothesis import strategies as st

from stepdiag.base.findings import Finding
from stepdiag.base.messages import message
from stepdiag.daq.capture.captured_stop import marked
from stepdiag.daq.passes.pass_book import PassBook
from stepdiag.daq.passes.verdict import suspected
from stepdiag.daq.service.remaining import own_minutes, to_drive
from stepdiag.daq.service.snapshot import setup_statuses
from stepdiag.daq.survey.file import parse_survey
from testkit.exact import captured
from testkit.timeline import survey_text

SURVEY = parse_survey(survey_text(setups=("ppp", "npp"), back=True), "survey.toml")
DRIVEN = [(setup, outward) for setup in ("ppp", "npp") for outward in (True, False)]
SETTING_UP_MIN = 20.0
TAKES_MIN = 31.0


def stops_of(setup: str = "ppp", **how) -> list:
    """Return perfect stops of a pass; the setups stand so many minutes apart."""
    later_s = 60.0 * TAKES_MIN * ("ppp", "npp").index(setup)
    return [
        msgspec.structs.replace(stop, time_s=stop.time_s + later_s)
        for stop in captured.stops_of(setup, **how)
    ]


def book(*parts) -> PassBook:
    driven = PassBook(SURVEY)
    for part in parts:
        driven.add_all(part)
    return driven


def everything() -> list:
    return [stops_of(setup, outward=outward) for setup, outward in DRIVEN]


def listed(driven: PassBook, running: str = "") -> list[tuple[str, int, int, int, bool]]:
    drives = to_drive(SURVEY, driven, running)
    return [
        (each.setup, each.pass_number, each.from_stop, each.stops, each.again)
        for each in drives
    ]


def progress(driven: PassBook) -> tuple[int, int]:
    setups = setup_statuses(SURVEY, driven, to_drive(SURVEY, driven))
    return sum(one.stops_done for one in setups), sum(one.stops_wanted for one in setups)


def minutes(driven: PassBook) -> float:
    return sum(each.minutes for each in to_drive(SURVEY, driven))


def test_a_fresh_survey_is_to_be_driven_whole_in_the_order_of_the_plan() -> None:
    assert listed(book()) == [
        (setup, number, 0, 10, False) for setup in ("ppp", "npp") for number in (1, 2)
    ]
    assert progress(book()) == (0, 40)


def test_the_first_pass_of_a_setup_that_does_not_stand_has_the_setting_up() -> None:
    """A setup that was taken down has to be set up once more for a single pass."""
    first, second, *_ = to_drive(SURVEY, book())
    assert first.minutes > second.minutes + SETTING_UP_MIN
    half = book(stops_of("ppp", only=range(4)))
    assert (
        to_drive(SURVEY, half)[0].minutes < SETTING_UP_MIN < to_drive(SURVEY, half)[2].minutes
    )
    lost = [
        msgspec.structs.replace(stop, broken="beam lost") if stop.stop == 5 else stop
        for stop in stops_of("ppp")
    ]
    taken_down = book(lost, *everything()[1:])
    assert listed(taken_down) == [("ppp", 1, 4, 6, True)]
    assert minutes(taken_down) > SETTING_UP_MIN


@pytest.mark.parametrize(
    ("waits_min", "diagonal_min", "shift_min"),
    [
        ((12.0, 2.0, 18.0), 15.0, 2.0),
        ((12.0, 2.0, 95.0), 12.0, 2.0),
        ((100.0, 40.0, 95.0), 30.0, 5.0),
    ],
    ids=["measured", "one interruption", "nothing but interruptions"],
)
def test_setting_up_takes_as_long_as_the_log_shows(
    waits_min, diagonal_min, shift_min
) -> None:
    """From the last stop before to the first after; what was left overnight is none of it."""
    stops, time_s = [], 0.0
    for setup, wait_min in zip(
        ("ppp", "npp", "npp+1", "pnp"), (0.0, *waits_min), strict=True
    ):
        time_s += 60.0 * wait_min
        for stop in captured.stops_of("npp" if "+" in setup else setup):
            stops.append(msgspec.structs.replace(stop, setup=setup, time_s=time_s))
            time_s += 3.0
        time_s -= 3.0
    pace = own_minutes(SURVEY, stops).pace
    assert (pace.diagonal_setup_min, pace.beam_shift_min) == pytest.approx(
        (diagonal_min, shift_min)
    )
    assert pace.linear_setup_min == SURVEY.planned.pace.linear_setup_min


@pytest.mark.parametrize("took_min", [12.0, 55.0])
def test_the_time_left_counts_setting_up_as_it_went(took_min) -> None:
    """One setup was aligned within so many minutes: so will the next one be."""
    plan = parse_survey(survey_text(setups=("ppp", "npp", "pnp"), back=True), "survey.toml")
    driven = PassBook(plan)
    for minute, setup, outward in (
        (0.0, "ppp", True),
        (1.0, "ppp", False),
        (1.0 + took_min, "npp", True),
        (2.0 + took_min, "npp", False),
    ):
        driven.add_all(
            msgspec.structs.replace(stop, time_s=stop.time_s + 60.0 * minute)
            for stop in captured.stops_of(setup, outward=outward)
        )
    assert sum(each.minutes for each in to_drive(plan, driven)) == pytest.approx(
        took_min, abs=1.0
    )


def test_a_pass_that_runs_goes_on_where_it_is() -> None:
    """Nothing of it is to be driven again, as long as nothing is lost; one that was left is."""
    left = book(stops_of("ppp", only=range(4)))
    assert listed(left, "ppp")[0] == ("ppp", 1, 4, 6, False)
    assert listed(left)[0] == ("ppp", 1, 3, 7, True)
    stops = [
        msgspec.structs.replace(stop, broken="beam lost") if stop.stop == 5 else stop
        for stop in stops_of("ppp", only=range(8))
    ]
    assert listed(book(stops), "ppp")[0] == ("ppp", 1, 4, 6, False)


def test_whole_setups_that_the_solver_blames_are_still_to_be_driven() -> None:
    """Every stop has a reading, and "40 / 40, less than a minute" is no answer to two hours of
    work."""
    driven = book(*everything())
    assert (progress(driven), minutes(driven), listed(driven)) == ((40, 40), 0.0, [])
    found = Finding(
        code="contradiction",
        severity="error",
        text="ppp contradicts npp",
        setup="ppp",
        stop=None,
    )
    driven.suspect(suspected(driven, [found]))
    assert listed(driven) == [("ppp", 1, 0, 10, True), ("ppp", 2, 0, 10, True)]
    assert progress(driven) == (20, 40)
    assert minutes(driven) > SETTING_UP_MIN
    driven.add_all(
        msgspec.structs.replace(stop, window_from_ns=1000 + stop.stop)
        for stop in stops_of("ppp")
    )
    assert listed(driven, "ppp") == [("ppp", 2, 0, 10, True)]
    assert minutes(driven) < SETTING_UP_MIN


FAULTS = {
    "broken": lambda stop: msgspec.structs.replace(stop, broken="beam lost"),
    "unwatched": lambda stop: msgspec.structs.replace(
        stop, unwatched="no sample was received for 9.0 s"
    ),
    "refused": lambda stop: msgspec.structs.replace(stop, refused="wrong-axis-order"),
    "doubted": lambda stop: marked(stop, message("window-step", step_um=4.0)),
}


@given(
    faults=st.lists(
        st.tuples(st.integers(0, 3), st.integers(1, 9), st.sampled_from(sorted(FAULTS))),
        max_size=4,
    ),
    passes=st.integers(0, 4),
)
def test_progress_and_time_end_with_the_survey_and_not_before(faults, passes) -> None:
    """Whatever went wrong: the list is empty where the survey is complete, and what it holds is
    what `reason` and counts show."""
    parts = everything()[:passes]
    for at, stop, kind in faults:
        if at < passes:
            parts[at][stop] = FAULTS[kind](parts[at][stop])
    driven = book(*parts)
    drives, (done, wanted) = to_drive(SURVEY, driven), progress(driven)
    assert (
        bool(drives) == (not driven.complete()) == (done < wanted) == (minutes(driven) > 0.0)
    )
    assert {(each.setup, each.pass_number) for each in drives} == {
        (setup, number) for setup in ("ppp", "npp") for number in driven.open_passes(setup)
    }
    assert wanted - done == sum(each.stops for each in drives)
    for one in setup_statuses(SURVEY, driven, drives):
        again = [each for each in drives if each.setup == one.name and each.again]
        assert all(f"pass {each.pass_number}: " in str(one.reason) for each in again)
        assert bool(again) == bool(one.reason)
        assert all(
            f"from stop {each.from_stop + 1} on" in str(one.reason)
            for each in again
            if each.from_stop
        )
