"""The one door: what is written, under which names, and what stops it; every safety check by its
own code."""

import hashlib
from collections.abc import Sequence
from dataclasses import replace
from datetime import date
from functools import cache
from itertools import product
from pathlib import Path

import msgspec
import numpy as np
import pytest

from stepdiag.base.compensation import stated
from stepdiag.base.errors import DataError, SafetyError, UsageError
from stepdiag.base.findings import finding
from stepdiag.base.messages import message
from stepdiag.base.result.members import SetupReport
from stepdiag.base.result.result import Result
from stepdiag.base.volume import grid_points_mm
from stepdiag.exporters.export.export import MET_UM, export
from stepdiag.exporters.export.planning import _as_it_was
from stepdiag.exporters.files.control_file import ControlFile
from stepdiag.exporters.files.sets import read_given
from stepdiag.exporters.profiles.registry import CONTROLLERS, controller_named
from stepdiag.exporters.safety.checks import Case, run_checks
from stepdiag.exporters.safety.remarks import missed_um
from stepdiag.exporters.safety.verify import verify_files
from stepdiag.exporters.siemens.control import Siemens
from stepdiag.exporters.tables.controller import Limits
from stepdiag.exporters.tables.curves import curves_of
from stepdiag.exporters.tables.profile import Profile, SignTestRecord
from stepdiag.exporters.tables.tables import Table, correction_um
from stepdiag.solver.methods.solve import solve
from stepdiag.virtual.control.siemens import SiemensControl
from testkit.exact.beside import Beside
from testkit.exact.machines import MACHINES, profile_of
from testkit.exact.results import VOLUME, made_result
from testkit.exact.surveys import Bench
from testkit.examples import spread
from testkit.german import in_german

TODAY = date(2026, 6, 1)
IRREGULAR = (
    0.0,
    17.31,
    33.333,
    51.2,
    77.0,
    98.765,
    130.1,
    165.5,
    201.25,
    250.0,
    300.4,
    344.4,
    390.0,
    444.4,
    480.8,
    500.0,
)
ERRORS = {
    "EXX": [0, 3, 8, 12, 20],
    "EYY": [0, -2, -5, -7, -9],
    "EYX": [0, 1.5, 2, 1, 0],
    "EXZ": [0, -2, 1, 2, 0],
}
SQUARE = {"C0Y": 20.0, "B0Z": 8.0, "A0Z": -15.0}
RESULT = made_result(ERRORS, squareness=SQUARE)


def machine(**changes: object) -> Profile:
    """A Siemens profile with changes in [machine] and, by axis letter, in [axes]."""
    profile = profile_of("siemens", VOLUME)
    axes = {
        letter: msgspec.structs.replace(axis, **changes.pop(letter, {}))
        for letter, axis in profile.axes.items()
    }
    return replace(
        profile, machine=msgspec.structs.replace(profile.machine, **changes), axes=axes
    )


def with_sign_test(
    profile: Profile, day: date = date(2026, 5, 1), verdict: str = "as-error"
) -> Profile:
    """The profile with a sign test of both kinds of Siemens table."""
    about = {"machine": profile.machine.name, "control": "siemens", "measuring_system": "1"}
    files = {"bump_sha256": ["b" * 64], "runs_sha256": ["a" * 64]}
    records = [
        SignTestRecord(kind=kind, date=day, verdict=verdict, **about, **files)
        for kind in ("eec", "cec")
    ]
    return replace(profile, sign_tests=tuple(records))


def refusal_of(result, profile, tmp_path, **options) -> SafetyError:
    with pytest.raises(SafetyError) as refusal:
        export(result, "siemens", profile, out_dir=tmp_path / "out", today=TODAY, **options)
    assert not (tmp_path / "out").exists()
    in_german(refusal.value)
    return refusal.value


def noisy(result: Result, repeatability_um: float) -> Result:
    """The result of a survey whose stops repeat only to this."""
    return replace(
        result, setups={"ppp": SetupReport(passes=(1, 2), repeatability_um=repeatability_um)}
    )


def test_a_stretch_in_which_the_tables_harm_is_told_by_the_export_as_by_verify(tmp_path):
    """A bump narrower than the table's steps: flattened on the whole, with slopes beside it where
    the machine was right."""
    fine = replace(VOLUME, increments=8)
    bumped = made_result({"EXX": [0, 0, 0, 0, 9, 0, 0, 0, 0]}, volume=fine)
    report = export(bumped, "siemens", None, step_mm=100.0, out_dir=tmp_path)
    told = [item.text for item in report.findings if item.key == "stretch-worse"]
    assert [text.partition(":")[0] for text in told] == ["X -100 to -50 mm", "X 50 to 100 mm"]
    assert all(f"stretch-worse: {text}" in report.text for text in told)
    files = [
        tmp_path / name
        for name in report.files
        if name.endswith(".INI") and "RESTORE" not in name
    ]
    assert told == [
        item.text
        for item in verify_files(bumped, read_given(files)).findings
        if item.key == "stretch-worse"
    ]
    fitting = export(bumped, "siemens", None, step_mm=50.0, out_dir=tmp_path / "fine")
    assert not [item for item in fitting.findings if item.key == "stretch-worse"]


