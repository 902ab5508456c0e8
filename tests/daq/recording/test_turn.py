"""A machine with backlash that turns round at the end of a pass: what it reads there, and from
which side each axis has come."""

from dataclasses import replace

import numpy as np
import pytest
from msgspec import structs

from stepdiag.base.readings.readings import parse_readings, render_readings
from stepdiag.daq.capture.captured_stop import Remark
from stepdiag.daq.passes.pass_book import PassBook
from stepdiag.daq.passes.tabulate import tabulate
from stepdiag.daq.recording.sinks import Nowhere
from stepdiag.daq.timing.strip import Strip
from stepdiag.solver.methods.solve import solve
from stepdiag.virtual.drive.setups import aligned_setup
from stepdiag.virtual.physics.error_functions import Table
from stepdiag.virtual.physics.machine import Machine
from testkit.exact.driven import Fault, Program, machine_of, recorded, survey_file
from testkit.examples import spread
from testkit.fault_cases import COUNTED, STOPPED
from testkit.ordinary.measured import simulate_pass
from testkit.timeline import SETUPS as NUMBERS

SETUPS = ("ppp", "npp", "pnp", "ppn", "linear-x", "linear-y", "linear-z")
PLAY_UM = {"EXX": 3.0, "EYY": 4.0, "EZZ": 2.0, "EYX": 1.0, "EZY": -1.0}


def loose():
    """Return a machine whose axes have play, the same wherever they stand."""
    machine = machine_of(5)
    play = {name: Table((0.0, 300.0), (size, size)) for name, size in PLAY_UM.items()}
    return Machine(errors=replace(machine.errors, reversal=play))


class TurningRound(Program):
    """Drives out with an overrun and back without: at its last stop it dwells once."""

    def stands(self, count, number):
        """Return the stops of a pass in the order in which the machine stands at them; None where
        it drives as the program does."""
        return range(1, count) if number == 2 else None

    def _pass(self, setup, driven, number, how):
        position = simulate_pass(
            self.machine, self.box, driven, number, alignment=how
        ).position_mm
        stands = self.stands(len(position), number)
        if stands is None:
            super()._pass(setup, driven, number, how)
            return
        side = np.sign(position[0] - position[-1]) * (-1 if number == 1 else 1)
        last = position[0]
        for here in position[list(stands)]:
            side = np.where(here != last, np.sign(here - last), side)
            read = self.machine.indicated_mm(
                aligned_setup(self.machine, self.box, driven, how),
                here[None],
                direction=side[None],
            )
            self._stand(here, read[0], setup=NUMBERS[setup])
            last = here


class TurningTwice(TurningRound):
    """At its last stop it dwells a second time without moving."""

    def stands(self, count, number):
        return range(count) if number == 2 else None


class GoingBack(TurningRound):
    """Aborted at stop 4 of the way out, driven again from stop 1 on without an overrun."""

    def stands(self, count, number):
        return [*range(5), *range(1, count)] if number == 1 else None


def measured(folder, *, program=Program, signals="", setups=SETUPS, faults=()):
    """Return the session of a survey there and back, and the codes of what it found, remarks left
    out."""
    drive = program(loose(), back=True, faults=faults)
    for setup in setups:
        drive.drive(setup)
    session, found = recorded(
        folder,
        survey_file(back=True, setups=setups, signals=signals),
        drive.events(),
        Nowhere(),
    )
    return session, {each.code for each in found if each.severity != "info"}


def backlash(session):
    return solve(tabulate(session.survey, session.book.passes), chain="FXYZ").backlash


@pytest.mark.parametrize(
    ("program", "signals"),
    spread(
        [
            pytest.param(program, signals, id=f"{program.__name__}-{name}")
            for program in (TurningRound, TurningTwice)
            for name, signals in (("counted", COUNTED), ("stopped", STOPPED))
        ],
        3,
    ),
)
def test_who_turns_round_at_a_stop_has_each_axis_on_its_side_until_it_moves(
    tmp_path, program, signals
):
    """Taken as a way back, the first stops give half of the true backlash, with a u of a tenth of
    it."""
    session, codes = measured(tmp_path, program=program, signals=signals)
    assert session.book.complete(), session.book.doubts()
    assert codes - {"signals-absent"} == {"turned-round"}
    found = backlash(session)
    for axis, told in (("X", found.X), ("Y", found.Y), ("Z", found.Z)):
        assert abs(told.value - PLAY_UM[f"E{axis}{axis}"]) < 2.0 * told.u < 1.5


