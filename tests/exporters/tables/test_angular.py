"""Angles as columns: what Beckhoff's kernel and a Heidenhain with KinematicsComp make of them, by
laws of their own, on every chain."""

from dataclasses import replace
from datetime import date

import msgspec
import numpy as np
import pytest

from stepdiag.base.compensation import stated
from stepdiag.base.errors import DataError, UsageError
from stepdiag.base.result.field import error_field_um, without_rigid_motion
from stepdiag.base.result.result import ROTATIONS, Result
from stepdiag.base.volume import Vector, Volume, grid_points_mm
from stepdiag.exporters.export.export import export
from stepdiag.exporters.files.control_file import ControlFile
from stepdiag.exporters.files.sets import read_given
from stepdiag.exporters.profiles.registry import controller_named
from stepdiag.exporters.safety.sign_test import bump, verdict
from stepdiag.exporters.safety.verify import verify_files
from stepdiag.exporters.tables.fit import fitted
from stepdiag.exporters.tables.profile import Profile
from stepdiag.exporters.tables.tables import mean_correction_um
from stepdiag.virtual.control.beckhoff import load_volumetric
from stepdiag.virtual.control.heidenhain import load_tables
from testkit.exact.machines import profile_of
from testkit.exact.results import made_result

VOLUME = Volume(
    origin_mm=(-250.0, 100.0, -300.0), size_mm=(500.0, 400.0, 300.0), increments=10
)
"""Its middle lies far from the zero of the axes, from which the levers of a control count."""
POINTS = grid_points_mm(VOLUME, 5)
CHAINS = ("FXYZ", "XFYZ", "XYFZ", "YXFZ", "ZYXF", "FZYX")
CONTROLS = ("beckhoff", "heidenhain")
NAMES = {"AX1": "X", "AX2": "Y", "AX3": "Z"}


def drawn(chain: str = "FXYZ", seed: int = 3) -> Result:
    rng, along = np.random.default_rng(seed), np.linspace(0.0, 1.0, 11)
    angles = {
        name: 10.0 * (rng.normal() * along + 0.7 * rng.normal() * np.sin(np.pi * along))
        for name in ROTATIONS
    }
    square = {name: float(rng.normal(0.0, 20.0)) for name in ("C0Y", "B0Z", "A0Z")}
    shapes = {
        "EXX": 20 * along,
        "EYX": 5 * np.sin(np.pi * along),
        "EZY": 6 * np.sin(np.pi * along),
    }
    return made_result(shapes, squareness=square, angles=angles, chain=chain, volume=VOLUME)


def profile(name: str, chain: str | None = "FXYZ", **options: object) -> Profile:
    found = profile_of(name, VOLUME, sections=20, reference_at=4)
    generation = {"generation": "itnc530"} if name == "heidenhain" else {"turned": False}
    machine = msgspec.structs.replace(found.machine, existing=[])
    return replace(
        found,
        machine=machine,
        options=msgspec.structs.replace(found.options, chain=chain, **(generation | options)),
    )


def written(name: str, result: Result, of: Profile) -> tuple[ControlFile, ...]:
    fit, control = fitted(result), controller_named(name)
    return control.render(control.plan_products(fit.curves, fit.products, of).tables, of)


def virtual_um(
    files: tuple[ControlFile, ...], chain: str, points: Vector = POINTS, **law: object
) -> Vector:
    """Return what the control of the manual makes of the files."""
    texts = {file.name: file.data.decode() for file in files}
    if "volumetric_errors.csv" in texts:
        table = load_volumetric(texts["volumetric_errors.csv"], chain=chain, **law)
    else:
        tables = {name[5:8]: text for name, text in texts.items() if name.endswith(".COM")}
        table = load_tables(tables, texts["kinematics_comp_lines.txt"], axis_names=NAMES)
    return table.correction_mm(points, np.zeros(points.shape)) * 1e3


def left_um(result: Result, moved_um: Vector) -> float:
    left = without_rigid_motion(VOLUME, POINTS, error_field_um(result, POINTS) + moved_um)
    return float(np.sqrt(np.mean(np.sum(left**2, axis=1))))