@cache
def measured_in(increments: int) -> Result:
    return solve(Bench(increments=increments).survey())


class TestQuickLook:
    @pytest.mark.parametrize("name", sorted(set(CONTROLLERS) - {"fanuc"}))
    def test_a_step_alone_suffices_and_the_files_mend_the_machine(self, name, tmp_path):
        """contract 5; verify tells the controller from the files alone and predicts the gain from
        their bytes."""
        report = export(RESULT, name, None, step_mm=50.0, out_dir=tmp_path)
        files = [
            tmp_path / file
            for file in report.files
            if "_RESTORE" not in file and "SHA" not in file and "REPORT" not in file
        ]
        found = verify_files(
            RESULT, [file for file in read_given(files) if CONTROLLERS[name].recognises(file)]
        )
        assert found.controller == name
        before, after = found.prediction.figures(rigid_motion=False)
        assert after.largest_um < 0.5 * before.largest_um

    def test_says_what_it_assumed(self, tmp_path):
        report = export(RESULT, "siemens", None, step_mm=50.0, out_dir=tmp_path)
        text = next(item.text for item in report.findings if item.key == "profile-assumed")
        assert "X = AX1 with its reference at -200 mm" in text
        assert "first measuring system" in text

    def test_writes_files_programs_restore_report_and_sums(self, tmp_path):
        report = export(RESULT, "siemens", None, step_mm=50.0, out_dir=tmp_path)
        stems = {"AX_EEC": "INI", "NC_CEC": "INI", "LOAD_EEC": "MPF", "LOAD_CEC": "MPF"}
        wanted = {
            f"{stem}{suffix}.{end}"
            for stem, end in stems.items()
            for suffix in ("_UNTESTED_SIGN", "_RESTORE")
        }
        assert set(report.files) == wanted | {
            "READ_BACK.MPF",
            "EXPORT_REPORT.txt",
            "SHA256SUMS",
        }
        assert sorted(path.name for path in tmp_path.iterdir()) == sorted(report.files)
        for line in (tmp_path / "SHA256SUMS").read_text(encoding="ascii").splitlines():
            digest, _, name = line.partition("  ")
            assert hashlib.sha256((tmp_path / name).read_bytes()).hexdigest() == digest

    def test_a_shape_without_scale_is_exported_with_a_loud_note(self, tmp_path):
        report = export(
            made_result(ERRORS, shape_only=["EXX"]),
            "siemens",
            None,
            step_mm=50.0,
            out_dir=tmp_path,
        )
        assert "EXX: the tables contain ONLY THE SHAPE" in report.text
        assert ("shape-only", "warning") in {
            (item.key, item.severity) for item in report.findings
        }

    @pytest.mark.parametrize(
        ("control", "increments"),
        spread(
            [
                *product(
                    ["siemens", "heidenhain", "beckhoff", "mitsubishi", "neutral", "lattice"],
                    [4, 7, 10, 24],
                )
            ],
            5,
        ),
    )
    def test_a_quick_look_has_its_points_where_the_errors_were_measured(
        self, control, increments, tmp_path
    ):
        """No step leaves less, and none of 50 mm less by a micrometre: the points of a table cut
        what lies beside them."""
        measured = measured_in(increments)
        left = {}
        for step in (None, 50.0, 12.5):
            report = export(
                measured,
                control,
                None,
                step_mm=step,
                accept=("slope-steep",),
                out_dir=tmp_path / f"{step}",
            )
            coarse = [item for item in report.findings if item.key == "step-coarse"]
            assert step is not None or coarse == []
            left[step] = (
                0.0
                if report.prediction is None
                else report.prediction.predicted.without_rigid_motion["after"].rms_um.value_um
            )
        assert left[None] <= min(left.values()) + 0.02

    @pytest.mark.parametrize(
        ("targets", "sections"), spread([(20, 20), (10, 10), (None, None)], 2)
    )
    def test_a_quick_look_meets_the_targets_of_a_run(self, targets, sections, tmp_path):
        """Finer than the diagonals', or irregular (ISO 230-2): the largest part of the increments
        that meets them."""
        own = None if targets is None else tuple(np.linspace(0.0, 500.0, targets + 1))
        measured = solve(
            Beside(
                bench=Bench(), u_um=0.1, targets_mm={"linear-x": own or IRREGULAR}
            ).readings()
        )
        report = export(
            measured, "neutral", None, accept=("slope-steep",), out_dir=tmp_path / "out"
        )
        (table,) = (each for each in report.tables if each.name == "EXX")
        assert sections is None or len(table.position_mm) - 1 == sections
        missed = missed_um(
            table.position_mm,
            measured.errors["EXX"].position_mm,
            measured.errors["EXX"].value,
        )
        coarse = missed_um(
            np.linspace(0.0, 500.0, 11),
            measured.errors["EXX"].position_mm,
            measured.errors["EXX"].value,
        )
        assert missed <= max(MET_UM, 0.5 * coarse)

    def test_a_lattice_of_axes_alone_is_refused(self, tmp_path):
        alone = solve(Beside(bench=Bench(), setups=("linear-x",), u_um=0.1).readings())
        with pytest.raises(DataError, match="a survey of the volume"):
            export(alone, "lattice", None, out_dir=tmp_path / "out")

    @pytest.mark.parametrize("step", [0.0, -5.0, float("nan"), float("inf")])
    def test_a_step_that_is_none_is_wrong_usage(self, step, tmp_path):
        with pytest.raises(UsageError, match="--step-mm"):
            export(RESULT, "siemens", None, step_mm=step, out_dir=tmp_path)

    def test_an_unknown_controller_meets_the_nearest_name(self, tmp_path):
        with pytest.raises(UsageError, match="did you mean siemens"):
            export(RESULT, "simens", None, step_mm=50.0, out_dir=tmp_path)


