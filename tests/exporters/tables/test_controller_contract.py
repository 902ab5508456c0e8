"""One contract for every controller: what is written, read back and applied by the control's law
corrects the machine."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from stepdiag.base.errors import DataError, UsageError
from stepdiag.base.result.result import POSITIONING
from stepdiag.exporters.files.control_file import ControlFile
from stepdiag.exporters.profiles.registry import CONTROLLERS, controller_named
from stepdiag.exporters.tables.controller import Plan
from stepdiag.exporters.tables.curves import FUNCTIONS, Curve, curves_of
from stepdiag.exporters.tables.profile import Profile
from stepdiag.exporters.tables.sampling import sampled_um
from stepdiag.exporters.tables.tables import Table, correction_um
from testkit.exact.machines import MACHINES, profile_of
from testkit.exact.results import VOLUME, made_result
from testkit.examples import few

ROUNDING_UM = 1e-6
HALF_A_TENTH_UM_MM = 0.5001e-4
"""Positions are written to four places of a millimetre at least."""
values_um = st.lists(st.floats(-40, 40), min_size=5, max_size=5)
machine_errors = st.fixed_dictionaries(dict.fromkeys(FUNCTIONS, values_um))
reversals = st.fixed_dictionaries(dict.fromkeys(POSITIONING, values_um))


@pytest.mark.parametrize("name", sorted(CONTROLLERS))
class TestEveryController:
    """Runs over the registry: a new controller needs an entry in ``testkit.exact.machines`` and
    nothing here."""

    @few(6)
    @given(
        errors=machine_errors,
        reversal=reversals,
        squareness=st.floats(-60, 60),
        sections=st.integers(3, 9),
        data=st.data(),
    )
    def test_residual_is_at_most_half_a_unit_at_every_point(
        self, name, errors, reversal, squareness, sections, data
    ):
        """controllers.md 14: apply(parse(render(curve))) leaves half a unit at most, and no
        accumulated error at the far end."""
        direction = data.draw(st.sampled_from(MACHINES[name].directions))
        reference = data.draw(st.integers(0, sections))
        result = made_result(
            errors,
            reversal=reversal,
            squareness={"C0Y": squareness, "B0Z": -squareness, "A0Z": squareness / 2},
        )
        profile = profile_of(
            name, VOLUME, sections=sections, direction=direction, reference_at=reference
        )
        curves = curves_of(result, profile.machine.functions)
        plan, profile, files = written(name, curves, profile)
        read = controller_named(name).parse(files, profile)
        for curve in curves:
            if any(
                table.name == curve.name
                for table in plan.tables
                if _is_pointwise(table, curve, profile)
            ):
                assert_corrected(
                    curve, [table for table in read if table.name == curve.name], profile
                )

    @given(errors=machine_errors)
    @settings(max_examples=5)
    def test_reads_back_what_it_planned(self, name, errors):
        """Every planned table is in the files, with its grid, direction and values."""
        profile = profile_of(name, VOLUME)
        plan, profile, files = written(
            name, curves_of(made_result(errors), profile.machine.functions), profile
        )
        read = {
            (table.name, table.kind, table.direction): table
            for table in controller_named(name).parse(files, profile)
        }
        for table in plan.tables:
            back = read[table.name, table.kind, table.direction]
            for at in table.position_mm:
                here = np.array([at])
                assert correction_um(back, here) == pytest.approx(
                    correction_um(table, here), abs=table.quantum_um / 2 + ROUNDING_UM
                )

    def test_an_axis_that_goes_too_far_is_held_back(self, name):
        """The sign: with e > 0 growing along +X the correction at the far end moves X in -
        (controllers.md 0)."""
        profile = profile_of(name, VOLUME)
        result = made_result({"EXX": [0.0, 5.0, 10.0, 15.0, 20.0]})
        _, profile, files = written(
            name, curves_of(result, profile.machine.functions), profile
        )
        tables = [
            table
            for table in controller_named(name).parse(files, profile)
            if table.name == "EXX"
        ]
        assert sum(
            float(correction_um(table, np.array([200.0]))[0]) for table in tables
        ) == pytest.approx(-20.0, abs=1.0)

    def test_same_input_gives_the_same_bytes(self, name):
        """A replay must give the same files."""
        profile = profile_of(name, VOLUME)
        curves = curves_of(
            made_result({"EXX": [0.0, 1.0, 2.0, 3.0, 5.0]}), profile.machine.functions
        )
        assert written(name, curves, profile)[2] == written(name, curves, profile)[2]

    def test_the_order_of_the_files_says_nothing(self, name):
        """A folder may be read from either end; notes for people stand anywhere among the
        tables."""
        profile = profile_of(name, VOLUME)
        curves = curves_of(
            made_result({"EXX": [0.0, 1.0, 2.0, 3.0, 5.0], "EYY": [0.0, 4.0, 2.0, 1.0, 1.0]}),
            profile.machine.functions,
        )
        _, profile, files = written(name, curves, profile)
        there, back = (
            {table.label: table for table in controller_named(name).parse(read, profile)}
            for read in (files, files[::-1])
        )
        assert back.keys() == there.keys()
        for label, table in there.items():
            np.testing.assert_array_equal(back[label].value_um, table.value_um)

    def test_files_are_ascii_without_negative_zero(self, name):
        """A value that rounds to zero has no sign, and no locale enters."""
        profile = profile_of(name, VOLUME)
        curves = curves_of(
            made_result({name: [-1e-9] * 5 for name in FUNCTIONS}), profile.machine.functions
        )
        for file in written(name, curves, profile)[2]:
            assert file.data.isascii()
            assert b"-0.0000" not in file.data.replace(b"-0.00001", b"")

    @given(cut=st.floats(0.05, 0.95))
    @settings(max_examples=10)
    def test_a_truncated_file_never_gives_other_numbers(self, name, cut):
        """A cut file is refused, or what is left of it says the same as before; it is never read as
        something else."""
        profile = profile_of(name, VOLUME)
        curves = curves_of(
            made_result({"EXX": [0.0, 11.0, 7.0, 3.0, 5.0]}), profile.machine.functions
        )
        _, profile, files = written(name, curves, profile)
        controller = controller_named(name)
        whole = {table.label: table for table in controller.parse(files, profile)}
        first = replace(files[0], data=files[0].data[: int(len(files[0].data) * cut)])
        try:
            left = controller.parse([first], profile)
        except DataError:
            return
        for table in left:
            if table.label in whole:
                np.testing.assert_allclose(
                    table.value_um, whole[table.label].value_um[: len(table.value_um)]
                )

    @given(data=st.data())
    @few(20)
    def test_a_damaged_file_is_read_or_refused_and_nothing_else(self, name, data):
        """Whatever stands in a file, ``parse`` gives finite tables on ascending positions or a
        refusal of ours."""
        profile = profile_of(name, VOLUME)
        curves = curves_of(
            made_result({"EXX": [0.0, 11.0, 7.0, 3.0, 5.0]}), profile.machine.functions
        )
        _, profile, files = written(name, curves, profile)
        file = data.draw(st.sampled_from([file for file in files if file.role != "note"]))
        start = data.draw(st.integers(0, len(file.data)))
        end = data.draw(st.integers(start, min(len(file.data), start + 12)))
        new = data.draw(
            st.one_of(
                st.binary(max_size=4),
                st.sampled_from(
                    [b"\n", b"-", b"9", b"1e999", b"nan", b",", b" ", b"P", b"%"]
                ),
            )
        )
        try:
            tables = controller_named(name).parse(
                [replace(file, data=file.data[:start] + new + file.data[end:])], profile
            )
        except (DataError, UsageError):
            return
        for table in tables:
            assert np.isfinite(table.value_um).all()
            assert np.all(np.diff(table.position_mm) > 0)
            assert len(table.value_um) == len(table.position_mm) >= 2

    @pytest.mark.parametrize(
        "data", [b"", b"\x00\xff\x80", b"hello\nworld\n", b"<html></html>"]
    )
    def test_a_foreign_file_is_refused(self, name, data):
        """Garbage handed to ``verify`` or ``merge`` is a refusal of the data, never another
        exception."""
        with pytest.raises(DataError):
            controller_named(name).parse(
                [ControlFile(name="screw_x.comp", data=data)], profile_of(name, VOLUME)
            )

    def test_knows_its_own_files(self, name):
        """``verify`` finds the controller from the files alone."""
        profile = profile_of(name, VOLUME)
        _, _, files = written(
            name, curves_of(made_result(), profile.machine.functions), profile
        )
        for file in files:
            if file.role == "data":
                assert [
                    other for other in CONTROLLERS if CONTROLLERS[other].recognises(file)
                ] == [name]

    def test_report_rows_and_instructions_are_there(self, name):
        """What a person needs: the numbers of every table and the steps to load them."""
        profile = profile_of(name, VOLUME)
        controller = controller_named(name)
        plan = controller.plan(curves_of(made_result(), profile.machine.functions), profile)
        for table in (*plan.tables, *plan.listed):
            assert controller.readable(table, profile)
        assert len(controller.instructions(profile)) >= 3


def written(
    name: str, curves: tuple[Curve, ...], profile: Profile
) -> tuple[Plan, Profile, tuple[ControlFile, ...]]:
    """Plan and render, with the options that the plan settled."""
    controller = controller_named(name)
    plan = controller.plan(curves, profile)
    settled = replace(profile, options=plan.options or profile.options)
    return plan, settled, controller.render(plan.tables, settled)


def _is_pointwise(table: Table, curve: Curve, profile: Profile) -> bool:
    """Return whether the table has a value of its own at every point of the grid; four points or
    one slope have not."""
    return len(table.position_mm) == len(profile.grid_mm(curve.input_axis))


def assert_corrected(curve: Curve, tables: list[Table], profile: Profile) -> None:
    """At every point and in both directions, the error and the correction cancel to half a unit.

    A file that writes its positions rounds them too (a step of 400/7 mm); along a steep curve that
    shows as a thousandth of a unit.
    """
    grid, forward, reverse = sampled_um(curve, profile)
    moved_mm = max(np.max(np.abs(table.position_mm - grid)) for table in tables)
    assert moved_mm <= HALF_A_TENTH_UM_MM, (curve.name, moved_mm)
    for direction, error in ((1, forward), (-1, reverse)):
        left = error + sum(correction_um(table, grid, direction) for table in tables)
        steepest = np.max(np.abs(np.diff(error) / np.diff(grid)))
        half_a_unit = (
            max(table.quantum_um for table in tables) / 2 + steepest * moved_mm + ROUNDING_UM
        )
        assert np.max(np.abs(left)) <= half_a_unit, (curve.name, direction, left)
