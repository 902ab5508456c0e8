"""What was recorded twice must agree, or be named on its stop: over real processes, sockets and
ptys."""

import csv
import json
import re

import pytest

from stepdiag.daq.replay import begun_logs, replay
from testkit.cli import stepdiag
from testkit.examples import spread
from testkit.running.hall import daemon, hall, until
from testkit.running.verdict import nothing_silently_wrong

pytestmark = pytest.mark.system

LEAST_U_UM = 0.0005
"""Steps of two nanometres, the finest instrument's, over the root of twelve: no reading is known
better."""
COMPENSATED = {"laser_bench": "compensated = true\n", "laser_survey": "compensated = true\n"}


def findings_of(said, code):
    """Return what was said under a code."""
    return [
        each["text"] for each in said if each["event"] == "finding" and each["code"] == code
    ]


@pytest.mark.impatient
def test_a_hand_written_program_is_measured_where_it_drives(tmp_path):
    """Thirds of 200 and 100 mm written with one decimal: the readings stand at the positions
    commanded, and the difference is said."""
    with hall(
        tmp_path, n=3, handshake=True, dwell=0.5, program="decimals = 1\n", **COMPENSATED
    ) as place:
        with daemon(place.survey) as process:
            place.start_setups()
            said = until(process, "survey-complete")
        assert said[-1]["exit_code"] == 0
        nothing_silently_wrong(place)
    rows = list(csv.DictReader((place.round / "readings.csv").read_text().splitlines()))
    assert {row["y_mm"] for row in rows} == {"0", "66.7", "133.3", "200"}
    assert "+33.3 µm" in findings_of(said, "position-differs")[0]


@pytest.mark.impatient
def test_without_position_registers_it_is_said_what_nobody_checks(tmp_path):
    """In the journal, in the result and in the report."""
    signals = (
        '[plc.signals.stopped]\naddress = 2\ntype = "bit"\nbit = 0\n[plc.signals.setup]\naddress '
        "= 3\n"
    )
    with hall(tmp_path, n=1, signals=signals, **COMPENSATED) as place:
        with daemon(place.survey) as process:
            place.start_setups()
            said = until(process, "survey-complete")
        nothing_silently_wrong(place)
        code, _, _ = stepdiag(
            "report", place.round / "result.json", "--out", tmp_path / "report.html"
        )
    (text, *_) = findings_of(said, "signals-absent")
    result = json.loads((place.round / "result.json").read_text())
    assert text in [each["text"] for each in result["findings"]]
    assert code == 0
    assert (
        "every stop is assumed at its planned position"
        in (tmp_path / "report.html").read_text()
    )


def fault(**fields):
    """Return a fault of the bench as its file has it."""
    return "[[fault]]\n" + "".join(
        f"{key} = {json.dumps(value)}\n" for key, value in fields.items()
    )


def longer(stop, seconds, setup="ppp"):
    """Return the fault by which a stop dwells longer, in seconds of the machine, ten to one of
    ours: room for what happens there."""
    return fault(kind="dwell-longer", setup=setup, stop=stop, duration_s=seconds)


THERE_AND_BACK = [
    {"kind": "laser-jump", "value": size, "delay_s": at}
    for size, at in ((30.0, 0.3), (-30.0, 0.36))
]
"""Ten per cent of the samples lie far from the others: more than noise explains, and no step."""


