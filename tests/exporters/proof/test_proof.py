"""The proof run: exact changes of readings, from a rig that shares no code with the product, judged
table by table."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from stepdiag.base.errors import DataError
from stepdiag.base.readings.readings import make_readings
from stepdiag.base.readings.runs import Plan, Run
from stepdiag.base.volume import Volume
from stepdiag.exporters.proof.judge import prove
from stepdiag.exporters.proof.plan import plan_proof
from stepdiag.exporters.tables.tables import Law, Table
from testkit.exact.results import made_result

SIZE = np.array([500.0, 400.0, 300.0])
VOLUME = Volume(origin_mm=(0.0, 0.0, 0.0), size_mm=tuple(SIZE), increments=10)
NAMES = ("EXX", "EYY", "EZZ", "EYX", "EZX", "EXY", "EZY", "EXZ", "EYZ")
SETUPS = ("ppp", "linear-x")
RESULT = made_result({}, volume=VOLUME)
ALL = dict.fromkeys(NAMES, 1.0)
CODES = {-1.0: "sign-turned", 0.0: "missing", 0.5: "scaled", 2.0: "scaled", 1.5: "scaled"}


def stops_mm(setup):
    """The commanded stops by contract 1: the steps of a diagonal go x, y, z."""
    if setup.startswith("linear"):
        return np.arange(11)[:, None] * SIZE / 10.0 * (np.array(list("xyz")) == setup[-1])
    counts = np.array([[(step + 2 - axis) // 3 for axis in range(3)] for step in range(31)])
    return np.where(np.array(list(setup)) == "n", 10 - counts, counts) * SIZE / 10.0


class Rig:
    """Curves of a machine in um at its nodes, and what a laser reads along a setup with shares of
    them in the control."""

    def __init__(self, seed, size_um=3.0):
        self.dice = np.random.default_rng((9, seed))
        along = np.linspace(0.0, 1.0, 11)
        self.values = {}
        for name in NAMES:
            waves = sum(
                self.dice.normal() * np.sin(np.pi * k * along + self.dice.uniform(0.0, np.pi))
                for k in (1, 2, 3, 4, 5)
            )
            self.values[name] = size_um / np.std(waves) * (waves - waves[0])

    def table(self, name, law=Law(sense="as-error")):  # noqa: B008 - a value that does not change
        axis = "XYZ".index(name[2])
        return Table(
            kind="eec" if name[1] == name[2] else "cec",
            input_axis=name[2],
            output_axis=name[1],
            position_mm=np.linspace(0.0, SIZE[axis], 11),
            value_um=self.values[name],
            quantum_um=0.1,
            law=law,
            reference_mm=0.0,
        )

    def tables(self):
        return [self.table(name) for name in NAMES]

    def readings(
        self, shares, *, repeats=2, noise_um=0.3, misses_um=0.0, swapped="", setups=SETUPS
    ):
        """Readings with ``shares`` of each curve taken out by the control; the mirror leans anew
        each time, and each move of an axis ends beside its target by a miss."""
        rows = []
        for setup in setups:
            out = stops_mm(setup)
            along = (out[-1] - out[0]) / np.linalg.norm(out[-1] - out[0])
            lean = 5e-4 * self.dice.normal(size=3) * (not setup.startswith("linear"))
            for number in range(1, 2 * repeats + 1):
                at = out if number % 2 else out[::-1]
                moves = np.cumsum(np.diff(at, axis=0, prepend=at[:1]) != 0.0, axis=0)
                misses = (
                    misses_um * self.dice.normal(size=at.shape) if misses_um else 0.0 * at
                )
                error = np.take_along_axis(misses, moves, axis=0)
                for name, values in self.values.items():
                    nodes = np.linspace(0.0, 1.0, 11)
                    moving, output = "XYZ".index(name[2]), "XYZ".index(name[1])
                    error[:, output] += np.interp(at[:, moving] / SIZE[moving], nodes, values)
                    if shares.get(name):
                        names = dict(zip(swapped, swapped[::-1], strict=True))
                        into, onto = (
                            "XYZ".index(names.get(axis, axis)) for axis in (name[2], name[1])
                        )
                        held = np.interp(
                            np.minimum(at[:, into], SIZE[moving]) / SIZE[moving],
                            nodes,
                            values,
                        )
                        error[:, onto] -= shares[name] * held
                across = lean - (lean @ along) * along
                read = (
                    at @ along
                    + 1e-3 * (error @ along)
                    + at @ across
                    + 1e-3 * noise_um * self.dice.normal(size=len(at))
                )
                rows += [
                    (setup, number, stop, place, value - read[0])
                    for stop, (place, value) in enumerate(zip(at, read, strict=True))
                ]
        setup, number, stop, place, value = zip(*rows, strict=True)
        return make_readings(
            setup=setup,
            pass_number=number,
            stop=stop,
            position_mm=np.array(place),
            reading_mm=value,
        )


@pytest.mark.parametrize("factor", [1.0, *CODES])
@pytest.mark.parametrize("names", [("EYY",), ("EZX",), ("EXX", "EYY", "EZZ"), NAMES])
def test_each_state_of_a_table_a_kind_and_all_is_named(names, factor):
    """Right tables stay; a turned, missing, half or doubled one is named with its factor, and the
    others are right."""
    rig = Rig(3)
    tables = rig.tables()
    found = prove(
        RESULT,
        rig.readings({}, repeats=1),
        rig.readings(ALL | dict.fromkeys(names, factor)),
        tables,
    )
    for each in found.tables:
        assert each.code == (
            CODES.get(factor, "right") if each.function in names else "right"
        )
        assert abs(each.factor - (factor if each.function in names else 1.0)) < 5.0 * each.u
    assert found.action == ("keep" if factor == 1.0 else "restore")


def test_two_axes_taken_for_each_other_are_named():
    rig = Rig(5)
    tables = rig.tables()
    found = prove(
        RESULT, rig.readings({}, repeats=1), rig.readings(ALL, swapped="XY"), tables
    )
    assert found.action == "restore"
    assert {each.code for each in found.tables if each.function != "EZZ"} == {"axes-swapped"}


def test_a_table_too_small_to_be_seen_is_not_decided_and_shown_with_its_number():
    """It stops nothing while the states that remain differ by less than U of the survey, 0.6 um
    here."""
    for size, noise_um, state in ((0.02, 0.3, "right"), (0.5, 3.0, "undecided")):
        rig = Rig(4)
        rig.values["EYX"] = size * rig.values["EYX"]
        found = prove(
            RESULT,
            rig.readings({}, repeats=1, noise_um=noise_um),
            rig.readings(ALL, noise_um=noise_um),
            rig.tables(),
        )
        (small,) = [each for each in found.tables if each.function == "EYX"]
        assert (small.code, small.state, found.action) == (
            None,
            state,
            {"right": "keep", "undecided": "undecided"}[state],
        )


def test_what_stays_open_names_the_setup_that_decides_it():
    """A small positioning error along z, which one diagonal and the line along x leave open: the
    line along z shows all of it."""
    rig = Rig(7)
    rig.values["EZZ"] = 0.2 * rig.values["EZZ"]
    known = replace(RESULT, errors={})
    every = (*SETUPS, "npp", "linear-z")
    before = rig.readings({}, repeats=1, setups=every)
    found = prove(known, before, rig.readings(ALL), rig.tables())
    assert (
        [each.function for each in found.tables if each.state == "undecided"],
        found.further,
    ) == (["EZZ"], ("linear-z",))
    more = prove(
        known, before, rig.readings(ALL, setups=(*SETUPS, *found.further)), rig.tables()
    )
    assert "EZZ" not in [each.function for each in more.tables if each.state != "right"]


def test_a_run_that_sees_nothing_of_a_table_does_not_keep_it():
    """A line alone, whoever takes the diagonal out of the run: all along and across other axes is
    open, and its setups are named."""
    rig = Rig(8)
    before = rig.readings({}, repeats=1, setups=(*SETUPS, "npp"))
    found = prove(RESULT, before, rig.readings(ALL, setups=("linear-x",)), rig.tables())
    states = {each.function: each.state for each in found.tables}
    assert states == {name: "right" if name == "EXX" else "undecided" for name in NAMES}
    assert found.action == "undecided"
    assert set(found.further) <= {"ppp", "npp"}
    assert found.further


def test_no_more_setups_are_named_than_show_what_is_open():
    """One diagonal shows all that a line leaves open; a line along y shows nothing along z, and is
    not named."""
    for others, named in ((("ppp", "npp", "pnp", "ppn", "linear-y"), 1), (("linear-y",), 1)):
        rig = Rig(8)
        before = rig.readings({}, repeats=1, setups=("linear-x", *others))
        found = prove(RESULT, before, rig.readings(ALL, setups=("linear-x",)), rig.tables())
        assert len(found.further) == named
    rig = Rig(8)
    both = ("linear-x", "linear-y")
    before = rig.readings({}, repeats=1, setups=(*both, "linear-z"))
    tables = [table for table in rig.tables() if table.name != "EZZ"]
    found = prove(RESULT, before, rig.readings(ALL, setups=both), tables)
    assert (found.action, found.further) == ("undecided", ())


def test_tables_that_acted_in_the_survey_count_as_replaced():
    """Old tables of 0.8 of the right size: the change is that from them to the new ones, and old
    ones left alone are no new ones."""
    rig = Rig(6)
    tables = rig.tables()
    old = [replace(table, value_um=0.8 * table.value_um) for table in tables]
    before = rig.readings(dict.fromkeys(NAMES, 0.8), repeats=1)
    assert prove(RESULT, before, rig.readings(ALL), tables, old).action == "keep"
    turned = prove(RESULT, before, rig.readings(ALL | {"EXX": -1.0}), tables, old)
    assert [each.function for each in turned.tables if each.code == "sign-turned"] == ["EXX"]


def test_a_run_along_other_stops_proves_nothing():
    rig = Rig(7)
    before, after = rig.readings({}), rig.readings({})
    with pytest.raises(DataError, match="the same stops"):
        prove(
            RESULT,
            replace(
                before, position_mm=before.position_mm + 20.0 * (before.stop[:, None] > 2)
            ),
            after,
            [rig.table("EXX")],
        )
    with pytest.raises(DataError, match="an effect on the readings"):
        prove(RESULT, before, after, [replace(rig.table("EXX"), value_um=np.zeros(11))])


@pytest.mark.parametrize("seed", [149, 225, 230, 326, 337, 399, 408])
def test_a_table_is_called_wrong_only_where_its_u_excludes_the_right_size(seed):
    """One diagonal, arrivals that miss by half the size of the tables. Of three of these runs a
    table was called scaled whose factor any sizes of the others make."""
    rig = Rig(seed)
    before, after = (
        rig.readings(shares, repeats=repeats, noise_um=0.2, misses_um=1.5, setups=("ppp",))
        for shares, repeats in (({}, 1), (ALL, 2))
    )
    found = prove(RESULT, before, after, rig.tables())
    wrong = [each for each in found.tables if each.state == "wrong"]
    assert all(abs(each.factor - 1.0) > 2.0 * each.u for each in wrong)
    assert not wrong or seed not in (326, 399, 408)


@settings(max_examples=25, deadline=None)
@given(
    seed=st.integers(100, 10_000),
    name=st.sampled_from(NAMES),
    factor=st.sampled_from([-1.0, 0.0, 0.5, 1.5, 2.0]),
)
def test_no_wrong_table_is_called_right(seed, name, factor):
    """Whatever the machine: a table with a fault is named or open, and the control is not kept."""
    rig = Rig(seed)
    found = prove(
        RESULT, rig.readings({}, repeats=1), rig.readings(ALL | {name: factor}), rig.tables()
    )
    (wrong,) = [each for each in found.tables if each.function == name]
    assert wrong.code != "right"
    assert found.action != "keep"


def test_the_plan_fills_ten_minutes_and_foresees_every_table():
    """The minutes hold the repeats, and more of them would not fit; every table is seen by more
    than its U."""
    rig = Rig(8)
    driven = Plan(volume=VOLUME, runs=tuple(Run(setup=setup) for setup in SETUPS))
    plan = plan_proof(RESULT, rig.readings({}, repeats=1), driven, rig.tables(), 10.0)
    assert plan.setups == SETUPS
    assert plan.minutes <= 10.0 < plan.minutes * (plan.repeats + 1) / plan.repeats
    assert [each.function for each in plan.foreseen] == list(NAMES)
    assert all(each.expanded_um < each.seen_um for each in plan.foreseen)
    once = replace(driven, runs=tuple(replace(run, alternate=True) for run in driven.runs))
    assert plan.repeats > 1, "another repeat would drive an order without readings"
    assert (
        plan_proof(RESULT, rig.readings({}, repeats=1), once, rig.tables(), 10.0).repeats == 1
    )
    lines, readings = replace(driven, runs=driven.runs[1:]), rig.readings({}, repeats=1)
    with pytest.raises(DataError, match="body diagonal"):
        plan_proof(RESULT, readings, lines, [rig.table("EXX")], 10.0)
