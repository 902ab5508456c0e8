"""Verify judges: files that were mistaken for others are named as what they are, on every control
that can hold them."""

from dataclasses import replace
from datetime import date

import msgspec
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from stepdiag.base.compensation import stated
from stepdiag.base.result.result import ROTATIONS, Result
from stepdiag.exporters.profiles.registry import CONTROLLERS, controller_named
from stepdiag.exporters.safety.standing import Standing
from stepdiag.exporters.safety.verdicts.case import TableCase
from stepdiag.exporters.safety.verdicts.judge import judge
from stepdiag.exporters.safety.verdicts.verdict import Judgement
from stepdiag.exporters.safety.verify import Verification, verify_files
from stepdiag.exporters.tables import lattice
from stepdiag.exporters.tables.curves import FUNCTIONS, Curve
from stepdiag.exporters.tables.fit import fitted
from stepdiag.exporters.tables.profile import Profile
from stepdiag.exporters.tables.tables import Law, Multiplier, Table, correction_um, joined
from testkit.exact.machines import profile_of
from testkit.exact.results import VOLUME, made_result
from testkit.examples import few

ERRORS = {
    "EXX": [0, 3, 8, 12, 20],
    "EYY": [0, -9, -5, -12, -19],
    "EZZ": [0, 6, -4, 5, 9],
    "EYX": [0, 5, 8, 4, 0],
    "EZX": [0, -6, 2, 5, 0],
    "EXY": [0, 4, -6, 3, 0],
    "EZY": [0, 2, 7, 1, 0],
    "EXZ": [0, -5, 1, 6, 0],
    "EYZ": [0, 3, -3, 6, 0],
}
RESULT = made_result(ERRORS, squareness={"C0Y": 15.0, "B0Z": -12.0, "A0Z": 11.0}, u_um=0.1)


def tables_of(
    name: str = "siemens", result: Result = RESULT, profile: Profile | None = None
) -> tuple[list[Table], Profile]:
    profile = profile or profile_of(name, VOLUME, sections=8)
    curves = fitted(result, profile.machine.functions, profile.machine.squareness_into).curves
    plan = controller_named(name).plan(curves, profile)
    return list(plan.tables), replace(profile, options=plan.options or profile.options)


def judged_as(
    result: Result, tables: list[Table], old: list[Table], profile: Profile
) -> tuple[Judgement, ...]:
    """The verdicts on tables that take the place of old ones, which were active while measuring
    where there are any."""
    machine = msgspec.structs.replace(profile.machine, measured_with="on" if old else "off")
    return judge(
        result,
        tables,
        Standing(before=tuple(old), after=tuple(tables), new=tuple(tables)),
        replace(profile, machine=machine),
    )


def codes(tables: list[Table], profile: Profile, result: Result = RESULT) -> set[str]:
    return {each.code for each in judged_as(result, tables, [], profile)}


def changed(tables: list[Table], name: str, **changes: object) -> list[Table]:
    return [replace(table, **changes) if table.name == name else table for table in tables]


def verdict_on(
    name: str, tables: list[Table], profile: Profile, result: Result = RESULT
) -> str:
    by_name = {each.function: each for each in judged_as(result, tables, [], profile)}
    others = {each.code for key, each in by_name.items() if key != name}
    assert others <= {"right"}, others
    return by_name[name].code


@pytest.mark.parametrize("name", sorted(CONTROLLERS))
@pytest.mark.parametrize("fold", [{}, {"C0Y": "EYX", "B0Z": "EZX", "A0Z": "EZY"}])
def test_what_an_export_writes_is_right(name, fold):
    """On every control, squareness in either function, read back from the bytes."""
    profile = profile_of(name, VOLUME, sections=8)
    profile = replace(
        profile,
        machine=msgspec.structs.replace(
            profile.machine, squareness_into=profile.machine.squareness_into | fold
        ),
    )
    tables, settled = tables_of(name, profile=profile)
    files = [
        file for file in controller_named(name).render(tables, settled) if file.role == "data"
    ]
    found = verify_files(RESULT, files, settled)
    assert {each.code for each in found.judgements} == {"right"}
    assert found.right