class TestFanuc:
    def test_without_a_master_the_readable_table_is_written_and_the_file_refused(
        self, tmp_path
    ):
        with pytest.raises(SafetyError) as refusal:
            export(RESULT, "fanuc", None, step_mm=50.0, out_dir=tmp_path)
        assert refusal.value.code == "template-missing"
        assert sorted(path.name for path in tmp_path.iterdir()) == [
            "EXPORT_REPORT.txt",
            "SHA256SUMS",
        ]
        text = (tmp_path / "EXPORT_REPORT.txt").read_text(encoding="utf-8")
        assert text.startswith("NO FILE FOR THE CONTROL WAS WRITTEN")
        assert "parameter 3620 A1 = 100" in text

    def test_restore_is_the_masters_own_bytes(self, tmp_path):
        report = export(
            RESULT, "fanuc", profile_of("fanuc", VOLUME), out_dir=tmp_path, today=TODAY
        )
        assert "PITCH_UNTESTED_SIGN.TXT" in report.files
        assert (tmp_path / "PITCH_RESTORE.TXT").read_bytes() == MACHINES["fanuc"].files[
            "PITCH.TXT"
        ]


class TestNothingIsWritten:
    @pytest.mark.parametrize("name", ["EXX", "EZY"])
    def test_for_a_function_that_is_not_identified(self, name, tmp_path):
        with pytest.raises(DataError, match=name):
            export(
                made_result({name: None}),
                "siemens",
                None,
                step_mm=50.0,
                out_dir=tmp_path / "out",
            )
        assert not (tmp_path / "out").exists()

    def test_over_other_bytes(self, tmp_path):
        """Nothing that exists is overwritten; the same export again is no harm."""
        export(RESULT, "siemens", None, step_mm=50.0, out_dir=tmp_path)
        export(RESULT, "siemens", None, step_mm=50.0, out_dir=tmp_path)
        before = {path.name: path.read_bytes() for path in tmp_path.iterdir()}
        with pytest.raises(UsageError, match="nothing is overwritten"):
            export(RESULT, "siemens", None, step_mm=100.0, out_dir=tmp_path)
        assert {path.name: path.read_bytes() for path in tmp_path.iterdir()} == before

    def test_into_a_file(self, tmp_path):
        (tmp_path / "out").write_text("in the way", encoding="ascii")
        with pytest.raises(UsageError, match="folder"):
            export(RESULT, "siemens", None, step_mm=50.0, out_dir=tmp_path / "out")


def coarse_said(report):
    return [finding.text for finding in report.findings if finding.key == "step-coarse"]


def test_a_table_that_does_not_stand_where_it_was_measured_says_what_it_leaves(tmp_path):
    """EXX 0 3 8 12 20 µm, nodes 100 mm apart, through every other of them: 4 instead of 3, 14
    instead of 12. On them, nothing is said."""
    wide = coarse_said(
        export(
            RESULT,
            "siemens",
            machine(X={"step_mm": 200.0}),
            out_dir=tmp_path / "wide",
            today=TODAY,
        )
    )
    assert len(wide) == 1
    assert (
        "at most EXX 2.0 µm, EYX 0.5 µm. Choose a step with points at the measured "
        "positions, or a smaller step" in wide[0]
    )
    for step_mm in (100.0, 50.0):
        fine = export(
            RESULT,
            "siemens",
            machine(X={"step_mm": step_mm}),
            out_dir=tmp_path / f"{step_mm:g}",
            today=TODAY,
        )
        assert not coarse_said(fine)


