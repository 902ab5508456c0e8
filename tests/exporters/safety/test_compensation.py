"""A second calibration of a compensated machine: whatever survey, profile and files say, the
machine never gets worse unseen."""

from dataclasses import replace
from datetime import date
from itertools import product

import msgspec
import numpy as np
import pytest

from stepdiag.base.compensation import Statement, stated, stated_in
from stepdiag.base.errors import DataError, SafetyError
from stepdiag.base.result.members import Facts
from stepdiag.base.result.result import ROTATIONS, Result, parse_result
from stepdiag.base.volume import grid_points_mm
from stepdiag.exporters.export.export import export
from stepdiag.exporters.files.control_file import ControlFile
from stepdiag.exporters.profiles.registry import controller_named
from stepdiag.exporters.safety.levers import left_out, without_levers
from stepdiag.exporters.tables.curves import curves_of
from stepdiag.exporters.tables.profile import Profile
from stepdiag.virtual.control.siemens import SiemensControl
from testkit.exact.machines import profile_of
from testkit.exact.members import members
from testkit.exact.results import VOLUME, made_result

TODAY = date(2026, 6, 1)
MACHINE = {
    "EXX": [0, 3, 8, 12, 20],
    "EYY": [0, -2, -5, -7, -9],
    "EYX": [0, 1.5, 2, 1, 0],
    "EXZ": [0, -2, 1, 2, 0],
}
"""How the bare machine errs, in um."""
WORN = {
    "EXX": [0, 1, 3, 5, 8],
    "EYY": [0, -1, -1, -3, -4],
    "EYX": [0, 1, -1, 1, 0],
    "EXZ": [0, 0, 2, 1, 0],
}
"""What wear has added since the tables were made."""
POINTS = grid_points_mm(VOLUME, 5)
ACCEPT = ("change-large", "correction-small.uncertainty")


def profile(state: str = "off", existing: tuple[ControlFile, ...] = ()) -> Profile:
    made = profile_of("siemens", VOLUME)
    return replace(
        made,
        machine=msgspec.structs.replace(made.machine, measured_with=state),
        existing=existing,
    )


def tables_for(errors: dict[str, list[float]]) -> tuple[ControlFile, ...]:
    control = controller_named("siemens")
    return control.render(
        control.plan(curves_of(made_result(errors)), profile()).tables, profile()
    )


def data_of(files: tuple[ControlFile, ...]) -> tuple[ControlFile, ...]:
    return tuple(file for file in files if file.name.endswith(".INI"))


def summed(
    one: dict[str, list[float]], other: dict[str, list[float]]
) -> dict[str, list[float]]:
    return {name: list(np.add(one[name], other[name])) for name in one}


FIRST = tables_for(MACHINE)
OTHER = data_of(tables_for(WORN))
GIVEN = {
    "none": (),
    "right": data_of(FIRST),
    "one of two": data_of(FIRST)[:1],
    "others": OTHER,
}
STATEMENTS = {
    "off": Statement(state="off"),
    "on": stated("on", {file.name: file.data for file in data_of(FIRST)}, TODAY, "archive"),
    "unanswered": Statement(state="?"),
    "not said": Statement(),
}


def errs_um(control: SiemensControl) -> float:
    """The largest error of the worn machine under this control, without the shift and turn of the
    workpiece, in um."""
    from stepdiag.base.result.field import error_field_um, without_rigid_motion

    moved = sum(
        (
            1000.0 * table.correction_mm(POINTS, np.ones(POINTS.shape))
            for table in control.tables()
        ),
        np.zeros(POINTS.shape),
    )
    left = error_field_um(made_result(summed(MACHINE, WORN)), POINTS) + moved
    return float(np.max(np.linalg.norm(without_rigid_motion(VOLUME, POINTS, left), axis=1)))


def measured(truly: str, said: Statement) -> Result:
    """What a survey finds on the worn machine with the first tables on or off, and what its survey
    file says of it."""
    errors = WORN if truly == "on" else summed(MACHINE, WORN)
    return replace(made_result(errors), survey=said.facts(Facts(machine="test machine")))


def loaded(files: tuple[ControlFile, ...]) -> SiemensControl:
    control = SiemensControl()
    for file in (*FIRST, *files):
        control.load(file.data.decode("ascii"))
    return control


@pytest.mark.parametrize(
    ("truly", "said"),
    [("off", "off"), ("on", "on"), *product(["off", "on"], ["unanswered", "not said"])],
)
def test_no_combination_makes_the_machine_worse_unseen(truly, said, tmp_path):
    """Profile on or off, four sets of files, a quick look: refused, or at most as wrong as before
    (today 4.25 -> 5.91 µm)."""
    before = errs_um(loaded(()))
    written = 0
    for number, (state, given) in enumerate(
        [*product(["off", "on"], GIVEN), ("quick", "none")]
    ):
        out = tmp_path / str(number)
        chosen = None if state == "quick" else profile(state, GIVEN[given])
        try:
            export(
                measured(truly, STATEMENTS[said]),
                "siemens",
                chosen,
                step_mm=50.0,
                accept=ACCEPT,
                out_dir=out,
                today=TODAY,
            )
        except SafetyError:
            assert not out.exists()
            continue
        written += 1
        names = [
            path
            for path in sorted(out.iterdir())
            if path.suffix == ".MPF" and "_RESTORE" not in path.name
        ]
        after = errs_um(
            loaded(
                tuple(ControlFile(name=path.name, data=path.read_bytes()) for path in names)
            )
        )
        assert after <= before, (state, given)
        assert after < 0.6
    assert written == {"off": 5, "on": 1}.get(said, 0)