@pytest.mark.parametrize("function", FUNCTIONS)
class TestMistakes:
    def test_sign_turned(self, function):
        tables, profile = tables_of()
        (table,) = (table for table in tables if table.name == function)
        assert (
            verdict_on(function, changed(tables, function, value_um=-table.value_um), profile)
            == "sign-turned"
        )

    @pytest.mark.parametrize("factor", [10.0, 0.1, 25.4, 2.5])
    def test_scaled(self, function, factor):
        tables, profile = tables_of()
        (table,) = (table for table in tables if table.name == function)
        wrong = changed(tables, function, value_um=factor * table.value_um)
        assert verdict_on(function, wrong, profile) == "scaled"
        judged = next(
            each
            for each in judged_as(RESULT, wrong, [], profile)
            if each.function == function
        )
        assert judged.factor == pytest.approx(factor, rel=0.2)

    def test_beside_the_volume(self, function):
        tables, profile = tables_of()
        (table,) = (table for table in tables if table.name == function)
        for shift in (250.0, 5000.0):
            assert (
                verdict_on(
                    function,
                    changed(tables, function, position_mm=table.position_mm + shift),
                    profile,
                )
                == "beside-volume"
            )

    def test_another_machines_table(self, function):
        tables, profile = tables_of()
        (table,) = (table for table in tables if table.name == function)
        waves = 12.0 * np.cos(np.linspace(0.0, 14.0, len(table.position_mm)))
        assert (
            verdict_on(function, changed(tables, function, value_um=waves), profile)
            == "unlike"
        )


@pytest.mark.parametrize(
    ("one", "other", "code"),
    [
        ("EYX", "EXY", "input-output-swapped"),
        ("EZX", "EXZ", "input-output-swapped"),
        ("EZY", "EYZ", "input-output-swapped"),
        ("EXX", "EYY", "axes-swapped"),
        ("EYX", "EZX", "axes-swapped"),
        ("EXZ", "EYZ", "axes-swapped"),
    ],
)
def test_two_functions_in_each_others_place(one, other, code):
    """Axis names mixed up: each table stands, with its own grid, where the other belongs."""
    tables, profile = tables_of()
    tables = [table for table in tables if table.name in (one, other)]
    swapped = [
        replace(table, input_axis=taken.input_axis, output_axis=taken.output_axis)
        for table, taken in zip(tables, tables[::-1], strict=True)
    ]
    assert codes(swapped, profile) == {code}


def test_a_table_for_the_encoder_that_is_not_in_use():
    tables, profile = tables_of()
    wrong = changed(tables, "EXX", place={"measuring system": 2, "axis": "AX1"})
    assert verdict_on("EXX", wrong, profile) == "wrong-measuring-system"


def test_zeros_alone_correct_nothing_and_harm_nothing():
    """Restore files of a control that held no table."""
    tables, profile = tables_of()
    assert codes(
        [replace(table, value_um=0.0 * table.value_um) for table in tables], profile
    ) == {"empty"}


def verified(tables: list[Table], profile: Profile, result: Result = RESULT) -> Verification:
    files = [
        file
        for file in controller_named(profile.machine.controller).render(tables, profile)
        if file.role == "data"
    ]
    return verify_files(result, files, profile)


WHOLE = ("fanuc", "mitsubishi")
"""Controls whose file holds the parameters of every axis."""


@pytest.mark.parametrize("name", sorted(CONTROLLERS))
def test_a_set_without_some_of_its_tables_is_not_right(name):
    """Left out as a file, or zeros in it: the control goes on without that correction, and the rest
    of the set promises it."""
    tables, profile = tables_of(name)
    for function in ("EXX", "EYY", "EZZ"):
        rest = [table for table in tables if table.name != function]
        zeros = changed(tables, function, value_um=np.zeros(9))
        for some in (zeros,) if name in WHOLE else (rest, zeros):
            found = verified(some, profile)
            assert {each.function for each in found.judgements if each.code == "missing"} == {
                function
            }
            assert not found.right
    assert verified(tables, profile).right


def test_the_cross_tables_of_a_set_forgotten():
    """EEC loaded, CEC not: six functions are missing; a profile that asks for three asks for no
    more."""
    tables, profile = tables_of()
    eec = [table for table in tables if table.kind == "eec"]
    found = verified(eec, profile)
    missing = {each.function for each in found.judgements if each.code == "missing"}
    assert missing == {"EYX", "EZX", "EXY", "EZY", "EXZ", "EYZ"}
    assert not found.right
    assert found.judgements[-1].as_json()["kind"] is None
    files = [
        file
        for file in controller_named("siemens").render(eec, profile)
        if file.role == "data"
    ]
    assert {
        each.function
        for each in verify_files(RESULT, files).judgements
        if each.code == "missing"
    } == missing
    few = replace(
        profile,
        machine=msgspec.structs.replace(profile.machine, functions=["EXX", "EYY", "EZZ"]),
    )
    assert verified(eec, few).right