def test_a_fine_table_beside_the_measured_positions_says_so_too(tmp_path):
    """Points 80 mm apart cut the bends of nodes 100 mm apart: 9.6 and 13.6 µm at 40 and 120 mm make
    12.6 µm of the 12 at 100 mm."""
    beside = coarse_said(
        export(
            RESULT,
            "siemens",
            machine(X={"step_mm": 80.0}),
            out_dir=tmp_path / "tables",
            today=TODAY,
        )
    )
    assert "EXX 0.6 µm" in beside[0]


@pytest.mark.parametrize(("step_mm", "said"), [(40.0, True), (50.0, False), (25.0, False)])
def test_and_so_does_a_lattice(step_mm, said, tmp_path):
    bent = made_result({**ERRORS, "EXX": [0, 9, 24, 36, 60]})
    report = export(bent, "lattice", None, step_mm=step_mm, out_dir=tmp_path / "out")
    assert bool(coarse_said(report)) == said
    assert ("step-coarse" in (tmp_path / "out" / "EXPORT_REPORT.txt").read_text()) == said


class TestSignTest:
    def test_a_dated_test_takes_the_suffix_away(self, tmp_path):
        report = export(
            RESULT, "siemens", with_sign_test(machine()), out_dir=tmp_path, today=TODAY
        )
        assert "AX_EEC.INI" in report.files
        assert b"UNTESTED" not in (tmp_path / "AX_EEC.INI").read_bytes()

    def test_the_header_of_an_untested_file_says_so(self, tmp_path):
        export(RESULT, "siemens", machine(), out_dir=tmp_path, today=TODAY)
        assert (
            b"; UNTESTED SIGN (cec, eec)"
            in (tmp_path / "AX_EEC_UNTESTED_SIGN.INI").read_bytes()
        )

    @pytest.mark.parametrize("day", [date(2025, 5, 31), date(2026, 6, 2)])
    def test_a_test_of_more_than_twelve_months_ago_or_of_the_future_does_not_count(
        self, day, tmp_path
    ):
        report = export(
            RESULT, "siemens", with_sign_test(machine(), day), out_dir=tmp_path, today=TODAY
        )
        assert "AX_EEC_UNTESTED_SIGN.INI" in report.files

    def test_a_test_that_showed_the_other_sense_refuses(self, tmp_path):
        refusal = refusal_of(
            RESULT,
            with_sign_test(machine(), verdict="as-compensation"),
            tmp_path,
            accept=["sign-contradicted"],
        )
        assert refusal.code == "sign-contradicted"


class TestSafetyChecks:
    """controllers.md 10: an error refuses, a warning refuses until it is accepted by its code."""

    @pytest.mark.parametrize(
        ("code", "result", "changes"),
        [
            ("value-large", made_result({"EXX": [0, 60, 120, 180, 240]}), {}),
            ("slope-steep", made_result({"EXX": [0, 95, 0, 0, 0]}), {}),
            ("travel-not-covered", RESULT, {"X": {"travel_mm": (-250.0, 210.0)}}),
            ("correction-small.uncertainty", made_result({"EXX": [0, 0.1, 0.2, 0.1, 0]}), {}),
            ("correction-small.repeatability", noisy(RESULT, 15.0), {}),
            (
                "profile-incomplete.reversal",
                made_result(ERRORS, reversal={"EXX": [0, 2, 2, 2, 2]}),
                {"direction": "both"},
            ),
        ],
    )
    def test_a_warning_refuses_until_it_is_accepted(self, code, result, changes, tmp_path):
        assert refusal_of(result, machine(**changes), tmp_path).code == code
        report = export(
            result,
            "siemens",
            machine(**changes),
            out_dir=tmp_path / "out",
            accept=[code],
            today=TODAY,
        )
        assert code in {item.key for item in report.findings}

    @pytest.mark.parametrize(
        ("code", "result", "changes"),
        [
            ("value-large.limit", made_result({"EXX": [0, 105, 210, 315, 420]}), {}),
            ("units-not-metric", RESULT, {"units": "inch"}),
            ("profile-incomplete.name", RESULT, {"Y": {"name": "AX1"}}),
            ("grid-unfit.step", RESULT, {"X": {"step_mm": 60.0}}),
            (
                "direction-unfit.twice",
                made_result(reversal={"EXX": [0, 2, 2, 2, 2]}),
                {"direction": "both", "X": {"backlash_um": 3.0}},
            ),
            (
                "data-quality",
                made_result(
                    ERRORS,
                    findings=(
                        finding("error", message("beam-lost", why=message("beam-was-lost"))),
                    ),
                ),
                {},
            ),
        ],
    )
    def test_an_error_cannot_be_accepted(self, code, result, changes, tmp_path):
        assert (
            refusal_of(
                result,
                machine(**changes),
                tmp_path,
                accept=[code, "value-large", "slope-steep"],
            ).code
            == code
        )

    def test_more_points_than_the_control_holds(self, tmp_path):
        profile = machine()
        small = replace(
            profile, options=msgspec.structs.replace(profile.options, eec_points={"X": 4})
        )
        assert refusal_of(RESULT, small, tmp_path).code == "control-full.points"

    def test_all_refusals_are_named_at_once(self, tmp_path):
        refusal = refusal_of(
            made_result({"EXX": [0, 105, 210, 315, 420]}), machine(units="inch"), tmp_path
        )
        assert "the profile states inch [units-not-metric]" in str(refusal)
        assert "das Profil nennt aber inch [units-not-metric]" in in_german(refusal)