@pytest.mark.impatient
@pytest.mark.parametrize(
    ("code", "words", "troubles"),
    spread(
        [
            pytest.param(
                "window-step",
                "a step of +",
                [{"kind": "laser-jump", "value": 5.0, "delay_s": 0.3}],
                id="step",
            ),
            pytest.param(
                "window-step",
                "samples differ from the other samples",
                THERE_AND_BACK,
                id="jump",
            ),
            pytest.param(
                "laser-frozen",
                "sent the same value",
                [{"kind": "laser-frozen", "delay_s": 0.02, "duration_s": 0.55}],
                id="frozen",
            ),
        ],
        2,
    ),
)
def test_a_window_that_contradicts_itself_keeps_its_pass_open(
    tmp_path, code, words, troubles
):
    """A step inside the dwell, a reading that jumps and comes back, a frozen value: named on the
    stop; the pass is to be driven again."""
    faults = longer(2, 3.5) + "".join(fault(setup="ppp", stop=2, **each) for each in troubles)
    with hall(tmp_path, n=1, setups=("ppp",), faults=faults, **COMPENSATED) as place:
        with daemon(place.survey) as process:
            place.start_setups()
            said = until(process, "pass-ended")
        book = nothing_silently_wrong(place)
        told = stepdiag("status", place.survey, "--verbose").out
    assert "stop 3 of 4" in findings_of(said, code)[0]
    assert words in findings_of(said, code)[0]
    assert [
        (each.setup, each.pass_number, each.stop, each.code) for each in book.doubts()
    ] == [("ppp", 1, 2, code)]
    assert not book.complete()
    assert "may be wrong" in told
    assert "drive again from stop 2 on" in told
    doubted = book.passes[0].chosen()[2]
    assert doubted.u_um > LEAST_U_UM, (
        "a reading that stands still is no better than its resolution"
    )


STOPPED = '[plc.signals.stopped]\naddress = 2\ntype = "bit"\nbit = 0\n'
COUNTED = (
    STOPPED + "[plc.signals.setup]\naddress = 3\n[plc.signals.stop_count]\naddress = 1\n"
)


CUBE = (200.0, 200.0, 200.0)
DRIVEN_AGAIN = [
    pytest.param(STOPPED, 4, {}, id="whole, stopped"),
    pytest.param(COUNTED, 2, {}, id="from stop 2 on, stopped, setup, stop_count"),
    pytest.param(STOPPED, 2, {"size": CUBE}, id="from stop 2 on, stopped, cube"),
    pytest.param(COUNTED, 4, {"size": CUBE}, id="whole, stopped, setup, stop_count, cube"),
]


@pytest.mark.impatient
@pytest.mark.parametrize(("signals", "back_by", "box"), spread(DRIVEN_AGAIN, 2))
def test_an_aborted_pass_is_driven_again_without_positions(tmp_path, signals, back_by, box):
    """Whole, or from a stop: the laser's unbroken count says where the machine is, and every
    reading is right."""
    trouble = fault(
        kind="program-aborted", setup="ppp", stop=4, value=back_by, duration_s=10.0
    )
    with hall(
        tmp_path,
        dwell=3.0,
        setups=("ppp",),
        signals=signals,
        faults=trouble,
        **box,
        **COMPENSATED,
    ) as place:
        with daemon(place.survey) as process:
            place.start_setups()
            said = until(process, "pass-ended", kind="complete")
        book = nothing_silently_wrong(place)
    (only,) = book.passes
    assert only.complete, only.why_incomplete()
    assert [len(only.measured[stop]) for stop in range(7)] == [
        1 + (4 - back_by <= stop <= 4) for stop in range(7)
    ]
    assert findings_of(said, "stop-again")
    alike = (
        "X and Y and Z make the same step along the diagonal, so the laser cannot distinguish "
        "these axes"
    )
    assert any(alike in text for text in findings_of(said, "signals-absent")) == (
        box.get("size") == CUBE
    )


