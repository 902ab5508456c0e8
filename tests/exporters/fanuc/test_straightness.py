"""Straightness where the option is in the machine's file: three sets for what is worth most, fitted
to the volume, applied by its law."""

from dataclasses import replace

import msgspec
import numpy as np
import pytest

from stepdiag.base.errors import SafetyError
from stepdiag.base.result.field import error_field_um, without_rigid_motion
from stepdiag.base.result.result import ROTATIONS, Result
from stepdiag.base.volume import Volume, grid_points_mm
from stepdiag.exporters.fanuc.control import Fanuc
from stepdiag.exporters.fanuc.straightness import SETS
from stepdiag.exporters.files.control_file import ControlFile
from stepdiag.exporters.tables.curves import FUNCTIONS
from stepdiag.exporters.tables.fit import fitted
from stepdiag.exporters.tables.profile import Profile
from stepdiag.exporters.tables.tables import total_correction_um
from stepdiag.virtual.control.fanuc import load_fanuc
from testkit.exact.machines import EOB, new_punch_file, profile_of
from testkit.exact.results import made_result

FANUC = Fanuc()
VOLUME = Volume(
    origin_mm=(-200.0, -200.0, -100.0), size_mm=(400.0, 400.0, 200.0), increments=4
)
POINTS = grid_points_mm(VOLUME, 9)


def parameters(sets: int = 3) -> bytes:
    """Return a punch file with the parameters of so many sets, all zero: the option as it was
    delivered."""
    keys = [
        key
        for one in SETS[:sets]
        for key in (one.moving, one.compensated, *one.points, *one.values)
    ]
    lines = ["%", "(CNCID=000000000000)", *(f"N{key:05}Q1P0" for key in sorted(keys)), "%"]
    return EOB.join(line.encode("ascii") for line in lines) + EOB


def profile(sets: int = 3, *, option: bool = True) -> Profile:
    plain = profile_of("fanuc", VOLUME, sections=16, reference_at=8)
    files = (
        ControlFile(name="PITCH.TXT", data=new_punch_file()),
        *([ControlFile(name="PARAM.TXT", data=parameters(sets))] if sets else []),
    )
    functions = ["EXX", "EYY", "EZZ", "EYX", "EZX", "EXY", "EZY", "EXZ", "EYZ"]
    return replace(
        plain,
        existing=files,
        machine=msgspec.structs.replace(plain.machine, functions=functions),
        options=msgspec.structs.replace(
            plain.options,
            straightness_option=option,
            detection_unit_um=0.1,
            increment_limit=127,
        ),
    )


def drawn(seed: int = 4) -> Result:
    rng, along = np.random.default_rng(seed), np.linspace(0.0, 1.0, 5)
    angles = {
        name: 12 * (rng.normal() * along + rng.normal() * np.sin(np.pi * along))
        for name in ROTATIONS
    }
    straight = {
        name: 6 * rng.normal() * np.sin(np.pi * along)
        for name in ("EYX", "EZX", "EXY", "EZY", "EXZ", "EYZ")
    }
    square = {"C0Y": 25.0, "B0Z": -18.0, "A0Z": 21.0}
    return made_result(straight, squareness=square, angles=angles, volume=VOLUME)


def rms_um(result: Result, moved: np.ndarray) -> float:
    left = without_rigid_motion(VOLUME, POINTS, error_field_um(result, POINTS) + moved)
    return float(np.sqrt(np.mean(np.sum(left**2, axis=1))))


def written(of: Profile, result: Result):
    plan = FANUC.plan(fitted(result).curves, of)
    settled = replace(of, options=plan.options)
    return plan, settled, FANUC.render(plan.tables, settled)


def test_the_three_functions_that_are_worth_most_are_written() -> None:
    plan, _, _ = written(profile(), drawn())
    assert len([table for table in plan.tables if table.kind == "straightness"]) == 3
    assert {table.name for table in plan.tables if table.kind == "straightness"} >= {
        "EXY"
    } or len(plan.listed) == 3
    spread = {
        table.name: np.ptp(table.value_um)
        for table in (*plan.tables, *plan.listed)
        if table.kind == "straightness"
    }
    assert min(spread[t.name] for t in plan.tables if t.kind == "straightness") >= 0.4 * max(
        spread[t.name] for t in plan.listed
    )