class TestChecksOnTables:
    """Faults that the planning cannot make are caught too: the checks do not trust it."""

    @pytest.mark.parametrize(
        ("code", "spoil"),
        [
            ("file-unsound.number", {"value_um": np.array([0, 1, np.nan, 0, 0])}),
            ("grid-unfit.order", {"position_mm": np.array([-200.0, -100, -100, 100, 200])}),
            ("reference-unfit.value", {"value_um": np.array([5.0, 5, 5, 5, 5])}),
        ],
    )
    def test_a_spoilt_table_is_found(self, code, spoil):
        profile = machine()
        (table,) = (
            controller_named("siemens").plan(curves_of(RESULT, ["EXX"]), profile).tables
        )
        assert code in {
            item.key for item in run_checks(case_of(profile, [replace(table, **spoil)]))
        }

    def test_a_step_from_point_to_point_that_the_control_cannot_hold(self):
        """TNC 306: neighbours differ by at most spacing / 64."""
        (table,) = (
            controller_named("siemens").plan(curves_of(RESULT, ["EXX"]), machine()).tables
        )
        assert codes_with_limits(table, Limits(neighbour_um_mm=0.07)) == {
            "slope-steep.neighbour"
        }
        assert codes_with_limits(table, Limits(neighbour_um=7.9)) == {"slope-steep.neighbour"}
        assert codes_with_limits(table, Limits(neighbour_um=0.0)) == {"slope-steep.neighbour"}
        assert (
            codes_with_limits(table, Limits(neighbour_um=8.0, neighbour_um_mm=0.08)) == set()
        )


def case_of(profile: Profile, tables: list[Table]) -> Case:
    curves = curves_of(RESULT, ["EXX"])
    control = controller_named("siemens")
    return Case(
        controller=control,
        profile=profile,
        result=RESULT,
        curves=curves,
        tables=tables,
        previous=(),
        today=TODAY,
    )


def codes_with_limits(table: Table, limits: Limits) -> set[str]:
    """The codes that the checks find where the control has these limits."""
    control = Siemens()
    limited = type(
        "Limited",
        (),
        {"name": control.name, "title": control.title, "limits": lambda *_: limits},
    )()
    return {
        item.key
        for item in run_checks(replace(case_of(machine(), [table]), controller=limited))
    }


OLD_TABLE = b"""\
%_N_AX_EEC_INI
CHANDATA(1)
$AA_ENC_COMP[0,0,AX1]=0.0000
$AA_ENC_COMP[0,1,AX1]=0.0100
$AA_ENC_COMP[0,2,AX1]=0.0200
$AA_ENC_COMP_STEP[0,AX1]=200
$AA_ENC_COMP_MIN[0,AX1]=-200
$AA_ENC_COMP_MAX[0,AX1]=200
$AA_ENC_COMP_IS_MODULO[0,AX1]=0
M17
"""
"""An EEC table of X that is a straight line from 0 to 20 um."""
CEC = (
    b"$AN_CEC[%(n)d,0]=0\n$AN_CEC[%(n)d,1]=0.002\n$AN_CEC_INPUT_AXIS[%(n)d]=(AX%(from)d)\n"
    b"$AN_CEC_OUTPUT_AXIS[%(n)d]=(AX%(to)d)\n"
    b"$AN_CEC_STEP[%(n)d]=400\n$AN_CEC_MIN[%(n)d]=-200\n$AN_CEC_MAX[%(n)d]=200\nM17\n"
)
"""A CEC table that is a straight line from 0 to 2 um."""