def test_a_function_that_asks_for_nothing_is_not_missing():
    """A straightness below rounding, or below its own uncertainty, needs no table."""
    for small, u_um in (([0, 0.1, -0.1, 0.1, 0], 0.05), ([0, 1.0, -1.0, 1.0, 0], 1.0)):
        result = made_result(
            {**ERRORS, "EYX": small},
            squareness={"C0Y": 15.0, "B0Z": -12.0, "A0Z": 11.0},
            u_um=u_um,
        )
        tables, profile = tables_of(result=result)
        found = verified([table for table in tables if table.name != "EYX"], profile, result)
        assert "missing" not in {each.code for each in found.judgements}


@pytest.mark.parametrize("function", FUNCTIONS)
@few(8)
@given(off=st.floats(0.28, 0.39), sign=st.sampled_from([-1.0, 1.0]))
def test_a_table_too_large_or_too_small_by_a_third_is_scaled(function, off, sign):
    """On the way from 0.15 to 0.4 a table was right, and 0.7 of a correction leaves a third of the
    error."""
    tables, profile = tables_of()
    (table,) = (table for table in tables if table.name == function)
    wrong = changed(tables, function, value_um=(1.0 + sign * off) * table.value_um)
    assert verdict_on(function, wrong, profile) == "scaled"


@pytest.mark.parametrize("function", FUNCTIONS)
@few(8)
@given(point=st.integers(1, 7), off_um=st.floats(4.0, 6.0), sign=st.sampled_from([-1.0, 1.0]))
def test_one_point_that_is_off_is_found(function, point, off_um, sign):
    """A digit mistyped moves the rms little; the largest difference shows it, and where it is."""
    tables, profile = tables_of()
    (table,) = (table for table in tables if table.name == function)
    value = table.value_um.copy()
    value[point] += sign * off_um
    wrong = changed(tables, function, value_um=value)
    judged = next(
        each for each in judged_as(RESULT, wrong, [], profile) if each.function == function
    )
    assert not judged.harmless
    if judged.code == "unlike" and judged.largest_um is not None:
        assert judged.largest_um > 0.5 * off_um


def test_a_long_screw_does_not_hide_one_wrong_point():
    """100 µm along the travel are no excuse for 4.9 µm at one place; the sentence names it."""
    result = made_result({**ERRORS, "EXX": [0, 27, 52, 76, 100]}, u_um=0.1)
    tables, profile = tables_of(result=result)
    (table,) = (table for table in tables if table.name == "EXX")
    value = table.value_um.copy()
    value[3] += 4.9
    (judged,) = (
        each
        for each in judged_as(result, changed(tables, "EXX", value_um=value), [], profile)
        if each.function == "EXX"
    )
    assert judged.code == "unlike"
    assert judged.largest_um == pytest.approx(4.9, abs=1.5)
    assert f"X {table.position_mm[3]:g} mm" in judged.text


def test_what_the_result_does_not_identify_is_not_judged():
    tables, profile = tables_of()
    assert (
        verdict_on(
            "EYX",
            tables,
            profile,
            made_result(
                {**ERRORS, "EYX": None}, squareness={"C0Y": 15.0, "B0Z": -12.0, "A0Z": 11.0}
            ),
        )
        == "unidentified"
    )


def test_old_and_new_together_are_right_after_a_survey_with_the_old_one_active():
    """The result holds the residual; the new table holds old plus residual."""
    old, profile = tables_of(result=made_result({"EXX": [0, 3, 8, 12, 20]}))
    residual = made_result({"EXX": [0, 4, -3, 5, 6]})
    new = [
        replace(
            table,
            value_um=table.value_um
            + np.interp(table.position_mm, VOLUME.nodes_mm(0), [0, 4, -3, 5, 6])
            * (table.name == "EXX"),
        )
        for table in old
    ]
    judged = {each.function: each.code for each in judged_as(residual, new, old, profile)}
    assert judged["EXX"] == "right"
    assert {
        each.code for each in judged_as(residual, new, [], profile) if each.function == "EXX"
    } == {"unlike"}