@pytest.mark.impatient
def test_where_nobody_can_tell_the_whole_pass_is_asked_for_and_driven_again_it_is_right(
    tmp_path,
):
    """A cube by `stopped` alone, left at the last stop but one, the beam cut, begun anew: its first
    stop reads as the last one would."""
    troubles = fault(
        kind="program-aborted", setup="ppp", stop=2, value=2, duration_s=20.0
    ) + longer(2, 3.5)
    troubles += fault(kind="beam-lost", setup="ppp", stop=2, delay_s=1.5, duration_s=0.2)
    unplaced = {"setups": ("ppp",), "signals": STOPPED, "size": CUBE, "faults": troubles}
    with hall(tmp_path, n=1, **unplaced, **COMPENSATED) as place:
        with daemon(place.survey) as process:
            place.start_setups(stop_after=1)
            said = until(process, "pass-ended", kind="complete")
            after = until(process, "pass-ended", kind="complete")
        book = nothing_silently_wrong(place)
        (left,) = replay(begun_logs(place.round)[:1]).book.passes
    assert findings_of(said, "place-unknown")
    assert "drive the whole pass again" in str(left.why_incomplete())
    assert findings_of(after, "stop-again")
    (only,) = book.passes
    assert only.complete, only.why_incomplete()


@pytest.mark.impatient
def test_where_the_count_was_lost_and_the_machine_says_no_place_its_stops_are_doubted(
    tmp_path,
):
    """A box by `stopped` alone, the beam cut on the way: the step tells which stop it is, but
    nobody that the pass was not begun anew."""
    trouble = fault(kind="beam-lost", setup="ppp", stop=2, phase="move", duration_s=0.1)
    with hall(
        tmp_path,
        n=1,
        dwell=3.0,
        setups=("ppp",),
        signals=STOPPED,
        faults=trouble,
        **COMPENSATED,
    ) as place:
        with daemon(place.survey) as process:
            place.start_setups()
            said = until(process, "pass-ended")
        book = nothing_silently_wrong(place)
    assert "stop 3 of 4" in findings_of(said, "place-unknown")[0]
    (only,) = book.passes
    assert "place-unknown" in only.measured[2][0].stop.doubt_codes
    assert "drive the whole pass again" in str(only.why_incomplete())


@pytest.mark.impatient
@pytest.mark.parametrize(
    ("signals", "code", "trouble"),
    spread(
        [
            pytest.param(
                STOPPED,
                "between-stops",
                {"kind": "feed-hold", "stop": 4, "duration_s": 6.0},
                id="feed hold, stopped",
            ),
            pytest.param(
                COUNTED,
                "between-stops",
                {"kind": "feed-hold", "stop": 4, "duration_s": 6.0},
                id="feed hold, counted",
            ),
            pytest.param(
                COUNTED, "count-stuck", {"kind": "count-stuck", "stop": 3}, id="stuck counter"
            ),
        ],
        2,
    ),
)
def test_the_laser_places_what_the_signals_do_not(tmp_path, signals, code, trouble):
    """A standstill between two stops is none, a counter that stands still is named once; the pass
    is whole and right."""
    with hall(
        tmp_path,
        dwell=3.0,
        setups=("ppp",),
        signals=signals,
        faults=fault(setup="ppp", **trouble),
        **COMPENSATED,
    ) as place:
        with daemon(place.survey) as process:
            place.start_setups()
            said = until(process, "pass-ended", kind="complete")
        book = nothing_silently_wrong(place)
    (only,) = book.passes
    assert only.complete, only.why_incomplete()
    assert [len(entries) for entries in only.measured.values()] == [1] * 7
    assert len(findings_of(said, code)) == 1


@pytest.mark.impatient
def test_an_alarm_in_a_pass_is_named_with_its_time_and_keeps_the_pass_open(tmp_path):
    """Whether the machine stood where it should a person says: the words are in journal and
    status."""
    trouble = fault(kind="plc-alarm", setup="ppp", stop=2, phase="move", duration_s=0.2)
    with hall(
        tmp_path, n=1, dwell=3.0, setups=("ppp",), faults=trouble, **COMPENSATED
    ) as place:
        with daemon(place.survey) as process:
            place.start_setups()
            said = until(process, "survey-open")
        book = nothing_silently_wrong(place)
        told = stepdiag("status", place.survey, "--verbose").out
    (text,) = findings_of(said, "machine-alarm")
    assert re.search(
        r"\(ppp\) out, stop 3 of 4: the machine reported an alarm at [0-9:]{8} UTC", text
    )
    assert [(each.place, each.code) for each in book.doubts()] == [
        ("ppp/1/2", "machine-alarm")
    ]
    assert "ppp/1/2 --reason" in told