def left_um(old: bytes, folder: Path) -> float:
    """What a virtual control moves the tool by at most, after an export was loaded over an old
    file, in um."""
    control = SiemensControl()
    control.load(old.decode("ascii"))
    for path in sorted(folder.glob("LOAD_*_UNTESTED_SIGN.MPF")):
        control.load(path.read_text(encoding="ascii"))
    points = grid_points_mm(VOLUME, 5)
    return (
        float(
            np.max(
                np.abs(
                    sum(
                        table.correction_mm(points, np.ones(points.shape))
                        for table in control.tables()
                    )
                )
            )
        )
        * 1e3
    )


def measured_with(result: Result, active: Sequence[ControlFile]) -> Result:
    """The result of a survey that says what was active in the control."""
    statement = stated(
        "on", {file.name: file.data for file in active}, date(2026, 5, 30), "archive"
    )
    return replace(result, survey=statement.facts())


class TestActiveTables:
    def active(self, state: str) -> Profile:
        return replace(
            machine(measured_with=state),
            existing=(ControlFile(name="AX_EEC.INI", data=OLD_TABLE),),
        )

    def merged(self, out):
        profile = self.active("on")
        left = made_result({"EXX": [0, 1, 2, 3, 4]})
        return export(
            measured_with(left, profile.existing),
            "siemens",
            profile,
            out_dir=out,
            accept=["change-large"],
            today=TODAY,
        )

    def test_merging_adds_the_residual_to_an_as_error_table(self, tmp_path):
        """controllers.md 9: T_new = T_old + r, on the new grid, zero at the reference."""
        report = self.merged(tmp_path)
        table = next(table for table in report.tables if table.name == "EXX")
        np.testing.assert_allclose(
            table.value_um, [0, 5 + 1, 10 + 2, 15 + 3, 20 + 4], atol=0.05
        )

    def test_prediction_counts_the_change_only(self, tmp_path):
        """The residual was measured with the old table on: replacing it by old + residual leaves
        nothing."""
        report = self.merged(tmp_path)
        assert report.prediction is not None
        assert report.prediction.figures(rigid_motion=True)[1].largest_um < 0.2

    def test_restore_is_the_old_file(self, tmp_path):
        export(
            RESULT,
            "siemens",
            self.active("off"),
            out_dir=tmp_path,
            today=TODAY,
            accept=["change-large"],
        )
        assert (tmp_path / "AX_EEC_RESTORE.INI").read_bytes() == OLD_TABLE

    def test_a_large_change_has_to_be_accepted(self, tmp_path):
        big = made_result({"EXX": [0, -8, -16, -24, -32]})
        assert refusal_of(big, self.active("off"), tmp_path).code == "change-large"

    def test_an_old_table_under_another_number_is_emptied(self, tmp_path):
        """Two CEC tables on one output axis add up: the number that held the function before gets
        zeros."""
        old = OLD_TABLE.replace(b"\nM17\n", b"\n") + CEC % {b"n": 7, b"from": 1, b"to": 2}
        profile = replace(machine(), existing=(ControlFile(name="ALL.INI", data=old),))
        made = export(RESULT, "siemens", profile, out_dir=tmp_path / "out", today=TODAY)
        assert 7 in [
            table.place["table"]
            for table in made.tables
            if table.name == "EYX" and not table.value_um.any()
        ]
        assert left_um(old, tmp_path / "out") == pytest.approx(
            left_um(b"", tmp_path / "out"), abs=1e-6
        )

    def test_an_old_table_that_reached_beyond_the_travel_is_emptied_too(self, tmp_path):
        """Zeros move nothing wherever they stand, and what they take out would act beside the new
        table."""
        far = (
            (CEC % {b"n": 7, b"from": 1, b"to": 2})
            .replace(b"STEP[7]=400", b"STEP[7]=1000")
            .replace(b"MIN[7]=-200", b"MIN[7]=-2000")
        )
        far = far.replace(b"MAX[7]=200", b"MAX[7]=0").replace(
            b"$AN_CEC[7,1]=0.002\n", b"$AN_CEC[7,1]=0.002\n$AN_CEC[7,2]=0.003\n"
        )
        old = OLD_TABLE.replace(b"\nM17\n", b"\n") + far
        own = machine()
        axes = own.axes | {
            "X": msgspec.structs.replace(own.axes["X"], travel_mm=(-200.0, 200.0))
        }
        profile = replace(own, axes=axes, existing=(ControlFile(name="ALL.INI", data=old),))
        made = export(
            RESULT,
            "siemens",
            profile,
            out_dir=tmp_path / "out",
            today=TODAY,
            accept=["old-table-lost.ends"],
        )
        assert 7 in [
            table.place["table"]
            for table in made.tables
            if table.name == "EYX" and not table.value_um.any()
        ]
        assert left_um(old, tmp_path / "out") == pytest.approx(
            left_um(b"", tmp_path / "out"), abs=1e-6
        )

    def test_an_axis_that_goes_from_one_kind_of_table_to_another_keeps_no_old_one(
        self, tmp_path
    ):
        """Two directions go into CEC tables: the old EEC of X would act beside them, whatever
        becomes of the EEC of other axes."""
        both = made_result(
            {"EXX": [0, 5, 10, 15, 20], "EYY": [0, 1, 2, 3, 4]},
            reversal={"EXX": [3, 3, 3, 3, 3]},
        )
        made = export(
            both,
            "siemens",
            self.directional(),
            out_dir=tmp_path / "out",
            today=TODAY,
            accept=["change-large"],
        )
        assert [table.kind for table in made.tables if table.name == "EXX"] == [
            "cec",
            "cec",
            "eec",
        ]
        assert left_um(OLD_TABLE, tmp_path / "out") == pytest.approx(
            left_um(b"", tmp_path / "out"), abs=1e-6
        )

    def directional(self):
        active = self.active("off")
        axes = {
            letter: msgspec.structs.replace(axis, backlash_um=0.0)
            for letter, axis in active.axes.items()
        }
        return replace(
            active,
            machine=msgspec.structs.replace(active.machine, direction="both"),
            axes=axes,
        )

    def test_a_function_whose_place_another_one_takes_is_written_once_more(self, tmp_path):
        """Number 0 held what Z does to X; the new number 0 is what X does to Y, and X along Z goes
        on as it was."""
        old = b"CHANDATA(1)\n" + CEC % {b"n": 0, b"from": 3, b"to": 1}
        profile = replace(
            machine(functions=("EXX", "EYX")),
            existing=(ControlFile(name="NC_CEC.INI", data=old),),
        )
        made = export(RESULT, "siemens", profile, out_dir=tmp_path / "out", today=TODAY)
        (kept,) = (table for table in made.tables if table.name == "EXZ")
        np.testing.assert_allclose(kept.value_um, [0.0, 0.2, 0.5, 0.8, 1.0], atol=0.051)
        numbered = replace(
            profile, options=msgspec.structs.replace(profile.options, cec_tables={"EYX": [7]})
        )
        made = export(RESULT, "siemens", numbered, out_dir=tmp_path / "beside", today=TODAY)
        assert not [table for table in made.tables if table.name == "EXZ"]

    def test_an_old_product_does_not_go_on_beside_curves_that_hold_its_part(self, tmp_path):
        """Measured with the tables off and without angles: the new curve is that of mid-volume,
        where the product acts as well."""
        own = machine()
        linked = replace(own, options=msgspec.structs.replace(own.options, products=True))
        turning = made_result(
            {"EYX": [0, 1, 2, 1, 0]},
            angles={"ECX": [0, 5, 15, 10, 20], "EAX": [0, 5, 15, 10, 20]},
        )
        first = export(
            turning,
            "siemens",
            linked,
            out_dir=tmp_path / "first",
            today=TODAY,
            accept=["change-large"],
        )
        (product,) = {
            table.name
            for table in first.tables
            if table.multiplier is not None and table.output_axis == "Y"
        }
        old = (tmp_path / "first" / "NC_CEC_UNTESTED_SIGN.INI").read_bytes()
        held = replace(own, existing=(ControlFile(name="NC_CEC.INI", data=old),))
        refused = refusal_of(made_result({"EYX": [0, 1, 2, 1, 0]}), held, tmp_path / "second")
        assert refused.code.startswith("old-table-left-active")
        assert product in str(refused)

    def test_what_no_table_can_hold_any_more_is_not_lost_in_silence(self, tmp_path):
        """An axis list holds one cross table: that of another master axis would go."""
        profile = profile_of("beckhoff", VOLUME)
        lists = msgspec.structs.replace(profile.options, way="lists", cross_sense="as-error")
        wanted = msgspec.structs.replace(profile.machine, functions=["EXX", "EYX"])
        profile = replace(profile, options=lists, machine=wanted)
        control = controller_named("beckhoff")
        files = control.render(
            control.plan(curves_of(RESULT, ["EXX", "EYX"]), profile).tables, profile
        )
        other = replace(
            profile,
            existing=files,
            machine=msgspec.structs.replace(wanted, functions=["EXX", "EYZ"]),
        )
        with pytest.raises(SafetyError) as refused:
            export(RESULT, "beckhoff", other, out_dir=tmp_path / "out", today=TODAY)
        assert refused.value.code == "control-full.cross-table"

    def test_an_old_table_for_each_direction_is_not_merged_into_a_mean(self, tmp_path):
        old = (
            b"CHANDATA(1)\n"
            + b"".join(
                b"$AN_CEC[%d,0]=0\n$AN_CEC[%d,1]=0.002\n$AN_CEC_INPUT_AXIS[%d]=(AX1)\n"
                b"$AN_CEC_OUTPUT_AXIS[%d]=(AX1)\n$AN_CEC_STEP[%d]=400\n"
                b"$AN_CEC_MIN[%d]=-200\n$AN_CEC_MAX[%d]=200\n$AN_CEC_DIRECTION[%d]=%d\n"
                % (*[n] * 8, way)
                for n, way in ((0, 1), (1, -1))
            )
            + b"M17\n"
        )
        profile = replace(
            machine(measured_with="on"), existing=(ControlFile(name="CEC.INI", data=old),)
        )
        assert (
            refusal_of(measured_with(RESULT, profile.existing), profile, tmp_path).code
            == "direction-unfit.active"
        )

    def test_a_truncated_old_table_is_refused_with_its_place(self, tmp_path):
        profile = replace(
            machine(), existing=(ControlFile(name="AX_EEC.INI", data=OLD_TABLE[:90]),)
        )
        with pytest.raises(DataError, match=r"AX_EEC\.INI"):
            export(RESULT, "siemens", profile, out_dir=tmp_path / "out", today=TODAY)