@pytest.mark.parametrize(
    ("factor", "code"),
    [(1.0, "right"), (-1.0, "sign-turned"), (10.0, "scaled"), (0.1, "scaled")],
)
def test_products(factor, code):
    """A pitch of X lifts Z by x's angle times the lever along y: only a product of two tables holds
    it."""
    roll = np.array([0.0, 30.0, -20.0, 10.0, 40.0])
    result = made_result(ERRORS)
    result.errors["EAX"] = replace(
        result.errors["EXX"], value=roll, u=np.full(5, 0.1), unit="urad"
    )
    product = fitted(result).products[0]
    half = product.half_mm
    axis = "XYZ".index(product.by_axis)
    low, high = VOLUME.origin_mm[axis], VOLUME.origin_mm[axis] + VOLUME.size_mm[axis]
    lever = Multiplier(
        axis=product.by_axis,
        position_mm=np.array([low, high]),
        value=(np.array([low, high]) - product.middle_mm) / half,
    )
    (eyx,) = (table for table in tables_of()[0] if table.name == "EYX")
    table = replace(
        eyx,
        input_axis=product.input_axis,
        output_axis=product.output_axis,
        position_mm=product.position_mm,
        value_um=factor * product.value_um,
        multiplier=lever,
    )
    assert codes([table], profile_of("siemens", VOLUME), result) == {code}


@pytest.mark.parametrize(
    ("factor", "code"), [(1.0, "right"), (-1.0, "unlike"), (3.0, "scaled")]
)
def test_a_product_along_a_single_axis_is_judged_with_the_curve(factor, code):
    """Values times a lever along the same axis move the axis as a curve does: both together hold
    the request."""
    tables, profile = tables_of()
    (table,) = (table for table in tables if table.name == "EXX")
    at, ends = table.position_mm, table.position_mm[[0, -1]]
    lever = Multiplier(axis="X", position_mm=ends, value=np.array([0.5, 1.0]))
    share = 6.0 * np.sin(np.linspace(0.0, 3.0, len(at)))
    product = replace(table, value_um=factor * share, multiplier=lever)
    curve = replace(table, value_um=table.value_um - share * lever.at(at))
    assert codes([curve, product], profile) == {code}


def test_limits_are_applied_to_files_from_anywhere():
    """A file that is right but beyond the control's own limits is not to be loaded."""
    tables, profile = tables_of()
    profile = replace(
        profile, options=msgspec.structs.replace(profile.options, cec_tables_held=5)
    )
    files = [
        file
        for file in controller_named("siemens").render(tables, profile)
        if file.role == "data"
    ]
    found = verify_files(RESULT, files, profile)
    assert "control-full.tables" in {finding.key for finding in found.findings}
    assert not found.right


@pytest.mark.parametrize(
    ("factor", "code"),
    [
        (1.0, "right"),
        (0.0, "empty"),
        (-1.0, "sign-turned"),
        (10.0, "scaled"),
        (0.1, "scaled"),
    ],
)
def test_a_lattice_of_another_size_or_sign_is_named_in_every_function(factor, code):
    made = lattice.lattice_of(RESULT, 50.0)
    file = lattice.render(replace(made, vectors_um=factor * made.vectors_um))
    found = verify_files(RESULT, [file])
    assert {each.code for each in found.judgements} == {code}
    assert found.right == (code in ("right", "empty"))


def test_the_lattice_of_another_machine():
    other = made_result({name: values[::-1] for name, values in ERRORS.items()}, u_um=0.1)
    found = verify_files(RESULT, [lattice.render(lattice.lattice_of(other, 50.0))])
    assert "unlike" in {each.code for each in found.judgements}
    assert not found.right


ANGLES = {
    name: list(np.linspace(0.0, 1.0, 5) ** 2 * (9.0 if name[2] == "X" else -11.0))
    for name in ROTATIONS
}
TURNING = made_result(
    ERRORS, squareness={"C0Y": 15.0, "B0Z": -12.0, "A0Z": 11.0}, angles=ANGLES, u_um=0.1
)


