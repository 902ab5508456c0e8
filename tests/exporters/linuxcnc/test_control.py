"""LinuxCNC files: the worked example, what the control's reader would make of a file, squareness,
inches."""

from dataclasses import replace
from datetime import date

import msgspec
import numpy as np
import pytest

from stepdiag.base.compensation import stated
from stepdiag.base.errors import DataError, SafetyError, UsageError
from stepdiag.exporters.export.export import export
from stepdiag.exporters.files.control_file import ControlFile
from stepdiag.exporters.linuxcnc.control import LinuxCnc
from stepdiag.exporters.safety.verify import verify_files
from stepdiag.exporters.tables.curves import FUNCTIONS, curves_of
from stepdiag.exporters.tables.fit import fitted
from stepdiag.exporters.tables.merge import merged
from stepdiag.exporters.tables.profile import Profile
from stepdiag.exporters.tables.tables import correction_um, total_correction_um
from testkit.exact.machines import profile_of
from testkit.exact.results import VOLUME, made_result

LINUXCNC = LinuxCnc()
EXAMPLE = [4.0, 1.0, 0.0, -2.0, -5.0]
"""controllers.md 12: e of X at -200 .. 200 mm in um, zero at the reference."""


def files_of(result, profile, names=FUNCTIONS):
    plan = LINUXCNC.plan(curves_of(result, names), profile)
    return {
        file.name: file.data.decode() for file in LINUXCNC.render(plan.tables, profile)
    }, plan


def example_profile(**machine):
    profile = profile_of("linuxcnc", VOLUME, reference_at=2)
    return replace(profile, machine=msgspec.structs.replace(profile.machine, **machine))


def test_worked_example():
    """controllers.md 12.4: the actual positions forward and in reverse, nothing else in the
    file."""
    files, _ = files_of(made_result({"EXX": EXAMPLE}), example_profile(), ["EXX"])
    assert files["screw_x.comp"] == (
        "-200.0 -199.996 -199.996\n-100.0 -99.999 -99.999\n0.0 0.0 0.0\n100.0 99.998 "
        "99.998\n200.0 199.995 199.995\n"
    )
    assert (
        files["ini_lines.txt"] == "[JOINT_0]\nCOMP_FILE = screw_x.comp\nCOMP_FILE_TYPE = 0\n"
    )


def test_two_directions_in_two_columns():
    """A reversal of 6 µm is 6 µm between the columns; zero at the reference in + (controllers.md
    5)."""
    result = made_result({"EXX": EXAMPLE}, reversal={"EXX": [-6.0] * 5})
    files, _ = files_of(result, example_profile(direction="both"), ["EXX"])
    rows = np.array(
        [line.split() for line in files["screw_x.comp"].splitlines()], dtype=float
    )
    np.testing.assert_allclose(rows[:, 2] - rows[:, 1], 0.006, atol=1e-9)
    assert rows[2, 1] == 0.0


def test_a_machine_in_inches_gets_inches():
    """[TRAJ]LINEAR_UNITS = inch: 100 mm is 3.937 in, and the law is the same after reading."""
    profile = example_profile(units="inch")
    files, _ = files_of(made_result({"EXX": EXAMPLE}), profile, ["EXX"])
    assert files["screw_x.comp"].splitlines()[3].startswith("3.937007874 3.93692")
    (table,) = LINUXCNC.parse(
        [ControlFile(name="screw_x.comp", data=files["screw_x.comp"].encode())], profile
    )
    assert correction_um(table, np.array([-200.0, 100.0, 200.0])) == pytest.approx(
        [-4.0, 2.0, 5.0], abs=0.02
    )


def test_a_function_that_holds_a_squareness_brings_its_partner():
    """C_xy turns Y in X and X in Y; EZX holds no squareness here."""
    fold = {"C0Y": "EXY", "B0Z": "EXZ", "A0Z": "EYZ"}
    assert LINUXCNC.paired(["EXY", "EZX"], fold) == ("EYX", "EZX", "EXY")


def test_squareness_becomes_coefficients_and_straightness_is_said_to_stay():
    """matrixkins: X_joint = C_xy * Y; dX = -C0Y y is taken back by C_xy = +C0Y (contract 1). The
    shape of EXY cannot be written."""
    result = made_result(
        {"EXY": [0.0, 3.0, 7.0, 3.0, 0.0]}, squareness={"C0Y": 20.0, "B0Z": 10.0, "A0Z": -5.0}
    )
    files, plan = files_of(result, example_profile())
    assert files["squareness.hal"].splitlines() == [
        "setp matrixkins.C_xy 0.000020000",
        "setp matrixkins.C_xz -0.000010000",
        "setp matrixkins.C_yz -0.000005000",
    ]
    assert (
        "stay in the machine (largest values): EYX 0.0 µm, EZX 0.0 µm, EXY 7.0 µm"
        in "".join(finding.text for finding in plan.findings)
    )
    tables = LINUXCNC.parse(
        [ControlFile(name="squareness.hal", data=files["squareness.hal"].encode())],
        example_profile(),
    )
    moved = {
        table.name: float(correction_um(table, np.array([400.0]))[0]) for table in tables
    }
    assert moved == pytest.approx({"EXY": 8.0, "EXZ": -4.0, "EYZ": -2.0})