@pytest.mark.parametrize("name", CONTROLS)
@pytest.mark.parametrize("chain", CHAINS)
class TestEveryChain:
    def test_the_control_of_the_manual_holds_the_whole_field(
        self, name: str, chain: str
    ) -> None:
        """21 errors, levers from the zero of the axes: what is left is the rounding; turned in sign
        it is twice the error."""
        result = drawn(chain)
        moved = virtual_um(written(name, result, profile(name, chain)), chain)
        assert left_um(result, moved) < 0.1
        assert left_um(result, -moved) > 1.9 * left_um(result, 0 * moved)

    def test_what_is_read_moves_as_the_control_does(self, name: str, chain: str) -> None:
        """To the rounding, and with nothing that jumps when the tables are switched on."""
        result, of = drawn(chain), profile(name, chain)
        files = written(name, result, of)
        data = [file for file in files if file.role == "data"]
        read = controller_named(name).parse(data, of)
        np.testing.assert_allclose(
            mean_correction_um(read, POINTS), virtual_um(files, chain), rtol=0, atol=5e-3
        )
        at_reference = np.array([[of.axis(letter).reference_mm for letter in "XYZ"]])
        assert np.max(np.abs(mean_correction_um(read, at_reference))) < 0.2


@pytest.mark.parametrize(
    ("chain", "order", "number"), [("XFYZ", "XYZ", 1), ("XYFZ", "XYZ", 2), ("XYZF", "XYZ", 3)]
)
class TestTurned:
    """Axes under the workpiece that the axis parameters turn already: for who measures they are
    axes of the tool (ISG 296411019)."""

    def lines(self, files: tuple[ControlFile, ...]) -> list[str]:
        (lines,) = (
            file.data.decode("ascii").splitlines()
            for file in files
            if file.name == "volcomp_lines.txt"
        )
        return lines

    def test_the_control_takes_them_as_axes_of_the_tool(
        self, chain: str, order: str, number: int
    ) -> None:
        """A control with workpiece_axes 0 holds the whole field; one that took them as axes of the
        workpiece would not."""
        result = drawn(chain)
        files = written("beckhoff", result, profile("beckhoff", chain, turned=True))
        assert {f"chain {order}", "workpiece_axes 0"} <= set(self.lines(files))
        assert left_um(result, virtual_um(files, f"F{order}")) < 0.1
        plain = written("beckhoff", result, profile("beckhoff", chain))
        assert f"workpiece_axes {number}" in self.lines(plain)
        assert left_um(result, virtual_um(plain, f"F{order}")) > 0.4

    def test_it_is_asked(self, chain: str, order: str, number: int) -> None:
        with pytest.raises(
            UsageError, match=r"beckhoff\.turned: expected true or false"
        ) as refusal:
            written("beckhoff", drawn(chain), profile("beckhoff", chain, turned=None))
        assert ", ".join(order[:number]) in str(refusal.value)
        assert "vz_istw" in str(refusal.value)


def test_a_chain_without_axes_under_the_workpiece_asks_nothing() -> None:
    assert written("beckhoff", drawn(), profile("beckhoff", turned=None))


@pytest.mark.parametrize(
    ("name", "origin_mm"),
    [("beckhoff", (2000.0, -4000.0, 1500.0)), ("heidenhain", (-3250.0, 100.0, -300.0))],
)
def test_verify_finds_every_table_right_far_from_the_zero_of_the_axes(
    name: str, origin_mm: tuple[float, float, float], monkeypatch
) -> None:
    """Levers of metres make columns of a tenth of a millimetre that the angles beside them cancel:
    the axis hardly moves."""
    monkeypatch.setitem(globals(), "VOLUME", replace(VOLUME, origin_mm=origin_mm))
    result, of = drawn("FXYZ"), profile(name, "FXYZ")
    data = [file for file in written(name, result, of) if file.role == "data"]
    found = verify_files(result, data, of, nodes=5)
    assert {each.code for each in found.judgements} == {"right"}
    assert found.right, found.findings