@pytest.mark.impatient
def test_a_mirror_touched_between_two_drives_of_a_stop_is_found(tmp_path):
    """The program goes two stops back after the mirror was touched: three stops measured on both
    sides join the count."""
    troubles = fault(
        kind="program-aborted", setup="ppp", stop=4, value=2.0, duration_s=10.0
    ) + longer(4, 3.5)
    troubles += fault(kind="laser-jump", setup="ppp", stop=4, value=55.0, delay_s=0.9)
    with hall(tmp_path, setups=("ppp",), faults=troubles, **COMPENSATED) as place:
        with daemon(place.survey) as process:
            place.start_setups()
            said = until(process, "pass-ended", kind="complete")
        book = nothing_silently_wrong(place)
    (only,) = book.passes
    assert only.complete, only.why_incomplete()
    assert (
        "stop 3 of 7: the repeated reading of this stop differs by +55.0 µm"
        in findings_of(said, "reading-differs")[0]
    )


@pytest.mark.impatient
def test_where_one_stop_alone_was_measured_on_both_sides_of_a_touch_the_pass_stays_open(
    tmp_path,
):
    """Whether the mirror moved or turned nobody knows: the pass is asked for again from two stops
    before, and a person hears why."""
    troubles = fault(
        kind="program-aborted", setup="ppp", stop=2, value=0.0, duration_s=15.0
    ) + longer(2, 3.5)
    troubles += fault(kind="laser-jump", setup="ppp", stop=2, value=55.0, delay_s=1.4)
    with hall(tmp_path, n=1, setups=("ppp",), faults=troubles, **COMPENSATED) as place:
        with daemon(place.survey) as process:
            place.start_setups()
            said = until(process, "survey-open")
        book = nothing_silently_wrong(place)
        told = stepdiag("status", place.survey, "--verbose").out
    assert (
        "stop 3 of 4: the repeated reading of this stop differs by +55.0 µm"
        in findings_of(said, "reading-differs")[0]
    )
    # of two good readings of stop 2 the one with less scatter stands: the doubt begins with it, or
    # after it
    (doubt,) = book.doubts()
    assert (doubt.code, doubt.stop in (2, 3)) == ("reading-differs", True)
    assert "the repeated reading of stop 3 differs by +55.0 µm" in told
    assert f"drive again from stop {doubt.stop - 1} on" in told


@pytest.mark.impatient
@pytest.mark.parametrize("slip_um", spread([5.0, -200.0], 2))
def test_a_count_slip_on_the_way_is_named_with_stop_and_size(tmp_path, slip_um):
    """Out against back: the pass is named, or both where either may be at fault; the survey
    waits."""
    trouble = fault(
        kind="laser-jump", setup="ppp", pass_number=1, stop=4, phase="move", value=slip_um
    )
    with hall(
        tmp_path,
        n=3,
        back=True,
        handshake=True,
        dwell=0.5,
        setups=("ppp",),
        faults=trouble,
        **COMPENSATED,
    ) as place:
        with daemon(place.survey) as process:
            place.start_setups()
            until(process, "pass-ended", kind="complete")
            said = until(process, "pass-ended", kind="complete")
        book = nothing_silently_wrong(place)
    texts = findings_of(said, "count-slip")
    assert any(
        "(ppp) out, stop 5 of 10: the laser's count jumped" in text for text in texts
    ), texts
    assert next(
        each.size_um for each in book.doubts() if (each.pass_number, each.stop) == (1, 4)
    ) == pytest.approx(slip_um, abs=1.0)
    assert not book.complete()
    assert {each.code for each in book.doubts()} == {"count-slip"}


