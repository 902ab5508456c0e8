"""The sign test: a bump that passes the checks, and the verdict from what a machine of either kind
does with it."""

import numpy as np
import pytest

from stepdiag.base.errors import DataError, SafetyError, UsageError
from stepdiag.base.readings.readings import Readings, make_readings
from stepdiag.exporters.files.control_file import ControlFile
from stepdiag.exporters.profiles.file import quick_profile
from stepdiag.exporters.profiles.registry import CONTROLLERS, controller_named
from stepdiag.exporters.safety.sign_run import from_readings, read_sign_run
from stepdiag.exporters.safety.sign_test import Bump, bump, verdict
from stepdiag.exporters.tables.tables import total_correction_um
from testkit.exact.machines import profile_of
from testkit.exact.results import VOLUME

POSITIONS = np.linspace(-200.0, 200.0, 41)


def siemens_bump() -> Bump:
    return bump(controller_named("siemens"), profile_of("siemens", VOLUME, sections=8), "EXX")


def moved_um(test: Bump) -> np.ndarray:
    """What a control that follows the stated law does to X along the run."""
    points = np.column_stack([POSITIONS, np.zeros(41), np.zeros(41)])
    return total_correction_um(test.tables, points)[:, 0]


class TestBump:
    @pytest.mark.parametrize("name", sorted(set(CONTROLLERS) - {"neutral"}))
    def test_moves_the_axis_as_the_stated_law_says_and_comes_back_to_zero(self, name):
        """controllers.md 11: 10 µm in error sense, zero at the reference and beyond the bump."""
        test = bump(controller_named(name), profile_of(name, VOLUME, sections=8), "EXX")
        moved = moved_um(test)
        assert test.expected_um == pytest.approx(-10.0, abs=test.tables[-1].quantum_um)
        assert moved[0] == pytest.approx(0.0, abs=1e-9)
        assert moved[-1] == pytest.approx(0.0, abs=1e-9)

    def test_is_gentle(self):
        """Flanks of 0.2 µm/mm at most: the slope check lets them pass."""
        table = siemens_bump().tables[0]
        assert (
            np.max(np.abs(np.diff(table.value_um) / np.diff(table.position_mm))) <= 0.2 + 1e-9
        )

    def test_lies_on_the_longer_side_of_the_reference(self):
        profile = profile_of("siemens", VOLUME, sections=8, reference_at=8)
        assert bump(controller_named("siemens"), profile, "EXX").top_mm < 200.0

    def test_five_points_on_one_side_are_enough(self):
        """One of them stays zero next to the reference; the bump is up between the third and the
        fourth, and back at the fifth."""
        test = bump(
            controller_named("siemens"),
            profile_of("siemens", VOLUME, sections=4, reference_at=0),
            "EXX",
        )
        assert [value != 0.0 for value in test.tables[0].value_um] == [
            False,
            False,
            True,
            True,
            False,
        ]

    def test_a_travel_that_is_too_short_is_refused(self):
        with pytest.raises(SafetyError) as refusal:
            bump(
                controller_named("siemens"),
                quick_profile(controller_named("siemens"), VOLUME, 200.0),
                "EXX",
            )
        assert refusal.value.code == "grid-unfit.bump"


class TestSlope:
    """LinuxCNC holds one number for a squareness: its test is a ramp."""

    def ramp(self) -> Bump:
        return bump(
            controller_named("linuxcnc"), profile_of("linuxcnc", VOLUME, sections=8), "EXY"
        )

    def moved_um(self, test: Bump) -> np.ndarray:
        points = np.column_stack([np.zeros(41), np.linspace(0.0, 400.0, 41), np.zeros(41)])
        return total_correction_um(test.tables, points)[:, 0]

    def test_moves_the_axis_at_the_far_end(self):
        test = self.ramp()
        assert ([table.kind for table in test.tables], test.top_mm, test.beyond_mm) == (
            ["matrixkins"],
            400.0,
            None,
        )
        assert test.expected_um == pytest.approx(-10.0, abs=1e-3)

    @pytest.mark.parametrize(("sign", "sense"), [(1, "as-compensation"), (-1, "as-error")])
    def test_tells_the_sense(self, sign, sense):
        test = self.ramp()
        shown = verdict(
            test, np.linspace(0.0, 400.0, 41), 0 * POSITIONS, 5.0 + sign * self.moved_um(test)
        )
        assert (shown.kind, shown.sense) == ("matrixkins", sense)

    @pytest.mark.parametrize(
        ("share", "cause"), [(10.0, "ten times"), (0.4, "diameters"), (25.4, "inch")]
    )
    @pytest.mark.parametrize("sign", [1, -1])
    def test_a_ramp_of_the_wrong_size_decides_nothing(self, share, cause, sign):
        test = self.ramp()
        shown = verdict(
            test,
            np.linspace(0.0, 400.0, 41),
            0 * POSITIONS,
            5.0 + sign * share * self.moved_um(test),
        )
        assert shown.sense is None
        assert cause in shown.text

    def test_a_control_without_a_table_for_it_says_so(self):
        with pytest.raises(UsageError, match="a function that this control has a table for"):
            bump(controller_named("fagor"), profile_of("fagor", VOLUME, sections=8), "EXY")