class TestMergingAnyController:
    @pytest.mark.parametrize("name", sorted(CONTROLLERS))
    def test_old_plus_residual_is_what_was_wanted_at_once(self, name, tmp_path):
        """controllers.md 9: exporting e, then measuring nothing but a residual r on top, gives the
        table of e + r."""
        profile = profile_of(name, VOLUME)
        control = controller_named(name)
        both = made_result({"EXX": [0, 5, 9, 12, 16]})
        plan = control.plan(
            curves_of(made_result({"EXX": [0, 3, 7, 9, 12]}), profile.machine.functions),
            profile,
        )
        settled = replace(profile, options=plan.options or profile.options)
        old = control.render(plan.tables, settled)
        machine_now = msgspec.structs.replace(profile.machine, measured_with="on")
        now = replace(
            settled,
            machine=machine_now,
            existing=tuple(file for file in old if file.role == "data"),
        )
        residual = measured_with(made_result({"EXX": [0, 2, 2, 3, 4]}), now.existing)
        accept = ["change-large", "slope-steep", "correction-small.uncertainty"]
        report = export(residual, name, now, out_dir=tmp_path, accept=accept, today=TODAY)
        wanted = -np.array(both.errors["EXX"].value)
        tables = [table for table in report.tables if table.name == "EXX"]
        got = sum(correction_um(table, VOLUME.nodes_mm(0)) for table in tables)
        np.testing.assert_allclose(
            got, wanted, atol=max(table.quantum_um for table in tables) + 0.01
        )