@pytest.mark.parametrize(
    ("data", "message"),
    [
        (
            b"# compensation of X\n0 0 0\n1 1 1\n",
            r"screw_x\.comp: line 1: expected three numbers.*reading here and raises no alarm",
        ),
        (b"0 0 0\n10 10 10\nend\n", r"line 3: expected three numbers, found 'end'"),
        (b"0 0 0\n10 10\n", r"line 2: expected three numbers"),
        (b"0 0 0\n10 nan 10\n", r"line 2: expected three numbers"),
        (b"0 0 0\n0 0 0\n", r"line 2: expected a nominal position above 0, found 0"),
        (
            b"".join(b"%d %d %d\n" % (n, n, n) for n in range(257)),
            r"expected 2 to 256 rows, found 257",
        ),
        (b"0 0 0\n10 10 10.0", r"expected a line end after the last row"),
        (b"0 0 0\n", r"expected 2 to 256 rows, found 1"),
    ],
)
def test_what_the_control_would_read_in_part_is_refused(data, message):
    """baselines.md: a comment silently disables the rest, more than 256 rows or rows out of order
    are not applied as written."""
    with pytest.raises(DataError, match=message):
        LINUXCNC.parse([ControlFile(name="screw_x.comp", data=data)], example_profile())


@pytest.mark.parametrize("count", [2, 256])
def test_as_few_and_as_many_rows_as_the_control_takes_are_read(count):
    """emccomp: at most 256 entries a joint; two make a line."""
    data = b"".join(b"%d.0 %d.001 %d.001\n" % (n, n, n) for n in range(count))
    (table,) = LINUXCNC.parse(
        [ControlFile(name="screw_x.comp", data=data)], example_profile()
    )
    np.testing.assert_allclose(table.value_um, np.ones(count), atol=1e-6)


def test_the_shipped_sample_with_its_typing_error_reads_as_a_jump_of_0_2_inch():
    """configs/sim/screwcompX.dat (commit 5c41560): LinuxCNC loads the row -4 -4.2 without
    complaint; its slope must show."""
    sample = (
        b"-10 -10.001 -9.999\n-8 -8.001 -7.999\n-6 -6.002 -5.999\n-4 -4.2 -3.998\n-2 -2.003 "
        b"-1.998\n0 -0.003 0.002\n2 1.997 2.003\n"
    )
    tables = LINUXCNC.parse(
        [ControlFile(name="screwcompX.dat", data=sample)], example_profile(units="inch")
    )
    assert [(table.name, table.direction) for table in tables] == [("EXX", 1), ("EXX", -1)]
    slope_um_mm = np.abs(np.diff(tables[0].value_um) / np.diff(tables[0].position_mm))
    assert slope_um_mm.max() == pytest.approx(99.0)
    assert np.sort(slope_um_mm)[-3] < 1.0


def test_an_axis_without_joints_is_asked():
    """The mapping of axes to joints is the configuration's, not a guess."""
    profile = example_profile()
    without_x = replace(
        profile, options=msgspec.structs.replace(profile.options, joints={"Y": [1]})
    )
    with pytest.raises(UsageError, match=r"linuxcnc\.joints: expected the joints of X"):
        files_of(made_result({"EXX": EXAMPLE}), without_x, ["EXX"])


def test_hal_files_hold_coefficients_only():
    """A foreign HAL line is named; identity on the diagonal counts as no correction."""
    (table,) = LINUXCNC.parse(
        [ControlFile(name="m.hal", data=b"setp matrixkins.C_xx 1.0001\n# note\n")],
        example_profile(),
    )
    assert correction_um(table, np.array([100.0])) == pytest.approx([10.0])
    with pytest.raises(DataError, match=r"m\.hal: line 1: expected setp matrixkins"):
        LINUXCNC.parse(
            [ControlFile(name="m.hal", data=b"loadrt matrixkins\n")], example_profile()
        )
    with pytest.raises(DataError, match=r"m\.hal: line 1: expected a number"):
        LINUXCNC.parse(
            [ControlFile(name="m.hal", data=b"setp matrixkins.C_xy nan\n")], example_profile()
        )