class TestStatement:
    def test_stands_in_the_result_and_is_read_back(self):
        said = STATEMENTS["on"]
        result = parse_result(replace(made_result(), survey=said.facts()).to_json())
        assert stated_in(result) == said
        assert said.words().startswith("on: AX_EEC.INI sha256 ")

    def test_readings_have_no_survey_to_say_it_and_a_survey_that_does_not_leaves_it_open(
        self,
    ):
        assert stated_in(made_result()).state is None
        assert stated_in(replace(made_result(), survey=Facts(machine="m"))).state == "?"

    @pytest.mark.parametrize("controller", ["lattice", "etalon", "neutral"])
    def test_no_form_of_export_goes_on_without_it(self, controller, tmp_path):
        with pytest.raises(SafetyError) as refusal:
            export(
                measured("off", STATEMENTS["not said"]),
                controller,
                None,
                step_mm=50.0,
                out_dir=tmp_path / "out",
            )
        assert refusal.value.code == "compensation-unanswered"
        assert not (tmp_path / "out").exists()

    def test_a_word_that_is_no_answer_leaves_it_open(self):
        assert (
            stated_in(replace(made_result(), **members(survey={"compensation": "yes"}))).state
            == "?"
        )

    @pytest.mark.parametrize(
        "survey", [{"compensation": "on"}, {"compensation": "on", "active_files": [{}]}]
    )
    def test_a_damaged_one_is_refused(self, survey):
        with pytest.raises(DataError, match="survey"):
            stated_in(replace(made_result(), **members(survey=survey)))


class TestReadingsThatSayNothing:
    def test_the_profile_is_believed_aloud(self, tmp_path):
        report = export(
            made_result(MACHINE), "siemens", profile(), out_dir=tmp_path / "out", today=TODAY
        )
        assert ("compensation-unanswered.profile", "warning") in {
            (item.key, item.severity) for item in report.findings
        }

    @pytest.mark.parametrize("noted", [[], ["00"]])
    def test_active_files_need_a_hash_that_somebody_noted(self, noted, tmp_path):
        """And the refusal does not tell the hash that would do."""
        on = profile("on", data_of(FIRST))
        on = replace(on, machine=msgspec.structs.replace(on.machine, active_sha256=noted))
        with pytest.raises(SafetyError) as refusal:
            export(
                made_result(WORN),
                "siemens",
                on,
                out_dir=tmp_path / "out",
                accept=ACCEPT,
                today=TODAY,
            )
        assert refusal.value.code == "active-table-unfit.other"
        assert STATEMENTS["on"].files[0].sha256 not in str(refusal.value)


ANGLES = {name: [0.0, 2.0, 3.0, 4.0, 9.0] for name in ROTATIONS}
LATTICE = b"x_mm,y_mm,z_mm,cx_um,cy_um,cz_um\n" + b"".join(
    f"{x},{y},{z},0.0,0.0,0.0\n".encode()
    for x in (-200, 200)
    for y in (0, 400)
    for z in (-100, 100)
)
WHOLE = {
    "lattice.csv": LATTICE,
    "NC_CEC.INI": b"$AN_CEC[0,0]=0.1\n$AN_CEC_MULT_BY_TABLE[0]=7\n",
    "errors.csv": b"// by hand\nX EXX EYX EAX\n0.0 0.0 0.0 0.0\n1.0 0.0 0.0 0.00001\n",
    "AXIS-X.COM": b"BEGIN AXIS-X.COM  DATUM:+0.0 DISTANCE:+50.0 MM\r\nNR X Y Z C1 C2 C3 C4 C5 "
    b"C6\r\n",
}
PLAIN = {
    **{file.name: file.data for file in FIRST},
    "errors.csv": b"// EAX is not in here\nX EXX EYX\n0.0 0.0 0.0\n1.0 0.0 0.0\n",
    "AXIS-X.COM": b"BEGIN AXIS-X.COM  DATUM:+0.0 DISTANCE:+50.0 MM\r\nNR X Y Z\r\n",
}


class TestAnglesWhoseLeversAreGone:
    """While a lattice, products or columns of angles were active, measured angles say nothing of
    the tool."""

    def test_what_takes_the_levers_away_is_known_by_its_contents(self):
        assert set(without_levers(WHOLE)) == set(WHOLE)
        assert without_levers(PLAIN) == ()

    def test_a_solution_says_that_it_left_them_out(self):
        found = left_out({"lattice.csv": LATTICE})
        assert (found.key, found.severity) == ("angles-left-out", "warning")
        assert "lattice.csv was active during the measurement" in found.text
        assert left_out(PLAIN) is None

    @pytest.mark.parametrize(
        "given", [{"lattice.csv": LATTICE}, {"NC_CEC.INI": WHOLE["NC_CEC.INI"]}]
    )
    def test_an_export_of_a_result_with_angles_is_refused(self, given, tmp_path):
        result = replace(
            made_result(MACHINE, angles=ANGLES),
            survey=stated("on", given, TODAY, "archive").facts(),
        )
        files = tuple(ControlFile(name=name, data=data) for name, data in given.items())
        with pytest.raises(SafetyError) as refusal:
            export(
                result,
                "siemens",
                profile("on", files),
                out_dir=tmp_path / "out",
                accept=ACCEPT,
                today=TODAY,
            )
        assert refusal.value.code == "active-table-unfit.angles"
        assert "solve without the angles file" in str(refusal.value)

    def test_with_tables_of_one_axis_the_levers_are_still_there(self, tmp_path):
        result = replace(made_result(WORN, angles=ANGLES), survey=STATEMENTS["on"].facts())
        assert export(
            result,
            "siemens",
            profile("on", GIVEN["right"]),
            out_dir=tmp_path / "out",
            accept=ACCEPT,
            today=TODAY,
        ).files