@pytest.mark.parametrize("seed", range(5))
def test_the_virtual_control_moves_as_read_and_reaches_more_than_pitch_alone(
    seed: int,
) -> None:
    result = drawn(seed)
    plan, settled, files = written(profile(), result)
    read = FANUC.parse(files, settled)
    assert sorted(str(table.label) for table in read) == sorted(
        str(table.label) for table in plan.tables
    )
    tables = load_fanuc(
        [file.data.decode("ascii") for file in files],
        detection_unit_um=0.1,
        interpolated=False,
    )
    theirs = (
        sum(
            (table.correction_mm(POINTS, np.ones(POINTS.shape)) for table in tables),
            np.zeros(POINTS.shape),
        )
        * 1e3
    )
    np.testing.assert_allclose(theirs, total_correction_um(read, POINTS), rtol=0, atol=1e-6)
    without = total_correction_um(
        [table for table in read if table.kind != "straightness"], POINTS
    )
    assert rms_um(result, theirs) < 0.75 * rms_um(result, without)


def test_a_new_reader_finds_them_by_what_the_file_says() -> None:
    """``verify`` with the profile as the person wrote it: which function a set holds stands in the
    file."""
    of = profile()
    plan, _, files = written(of, drawn())
    read = FANUC.parse(
        files,
        replace(of, options=msgspec.structs.replace(of.options, axes=plan.options.axes)),
    )
    assert {t.name for t in read if t.kind == "straightness"} == {
        t.name for t in plan.tables if t.kind == "straightness"
    }


def test_fewer_sets_hold_fewer_functions() -> None:
    plan, _, _ = written(profile(sets=1), drawn())
    assert len([table for table in plan.tables if table.kind == "straightness"]) == 1
    assert len(plan.listed) == 5


def test_a_set_with_axes_and_without_points_holds_no_table() -> None:
    """The option is in the control, and nobody compensated anything: its tables are read before
    every export."""
    named = (
        parameters()
        .replace(b"N05711Q1P0", b"N05711Q1P2")
        .replace(b"N05721Q1P0", b"N05721Q1P1")
    )
    assert named != parameters()
    plain = profile()
    of = replace(
        plain, existing=(plain.existing[0], ControlFile(name="PARAM.TXT", data=named))
    )
    assert [
        table for table in FANUC.standing(of.existing, (), of) if table.kind != "pitch"
    ] == []


def test_an_option_that_the_file_does_not_show_is_refused() -> None:
    with pytest.raises(SafetyError) as refused:
        written(profile(sets=0), drawn())
    assert refused.value.code == "template-missing.parameters"


def codes(of: Profile, functions: list[str]) -> set[str]:
    return {
        finding.key for finding in FANUC.plan(fitted(drawn(), functions).curves, of).findings
    }


def test_numbers_that_no_manual_stated_are_a_remark_of_every_export_that_rests_on_them() -> (
    None
):
    """Not where the profile brings the numbers from the machine's own manual, and not where nothing
    is written into them."""
    of = profile()
    assert "sign-untested.recalled" in codes(of, FUNCTIONS)
    assert "sign-untested.recalled" not in codes(of, ["EXX", "EYY", "EZZ"])
    assert "sign-untested.recalled" not in codes(profile(option=False), FUNCTIONS)
    stated = msgspec.structs.replace(
        of.options, straightness={"EXY": SETS[0], "EXZ": SETS[1], "EYZ": SETS[2]}
    )
    assert "sign-untested.recalled" not in codes(replace(of, options=stated), FUNCTIONS)


def test_straightness_in_the_file_beside_a_profile_that_says_there_is_none() -> None:
    """Sets with values act beside whatever is written; sets that are all zero do nothing."""
    assert "machine-file-differs.straightness" not in codes(profile(option=False), FUNCTIONS)
    _, _, files = written(profile(), drawn())
    held = replace(profile(option=False), existing=files)
    assert "machine-file-differs.straightness" in codes(held, FUNCTIONS)
    assert "machine-file-differs.straightness" not in codes(
        replace(profile(), existing=files), FUNCTIONS
    )


@pytest.mark.parametrize("interval_mm", [b"30.0", b"25.4", b"24.999"])
def test_straight_lines_need_the_pitch_points_that_nobody_sets(interval_mm: bytes) -> None:
    """Y is left alone and its pitch points stand at another interval in the machine's file: four
    points of Y would lie elsewhere."""
    of = profile()
    pitch, sets = of.existing
    intervals = b"N03624Q1A1P25.0A2P%sA3P12.5" % interval_mm
    elsewhere = replace(
        pitch, data=pitch.data.replace(b"N03624Q1A1P0.0A2P0.0A3P0.0", intervals)
    )
    with pytest.raises(SafetyError) as refused:
        codes(replace(of, existing=(elsewhere, sets)), ["EXX", "EZZ", "EXY"])
    assert refused.value.code == "profile-incomplete.pitch-points"
    assert "EYY in addition to EXY" in str(refused.value)
    codes(replace(of, existing=(elsewhere, sets)), ["EXX", "EYY", "EZZ", "EXY"])


def test_without_the_option_it_stays_in_the_report() -> None:
    plan, _, _ = written(profile(option=False), drawn())
    assert len(plan.listed) == 6