class TestReplay:
    def test_the_same_export_gives_the_same_bytes(self, tmp_path):
        """No clock and no path is in any file."""
        for folder in ("one", "two"):
            export(RESULT, "siemens", machine(), out_dir=tmp_path / folder, today=TODAY)
        for path in (tmp_path / "one").iterdir():
            assert path.read_bytes() == (tmp_path / "two" / path.name).read_bytes()


def test_lattice_holds_what_the_angular_errors_do(tmp_path):
    """A lattice takes the whole field with its Abbe arms; on its own vertices nothing is left but
    the rounding."""
    report = export(RESULT, "lattice", None, step_mm=20.0, out_dir=tmp_path)
    found = verify_files(RESULT, read_given([tmp_path / "lattice.csv"]), nodes=11)
    assert found.controller == report.controller == "lattice"
    assert np.max(np.abs(found.prediction.drawn.after_um)) < 0.01


def test_a_function_whose_place_is_taken_was_corrected_by_its_old_tables_each_way():
    """What was active is read back as the error that it corrects: tables of both directions as two
    columns."""
    profile = profile_of("siemens", VOLUME, direction="both", reference_at=2)
    curves = curves_of(
        made_result(
            {"EXX": [4.0, 1.0, 0.0, -2.0, -5.0]}, reversal={"EXX": [6.0, 5.0, 4.0, 3.0, 2.0]}
        ),
        ["EXX"],
    )
    tables = controller_named("siemens").plan(curves, profile).tables
    assert {table.direction for table in tables} == {1, -1}
    was = _as_it_was("EXX", tables, profile)
    for told, written in (
        (was.forward_um, curves[0].forward_um),
        (was.reverse_um, curves[0].reverse_um),
    ):
        assert np.ptp(told - written) == pytest.approx(0.0, abs=0.2)
    assert np.mean(was.forward_um - was.reverse_um) == pytest.approx(
        np.mean(curves[0].forward_um - curves[0].reverse_um), abs=0.2
    )