class TestBacklash:
    """motion/control.c: half of BACKLASH is added moving in +, taken off moving in -, and nothing
    where a COMP_FILE is used."""

    def with_backlash(self, backlash_um: float | None, **changes: object) -> Profile:
        profile = profile_of("linuxcnc", VOLUME)
        axes = {
            letter: msgspec.structs.replace(axis, backlash_um=backlash_um)
            for letter, axis in profile.axes.items()
        }
        return replace(
            profile,
            axes=axes,
            machine=msgspec.structs.replace(profile.machine, functions=["EXX"], **changes),
        )

    def columns_um(
        self, profile: Profile, values: list[float]
    ) -> tuple[np.ndarray, np.ndarray]:
        """What the motor is moved by in + and in -, read back from the file."""
        control = LINUXCNC
        tables = control.plan(
            curves_of(made_result({"EXX": values}), ["EXX"]), profile
        ).tables
        read = control.parse(
            [file for file in control.render(tables, profile) if file.role == "data"], profile
        )
        points = np.column_stack([VOLUME.nodes_mm(0), np.zeros((5, 2))])
        return tuple(total_correction_um(read, points, way)[:, 0] for way in (1, -1))

    def test_each_column_takes_half_of_it(self):
        forward, reverse = self.columns_um(self.with_backlash(8.0), [0, 3, 8, 12, 20])
        np.testing.assert_allclose(forward, [4, 1, -4, -8, -16], atol=1e-6)
        np.testing.assert_allclose(reverse, [-4, -7, -12, -16, -24], atol=1e-6)

    def test_no_backlash_needs_no_second_column(self):
        forward, reverse = self.columns_um(self.with_backlash(0.0), [0, 3, 8, 12, 20])
        np.testing.assert_array_equal(forward, reverse)

    def test_an_export_is_refused_while_nobody_says_what_it_is(self, tmp_path):
        with pytest.raises(SafetyError) as refusal:
            export(
                made_result({"EXX": [0, 3, 8, 12, 20]}),
                "linuxcnc",
                self.with_backlash(None),
                out_dir=tmp_path / "out",
            )
        assert refusal.value.code == "profile-incomplete.backlash"
        assert not (tmp_path / "out").exists()

    def test_a_machine_that_errs_differently_each_way_keeps_both(self, tmp_path):
        """Backlash in the columns and measured reversal add up, and neither refuses the other:
        BACKLASH does not act any more."""
        result = made_result({"EXX": [0, 3, 8, 12, 20]}, reversal={"EXX": [0, 2, 2, 2, 2]})
        report = export(
            result,
            "linuxcnc",
            self.with_backlash(8.0, direction="both"),
            out_dir=tmp_path / "out",
        )
        forward, reverse = report.tables
        np.testing.assert_allclose(
            reverse.value_um - forward.value_um, [8, 6, 6, 6, 6], atol=1e-6
        )

    def test_a_second_survey_with_the_file_active_adds_the_residual_to_its_columns(
        self, tmp_path
    ):
        """BACKLASH was off already: its half is in the old columns, and stays there once."""
        first = self.with_backlash(8.0)
        files = LINUXCNC.render(
            LINUXCNC.plan(
                curves_of(made_result({"EXX": [0, 3, 8, 12, 20]}), ["EXX"]), first
            ).tables,
            first,
        )
        again = self.with_backlash(8.0, direction="both", measured_with="on")
        again = replace(again, existing=tuple(file for file in files if file.role == "data"))
        statement = stated(
            "on",
            {file.name: file.data for file in again.existing},
            date(2026, 5, 30),
            "copied from the machine",
        )
        residual = replace(made_result({"EXX": [0, 1, 1, 1, 1]}), survey=statement.facts())
        report = export(residual, "linuxcnc", again, out_dir=tmp_path / "out")
        points = np.column_stack([VOLUME.nodes_mm(0), np.zeros((5, 2))])
        forward, reverse = (
            total_correction_um(report.tables, points, way)[:, 0] for way in (1, -1)
        )
        np.testing.assert_allclose(forward, [4, 0, -5, -9, -17], atol=1e-6)
        np.testing.assert_allclose(reverse, [-4, -8, -13, -17, -25], atol=1e-6)

    def test_a_file_whose_columns_are_alike_has_switched_backlash_off_too(self, tmp_path):
        """BACKLASH of 8 µm stands in the INI file and did nothing while measuring: no half of it
        goes into the columns."""
        old = ControlFile(
            name="screw_x.comp", data=b"-200.0 -199.99 -199.99\n200.0 200.01 200.01\n"
        )
        profile = replace(self.with_backlash(8.0, measured_with="on"), existing=(old,))
        statement = stated(
            "on", {old.name: old.data}, date(2026, 5, 30), "copied from the machine"
        )
        residual = replace(made_result({"EXX": [0, 1, 1, 1, 1]}), survey=statement.facts())
        report = export(residual, "linuxcnc", profile, out_dir=tmp_path / "out")
        points = np.column_stack([VOLUME.nodes_mm(0), np.zeros((5, 2))])
        forward, reverse = (
            total_correction_um(report.tables, points, way)[:, 0] for way in (1, -1)
        )
        np.testing.assert_array_equal(forward, reverse)
        np.testing.assert_allclose(forward, [-10, -11, -11, -11, -11], atol=1e-6)