class TestLattice:
    """A lattice is judged as the curves and products that it is made of."""

    def told(self, vectors, held=None, result=TURNING, profile=None):
        held = held or lattice.lattice_of(TURNING, 50.0)
        file = lattice.render(replace(held, vectors_um=vectors(held.vectors_um)))
        found = verify_files(result, [file], profile)
        return {each.function: each.code for each in found.judgements}, found

    def test_what_an_export_writes_is_right_function_by_function(self):
        codes, found = self.told(lambda v: v)
        assert set(FUNCTIONS) < set(codes)
        assert len(codes) > 9 + 3  # and products
        assert set(codes.values()) == {"right"}
        assert found.right
        assert found.judgements[0].as_json()["kind"] == "lattice"

    def test_turned_and_scaled(self):
        codes, found = self.told(lambda v: -v)
        assert {codes[name] for name in FUNCTIONS} == {"sign-turned"}
        assert not found.right
        codes, found = self.told(lambda v: 10.0 * v)
        assert {codes[name] for name in FUNCTIONS} == {"scaled"}
        assert not found.right

    def test_one_axis_turned_is_named_alone(self):
        codes, found = self.told(lambda v: v * [1.0, 1.0, -1.0])
        assert {
            name for name, code in codes.items() if code == "sign-turned" and "*" not in name
        } == {"EZZ", "EZX", "EZY"}
        assert {codes[name] for name in FUNCTIONS if name[1] != "Z"} == {"right"}
        assert not found.right

    def test_columns_swapped(self):
        codes, found = self.told(lambda v: v[..., [1, 0, 2]])
        assert {codes["EXX"], codes["EYY"]} <= {
            "axes-swapped",
            "input-output-swapped",
            "unlike",
        }
        assert codes["EZZ"] == "right"
        assert not found.right

    def test_one_that_was_active_gives_way(self):
        """Measured with half of it on, the whole of it is right: what it adds is what the survey
        asks for."""
        whole = lattice.lattice_of(TURNING, 50.0)
        half = lattice.render(replace(whole, vectors_um=whole.vectors_um / 2))
        halves = {name: [value / 2 for value in values] for name, values in ERRORS.items()}
        left = made_result(halves, squareness={"C0Y": 7.5, "B0Z": -6.0, "A0Z": 5.5}, u_um=0.1)
        said = stated("on", {half.name: half.data}, date(2026, 6, 1), "INI folder")
        profile = profile_of("linuxcnc", VOLUME, sections=8)
        machine = msgspec.structs.replace(profile.machine, measured_with="on")
        known = replace(profile, machine=machine, existing=(half,))
        plain = lattice.lattice_of(left, 50.0)
        held = replace(plain, vectors_um=plain.vectors_um + whole.vectors_um / 2)
        codes, found = self.told(lambda v: v, held, replace(left, survey=said.facts()), known)
        assert {codes[name] for name in FUNCTIONS} == {"right"}
        assert found.right
        codes, found = self.told(
            lambda v: v, plain, replace(left, survey=said.facts()), known
        )
        assert not found.right


def test_the_steps_of_a_table_that_acted_are_no_error_that_a_table_could_take_out():
    """Between two points a stepped table is off by up to a step: a residual measured there holds
    that, and the straight one does not."""
    grid, fine = np.linspace(0.0, 100.0, 5), np.linspace(0.0, 100.0, 41)
    law = Law(sense="as-error", between="stepped")
    active = Table(
        kind="test",
        input_axis="X",
        output_axis="X",
        position_mm=grid,
        value_um=np.array([0.0, 4.0, 6.0, 2.0, -2.0]),
        quantum_um=0.1,
        law=law,
        reference_mm=0.0,
    )
    smooth = Curve(
        name="EXX",
        position_mm=fine,
        forward_um=np.sin(fine / 20.0),
        u_um=0.0 * fine,
        parts=("EXX",),
    )
    steps = correction_um(active, fine) - correction_um(joined(active), fine)
    seen = replace(smooth, forward_um=smooth.forward_um + steps)
    assert np.max(np.abs(steps)) > 2.0
    case = TableCase(table=active, together=[active], before=[active], volume=VOLUME)
    assert case.unstepped(seen).forward_um == pytest.approx(smooth.forward_um, abs=1e-9)
    straight = joined(active)
    case = TableCase(table=straight, together=[straight], before=[straight], volume=VOLUME)
    assert case.unstepped(seen).forward_um == pytest.approx(seen.forward_um, abs=1e-12)