@pytest.mark.impatient
def test_a_count_slip_in_a_pass_driven_once_keeps_the_survey_open_with_its_stop_and_size(
    tmp_path,
):
    """Nothing in the recording tells it: the solver names it, and what else it may have been."""
    trouble = fault(
        kind="laser-jump", setup="npp", pass_number=1, stop=4, phase="move", value=20.0
    )
    runs = ("ppp", "npp", "pnp", "ppn", "linear-x", "linear-y", "linear-z")
    driven = {
        "n": 2,
        "handshake": True,
        "dwell": 0.1,
        "setups": runs,
        "faults": trouble,
        **COMPENSATED,
    }
    with hall(tmp_path, **driven) as place, daemon(place.survey) as process:
        place.start_setups(stop_after=len(runs))
        reason = until(process, "survey-open")[-1]["reason"]
    doubted = {
        each["place"]
        for each in json.loads(stepdiag("status", place.survey, "--json").out)["doubts"]
    }
    assert (
        doubted
        == {
            f"{setup}/{number}"
            for setup, number in re.findall(r"\((\S+)\), pass (\d) \w+, stop", reason)
        }
        != set()
    )
    (size,) = set(
        re.findall(
            r"\(npp\), pass 1 out, stop 5 \(a jump of \+([0-9.]+) µm before this stop\)",
            reason,
        )
    )
    assert float(size) == pytest.approx(20.0, abs=1.0)
    assert not (place.round / "result.json").exists()


@pytest.mark.impatient
@pytest.mark.parametrize("handshake", [False, True], ids=["by time", "handshake"])
def test_registers_that_lag_behind_the_stop_signal(tmp_path, handshake):
    """Counter and position come 0.1 s after the stop signal: nothing is said, nothing is lost."""
    paced = {"handshake": handshake, "dwell": 0.5 if handshake else 4.0}
    with hall(
        tmp_path,
        n=2,
        setups=("ppp",),
        plc_bench="lag_s = 0.1\n",
        feed=6000.0,
        **paced,
        **COMPENSATED,
    ) as place:
        with daemon(place.survey) as process:
            place.start_setups()
            said = until(process, "pass-ended", kind="complete")
        book = nothing_silently_wrong(place)
    (only,) = book.passes
    assert only.complete, only.why_incomplete()
    assert not [
        each
        for each in said
        if each["event"] == "finding" and each["code"] != "instrument-reports"
    ]


@pytest.mark.impatient
def test_a_stop_signal_that_flickers(tmp_path):
    """Away for 40 ms, 0.1 s into the dwell: the long part is measured, once; the journal says each
    stop and what is awaited."""
    trouble = longer(2, 9.5) + fault(
        kind="stop-flicker", setup="ppp", stop=2, delay_s=0.1, duration_s=0.04
    )
    with hall(tmp_path, n=1, setups=("ppp",), faults=trouble, **COMPENSATED) as place:
        with daemon(place.survey) as process:
            place.start_setups()
            said = until(process, "pass-ended", kind="complete")
        book = nothing_silently_wrong(place)
    (only,) = book.passes
    assert only.complete
    stops = [each for each in said if each["event"] == "stop"]
    assert [(each["stop"], each["of"]) for each in stops] == [(0, 3), (1, 3), (2, 3), (3, 3)]
    for each, nominal_mm in zip(stops, only.route.nominal_mm, strict=True):
        assert each["reading_mm"] == pytest.approx(nominal_mm, abs=0.1)
        assert each["deviation_um"] == pytest.approx(
            1e3 * (each["reading_mm"] - nominal_mm), abs=0.01
        )
    assert [each["waits_for"].split(", ")[:2] for each in stops[:3]] == [
        ["diagonal X-Y-Z- to X+Y+Z+ (ppp)", f"stop {number} of 4"] for number in (2, 3, 4)
    ]
    assert only.chosen()[2].window_to_ns - only.chosen()[2].window_from_ns > 0.3e9