def test_an_export_of_nothing_is_no_export(tmp_path):
    """Straightness alone has no place in LinuxCNC: a folder without a file for the control is not
    written."""
    with pytest.raises(SafetyError) as refused:
        export(
            made_result({"EYX": [0.0, 2.0, 3.0, 1.0, 0.0]}),
            "linuxcnc",
            example_profile(functions=["EYX"]),
            out_dir=tmp_path / "out",
        )
    assert refused.value.code == "nothing-to-write"
    assert "EYX" in str(refused.value)
    assert not (tmp_path / "out").exists()


def test_loaded_by_its_own_steps_the_second_coefficient_holds_the_first():
    """A person who adds the new coefficient to the old one by hand compensates twice: the steps say
    that it takes its place."""
    own = example_profile(measured_with="on", functions=["EYX", "EXY"])
    first = LINUXCNC.render(
        LINUXCNC.plan(
            curves_of(made_result({}, squareness={"C0Y": 20.0}), ["EYX", "EXY"]), own
        ).tables,
        own,
    )
    existing = tuple(file for file in first if file.role == "data")
    before = LINUXCNC.standing(existing, (), own)
    left = merged(
        curves_of(made_result({}, squareness={"C0Y": 1.0}), ["EYX", "EXY"]), before, own
    )
    held = replace(own, existing=existing)
    (table,) = LINUXCNC.plan(left, held).tables
    assert np.ptp(table.value_um) / np.ptp(table.position_mm) == pytest.approx(
        21e-3, abs=1e-5
    )
    steps = " ".join(LINUXCNC.instructions(held))
    assert "takes the place" in steps
    assert "add the new ones" not in steps


def test_an_old_function_that_is_written_once_more_is_listed_once(tmp_path):
    """EXY is asked for, its partner stands in the old coefficient C_yx and is kept as it was: not
    beside what the survey found of it."""
    old = ControlFile(name="squareness.hal", data=b"setp matrixkins.C_yx 0.000010000\n")
    profile = replace(example_profile(functions=["EXY"]), existing=(old,))
    found = made_result({"EYX": [0.0, 2.0, 3.0, 1.0, 0.0]}, squareness={"C0Y": 20.0})
    report = export(found, "linuxcnc", profile, out_dir=tmp_path / "out")
    heads = [
        line.split(" = ")[0]
        for line in report.text.splitlines()
        if line.startswith(("EXY = ", "EYX = "))
    ]
    assert sorted(heads) == sorted(set(heads))
    assert "EXY" in heads


LEANING = made_result(
    {"EXX": [0, 3, 8, 12, 20]}, squareness={"C0Y": 290.0, "B0Z": 0.0, "A0Z": 0.0}, u_um=0.1
)


def test_a_squareness_is_judged_over_the_travel_of_the_machine():
    """290 urad are 116 µm on 400 mm; one metre from the zero they were 290 µm, beyond what has to
    be accepted."""
    profile = profile_of("linuxcnc", VOLUME)
    plan = LINUXCNC.plan(
        fitted(LEANING, profile.machine.functions, profile.machine.squareness_into).curves,
        profile,
    )
    files = [file for file in LINUXCNC.render(plan.tables, profile) if file.role == "data"]
    found = verify_files(LEANING, files, profile)
    assert "value-large" not in {finding.key for finding in found.findings}
    assert found.right
    (lean,) = (table for table in found.tables if table.name == "EXY")
    assert lean.position_mm.tolist() == [
        VOLUME.origin_mm[1],
        VOLUME.origin_mm[1] + VOLUME.size_mm[1],
    ]


def test_no_squareness_file_where_the_control_has_no_matrixkins():
    """Debian's LinuxCNC has none: the file would be a promise that nothing keeps; `verify` does not
    miss it either."""
    profile = profile_of("linuxcnc", VOLUME)
    profile = replace(
        profile, options=msgspec.structs.replace(profile.options, matrixkins=False)
    )
    plan = LINUXCNC.plan(
        fitted(LEANING, profile.machine.functions, profile.machine.squareness_into).curves,
        profile,
    )
    assert {table.kind for table in plan.tables} == {"comp"}
    assert "function-left-out.matrixkins" in {finding.key for finding in plan.findings}
    files = [file for file in LINUXCNC.render(plan.tables, profile) if file.role == "data"]
    assert verify_files(LEANING, files, profile).right