@pytest.mark.parametrize(
    ("name", "chain"), [("beckhoff", "FXYZ"), ("beckhoff", "XYFZ"), ("heidenhain", "FXYZ")]
)
def test_verify_finds_every_table_right_and_a_turned_angle_wrong(
    name: str, chain: str
) -> None:
    result, of = drawn(chain), profile(name, chain)
    data = [file for file in written(name, result, of) if file.role == "data"]
    found = verify_files(result, data, of)
    assert {each.code for each in found.judgements} == {"right"}
    assert found.right
    turned = drawn(chain)
    turned = replace(
        turned,
        errors={
            key: replace(each, value=-each.value) if key == "EAX" else each
            for key, each in turned.errors.items()
        },
    )
    told = {each.function: each.code for each in verify_files(turned, data, of).judgements}
    assert told["EYX*Z"] == told["EZX*Y"] == "sign-turned"


@pytest.mark.parametrize(
    ("name", "code"),
    [("beckhoff", "sign-untested.chain"), ("heidenhain", "sign-untested.component")],
)
def test_what_was_read_in_no_manual_is_said(name: str, code: str) -> None:
    """In the export's own words, on the terminal and in the report, beside the marks in the files;
    not where nothing of it is written."""
    fit, of = fitted(drawn()), profile(name)
    without = replace(of, options=msgspec.structs.replace(of.options, chain=None))
    said = [
        {
            each.key
            for each in controller_named(name)
            .plan_products(fit.curves, fit.products, one)
            .findings
        }
        for one in (of, without)
    ]
    assert code in said[0]
    assert code not in said[1]
    notes = [file.data for file in written(name, drawn(), of) if file.role == "note"]
    assert any(b"RECALLED" in data or b"DERIVED" in data for data in notes)


@pytest.mark.parametrize("chain", CHAINS)
def test_a_squareness_has_a_column_only_where_its_reading_does_not_matter(chain: str) -> None:
    """Whether the kernel turns what a leaning axis carries is not said: with these columns it makes
    no difference."""
    files = written("beckhoff", drawn(chain), profile("beckhoff", chain))
    alone, carrying = (virtual_um(files, chain, carries=carries) for carries in (False, True))
    np.testing.assert_allclose(alone, carrying, rtol=0, atol=2e-2)
    assert (b"C0Y" in files[0].data.splitlines()[1]) == (chain in ("FXYZ", "XFYZ", "XYFZ"))


def test_negate_turns_the_whole_file() -> None:
    result = drawn()
    files = written("beckhoff", result, profile("beckhoff", negate="XYZ"))
    assert left_um(result, virtual_um(files, "FXYZ", negate="XYZ")) < 0.1
    with pytest.raises(UsageError, match=r"beckhoff\.negate: expected \"XYZ\" or nothing"):
        written("beckhoff", result, profile("beckhoff", negate="XY"))


@pytest.mark.parametrize("name", CONTROLS)
class TestRefused:
    def test_another_chain_than_that_of_the_result(self, name, tmp_path) -> None:
        with pytest.raises(
            UsageError,
            match=rf"{name}\.chain: expected \"FXYZ\", the chain of the result, found \"XFYZ\"",
        ):
            export(
                drawn(),
                name,
                profile(name, "XFYZ"),
                accept=("slope-steep",),
                out_dir=tmp_path / "out",
            )
        assert not (tmp_path / "out").exists()

    def test_angles_in_a_file_for_a_profile_without_chain(self, name) -> None:
        files = written(name, drawn(), profile(name))
        with pytest.raises(DataError, match=rf"state {name}\.chain in the profile"):
            controller_named(name).parse(
                [file for file in files if file.role == "data"], profile(name, None)
            )

    def test_some_functions_only(self, name) -> None:
        fit, of = fitted(drawn()), profile(name)
        with pytest.raises(UsageError, match=r"machine\.functions: expected all nine"):
            controller_named(name).plan_products(fit.curves[:4], fit.products, of)