def test_who_goes_beyond_the_stop_and_comes_back_says_nothing(tmp_path):
    session, codes = measured(tmp_path, setups=("ppp",))
    assert session.book.complete()
    assert codes == set()


def test_the_end_of_a_pass_leaves_its_readings_to_whoever_looks(tmp_path, monkeypatch):
    """While the answer to its last stop waits nothing is worked out for display; the page has the
    readings of the pass afterwards."""
    followed, original = [], Strip.follow
    monkeypatch.setattr(
        Strip, "follow", lambda strip, stream: followed.append(1) or original(strip, stream)
    )
    session, _ = measured(tmp_path, setups=("ppp",))
    assert not session.recording
    assert not followed
    assert len(session.strip.bins) > 10


@pytest.mark.parametrize(
    ("kind", "code", "text"),
    [
        ("unsignalled", "stop-recovered", "found in the laser"),
        ("skipped", "stop-lost", "missing"),
    ],
    ids=["unseen", "not-driven"],
)
@pytest.mark.parametrize("signals", ["", COUNTED], ids=["all", "counted"])
def test_the_first_stop_of_the_way_back_is_not_the_last_one_of_the_way_out(
    tmp_path, kind, code, text, signals
):
    """The machine came back to it from the other side: it is taken from the laser and doubted, or
    asked for."""
    session, codes = measured(
        tmp_path, setups=("ppp",), signals=signals, faults=[Fault(kind, "ppp", 2, 0)]
    )
    out, back = session.book.passes
    assert out.complete
    assert not back.complete
    assert code in codes
    assert "stops 1" in str(back.why_incomplete())
    assert text in str(back.why_incomplete())


@pytest.mark.parametrize("signals", ["", COUNTED, STOPPED], ids=["all", "counted", "stopped"])
def test_what_is_driven_again_without_an_overrun_is_doubted_until_every_axis_has_moved(
    tmp_path, signals
):
    """Stop 1 was come to from beyond by X, Y and Z: Y moves to stop 2, Z to stop 3, X to stop 4."""
    session, _ = measured(tmp_path, program=GoingBack, setups=("ppp",), signals=signals)
    out = session.book.passes[0]
    assert out.whole
    assert [doubt.stop for doubt in out.open_doubts() if doubt.code == "other-side"] == [
        1,
        2,
        3,
    ]


def test_the_turn_joins_no_counts_and_says_its_side_whatever_becomes_of_the_way_out(tmp_path):
    """Its axes stood on the other side: measured again, it differs by the backlash, which is no
    slip and no loss of the count."""
    session, _ = measured(tmp_path, program=TurningRound, setups=("ppp",))
    out, back = (list(each.chosen().values()) for each in session.book.passes)
    apart = structs.replace(back[0], turned=False, reading_mm=back[0].reading_mm - 0.004)
    unseen = structs.replace(
        back[1],
        unwatched="nobody looked",
        doubts=(Remark("stop-doubtful", "so the way back is driven again"),),
    )
    book = PassBook(session.survey)
    book.add_all(
        [
            *out,
            back[0],
            unseen,
            *back[2:],
            apart,
            *(structs.replace(stop, unwatched="") for stop in back[1:]),
        ]
    )
    readings = tabulate(session.survey, book.passes)
    assert len(set(readings.zero.tolist())) == 2, (
        "what was driven again has a zero of its own"
    )
    assert "reading-differs" not in {each.code for each in book.news()}
    kept = tabulate(session.survey, session.book.passes[1:])
    assert kept.turned.tolist() == [True, *[False] * (len(back) - 1)]
    assert render_readings(kept).splitlines()[0].endswith(",turned")
    assert (
        parse_readings(render_readings(kept), "readings.csv").turned.tolist()
        == kept.turned.tolist()
    )