class TestVerdict:
    def test_a_control_that_does_as_stated(self):
        test = siemens_bump()
        shown = verdict(test, POSITIONS, 3.0 + 0 * POSITIONS, 3.0 + moved_um(test))
        assert shown.sense == "as-error"

    def test_a_control_with_the_opposite_sense(self):
        test = siemens_bump()
        shown = verdict(test, POSITIONS, 0 * POSITIONS, -moved_um(test))
        assert shown.sense == "as-compensation"
        assert "NOT as-error" in shown.text

    def test_a_table_that_is_not_active(self):
        test = siemens_bump()
        shown = verdict(test, POSITIONS, 0 * POSITIONS, 0.1 * np.sin(POSITIONS))
        assert shown.sense is None
        assert "not active" in shown.text

    def test_a_staircase_tells_that_the_control_adds_up(self):
        """controllers.md 11: absolute data read as increments do not come back to zero after the
        bump."""
        test = siemens_bump()
        shown = verdict(test, POSITIONS, 0 * POSITIONS, np.cumsum(moved_um(test)))
        assert shown.sense is None
        assert "incremental" in shown.text

    @pytest.mark.parametrize(
        ("share", "cause"),
        [
            (10.0, "ten times"),
            (0.1, "ten times"),
            (2.0, "diameters"),
            (0.5, "diameters"),
            (25.4, "inch"),
            (1 / 25.4, "not active"),
            (1000.0, "mm and µm"),
            (4.0, "check the detection unit"),
            (0.4, "diameters"),
        ],
    )
    @pytest.mark.parametrize("sign", [1, -1])
    def test_a_movement_of_the_wrong_size_decides_nothing_and_names_its_cause(
        self, share, cause, sign
    ):
        """Outside half to twice of what is expected the sense is not believed: something counts in
        other units."""
        test = siemens_bump()
        shown = verdict(test, POSITIONS, 0 * POSITIONS, sign * share * moved_um(test))
        assert shown.sense is None
        assert cause in shown.text

    @pytest.mark.parametrize(
        ("share", "sense"), [(0.6, "as-error"), (1.8, "as-error"), (-0.6, "as-compensation")]
    )
    def test_between_half_and_twice_the_sense_is_told(self, share, sense):
        test = siemens_bump()
        assert verdict(test, POSITIONS, 0 * POSITIONS, share * moved_um(test)).sense == sense

    def test_a_run_that_does_not_reach_the_bump_is_refused(self):
        with pytest.raises(DataError, match="drive the run over"):
            verdict(siemens_bump(), POSITIONS[:10], POSITIONS[:10], POSITIONS[:10])


def linear_run(actual_um: np.ndarray, setup: str = "linear-x") -> Readings:
    """Two passes, out and back, along X; readings count from the first stop of each pass."""
    place = np.concatenate([POSITIONS, POSITIONS[::-1]])
    actual = place + np.concatenate([actual_um, actual_um[::-1]]) / 1000
    first = np.repeat([actual[0], actual[41]], 41)
    return make_readings(
        setup=[setup] * 82,
        pass_number=np.repeat([1, 2], 41),
        stop=np.tile(np.arange(41), 2),
        position_mm=np.column_stack([place, np.zeros(82), np.zeros(82)]),
        reading_mm=actual - first,
    )


class TestRuns:
    def test_two_linear_runs_give_the_verdict(self):
        """The machine's own error (here a parabola) is in both runs and drops out."""
        test, own = siemens_bump(), 1e-4 * POSITIONS**2
        run = from_readings(linear_run(own), linear_run(own + moved_um(test)), "X")
        shown = verdict(test, *run[:3])
        assert (shown.sense, shown.moved_um) == ("as-error", pytest.approx(-10.0))

    def test_runs_at_other_positions_are_refused(self):
        off = linear_run(0 * POSITIONS)
        with pytest.raises(DataError, match="same commanded positions"):
            from_readings(off, off.select(range(30)), "X")

    def test_a_missing_run_is_refused_by_its_name(self):
        off = linear_run(0 * POSITIONS)
        with pytest.raises(
            DataError, match="table on: expected a run linear-x, found linear-y"
        ):
            from_readings(off, linear_run(0 * POSITIONS, "linear-y"), "X")

    def test_a_csv_serves_for_cross_tables(self):
        """Straightness is seen with a dial or a straightness laser: position, off, on."""
        rows = "position_mm,off_um,on_um\n200,1,1\n-200,0,0\n0,2,-8\n"
        run = read_sign_run(ControlFile(name="run.csv", data=rows.encode()))
        assert [column.tolist() for column in run[:3]] == [
            [-200, 0, 200],
            [0, 2, 1],
            [0, -8, 1],
        ]

    @pytest.mark.parametrize(
        "text",
        [
            "",
            "a,b,c\n",
            "position_mm,off_um,on_um\n1,2\n",
            "position_mm,off_um,on_um\n1,2,x\n",
        ],
    )
    def test_a_damaged_csv_is_refused(self, text):
        with pytest.raises(DataError, match=r"run\.csv"):
            read_sign_run(ControlFile(name="run.csv", data=text.encode()))