def test_other_controls_of_heidenhain_have_no_public_columns() -> None:
    of = profile("heidenhain")
    of = replace(of, options=msgspec.structs.replace(of.options, generation="tnc640"))
    with pytest.raises(
        UsageError, match=r'heidenhain\.chain: expected no entry, or generation = "itnc530"'
    ):
        written("heidenhain", drawn(), of)


@pytest.mark.parametrize("name", CONTROLS)
def test_an_export_restores_to_nothing_and_says_what_is_from_memory(name, tmp_path) -> None:
    """The restore files move nothing; what is not read in a manual is marked in the very file that
    needs it."""
    of = profile(name)
    report = export(
        drawn(),
        name,
        of,
        accept=("slope-steep", "profile-assumed.columns"),
        out_dir=tmp_path / "out",
    )
    restore = [
        file
        for file in read_given([tmp_path / "out"])
        if "_RESTORE" in file.name and file.role == "data"
    ]
    tables = controller_named(name).parse(
        [replace(file, name=file.name.replace("_RESTORE", "")) for file in restore], of
    )
    assert np.all(mean_correction_um(tables, POINTS) == 0.0)
    lines = next(tmp_path.glob("out/*_lines*.txt")).read_text(encoding="ascii")
    assert ("RECALLED" if name == "heidenhain" else "DERIVED") in lines
    assert report.prediction is not None


@pytest.mark.parametrize("name", CONTROLS)
@pytest.mark.parametrize("function", ["EYX*Z", "EXY*Z", "EZX*Y"])
def test_the_sign_of_an_angle_can_be_tried(name, function) -> None:
    """The bump of an angle, driven on the control of the manual, is what the test expects, where
    the other axis stands as it says."""
    of = profile(name)
    test = bump(controller_named(name), of, function)
    at = np.array([test.reference_mm, test.top_mm, test.beyond_mm])
    points = np.zeros((3, 3))
    points[:, "XYZ".index(function[2])] = at
    points[:, "XYZ".index(test.lever[0])] = test.lever[1]
    moved = virtual_um(test.files, "FXYZ", points)[:, "XYZ".index(function[1])]
    shown = verdict(test, at, 0 * moved, moved)
    assert shown.sense == "as-error", shown.text
    assert verdict(test, at, 0 * moved, -moved).sense == "as-compensation"


@pytest.mark.parametrize("name", CONTROLS)
def test_a_second_calibration_takes_the_place_of_the_first(name, tmp_path) -> None:
    """Measured with the first files active, whose angles are left out then: the new files hold the
    old angles and what has changed."""
    first, of = drawn(seed=3), profile(name)
    active = tuple(file for file in written(name, first, of) if file.role == "data")
    worn = made_result(
        {
            "EXX": 6 * np.linspace(0.0, 1.0, 11) ** 2,
            "EYX": 4 * np.sin(np.pi * np.linspace(0, 1, 11)),
        },
        volume=VOLUME,
    )
    said = stated(
        "on", {file.name: file.data for file in active}, date(2026, 1, 31), "read out"
    )
    on = replace(
        of, machine=msgspec.structs.replace(of.machine, measured_with="on"), existing=active
    )
    told = replace(worn, survey=said.facts())
    accept = ("slope-steep", "profile-assumed.columns", "change-large")
    export(told, name, on, accept=accept, out_dir=tmp_path / "out", today=date(2026, 2, 1))
    new = [
        replace(file, name=file.name.replace("_UNTESTED_SIGN", ""))
        for file in read_given([tmp_path / "out"])
    ]
    files = tuple(file for file in new if "_RESTORE" not in file.name)
    bare_um = error_field_um(first, POINTS) + error_field_um(worn, POINTS)
    before, after = (
        without_rigid_motion(VOLUME, POINTS, bare_um + virtual_um(each, "FXYZ"))
        for each in (written(name, first, of), files)
    )
    assert (
        np.max(np.linalg.norm(after, axis=1))
        < 0.3
        < np.max(np.linalg.norm(before, axis=1)) / 5
    )
