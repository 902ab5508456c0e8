"""Siemens files: the worked examples, production snippets as parser input, the guards of the
loading programs."""

from contextlib import nullcontext
from dataclasses import replace

import msgspec
import numpy as np
import pytest

from stepdiag.base.errors import DataError, SafetyError, UsageError
from stepdiag.base.volume import Volume
from stepdiag.exporters.export.export import export
from stepdiag.exporters.files.control_file import ControlFile
from stepdiag.exporters.siemens.control import Siemens, SiemensOptions
from stepdiag.exporters.tables.curves import curves_of
from stepdiag.exporters.tables.profile import AxisSection, Profile
from stepdiag.exporters.tables.tables import Table, correction_um
from testkit.exact.machines import profile_of
from testkit.exact.results import VOLUME, made_result
from testkit.exact.siemens_files import CEC_GOLDEN, EEC_GOLDEN

SIEMENS = Siemens()
ARCHIVE_EEC = """\
METRIC

CHANDATA(1)
$AA_ENC_COMP[1,0,AX1]=0
$AA_ENC_COMP[1,1,AX1]=0.0002
$AA_ENC_COMP[1,2,AX1]=0.0054
$AA_ENC_COMP[1,3,AX1]=0
$AA_ENC_COMP_STEP[1,AX1]=15
$AA_ENC_COMP_MIN[1,AX1]=0
$AA_ENC_COMP_MAX[1,AX1]=30
$AA_ENC_COMP_IS_MODULO[1,AX1]=0
M17
"""
ARCHIVE_CEC = """\
METRIC

CHANDATA(1)
{values}
$AN_CEC_INPUT_NCU[2]=1
$AN_CEC_INPUT_AXIS[2]=(AX1)
$AN_CEC_OUTPUT_NCU[2]=1
$AN_CEC_OUTPUT_AXIS[2]=(AX2)
$AN_CEC_STEP[2]=100
$AN_CEC_MIN[2]=0
$AN_CEC_MAX[2]=950
$AN_CEC_DIRECTION[2]=0
$AN_CEC_MULT_BY_TABLE[2]=0
$AN_CEC_IS_MODULO[2]=0
$AN_CEC_TYPE[2]=0
M17
""".format(
    values="\n".join(
        f"$AN_CEC[2,{n}]={value}"
        for n, value in enumerate(
            [0, 0, 0.004, 0.008, 0.008, 0.004, 0.001, -0.002, -0.006, -0.003, 0, 0, 0, 0, 0]
        )
    )
)


def plain_profile(**options: object) -> Profile:
    """A profile without table sizes, X with its reference at 0."""
    profile = profile_of("siemens", VOLUME)
    axes = {
        **profile.axes,
        "X": AxisSection(
            name="AX1", step_mm=100.0, reference_mm=0.0, start_mm=-200.0, end_mm=200.0
        ),
    }
    return replace(profile, axes=axes, options=SiemensOptions(measuring_system=1, **options))


def data_files(profile: Profile, *names: str, **errors: object) -> dict[str, str]:
    curves = curves_of(made_result(**errors), names)
    return {
        file.name: file.data.decode()
        for file in SIEMENS.render(SIEMENS.plan(curves, profile).tables, profile)
    }


class TestGoldenFiles:
    def test_eec_is_the_worked_example_byte_for_byte(self):
        """controllers.md 12.2: the error itself, zero at the reference, four decimals."""
        files = data_files(plain_profile(), "EXX", values={"EXX": [4, 1, 0, -2, -5]})
        assert files["AX_EEC.INI"] == EEC_GOLDEN

    def test_cec_is_the_worked_example_byte_for_byte(self):
        """controllers.md 12.3: straightness of X in Y with 10 µm/m of squareness folded in."""
        volume = Volume(
            origin_mm=(0.0, 0.0, 0.0), size_mm=(400.0, 400.0, 200.0), increments=4
        )
        result = made_result(
            {"EYX": [0, 1.5, 2, 1, 0]}, squareness={"C0Y": -10.0}, volume=volume
        )
        profile = plain_profile()
        axis = AxisSection(
            name="AX1", step_mm=100.0, reference_mm=0.0, start_mm=0.0, end_mm=400.0
        )
        profile = replace(profile, axes={**profile.axes, "X": axis})
        tables = SIEMENS.plan(curves_of(result, ["EYX"], {"C0Y": "EYX"}), profile).tables
        assert SIEMENS.render(tables, profile)[0].data.decode() == CEC_GOLDEN

    def test_surplus_points_are_written_as_zero(self):
        """K3: points that are not written keep old values; MD38000 = 7 makes two more of them."""
        files = data_files(
            plain_profile(eec_points={"X": 7}), "EXX", values={"EXX": [4, 1, 0, -2, -5]}
        )
        assert (
            "$AA_ENC_COMP[0,5,AX1]=0.0000\n$AA_ENC_COMP[0,6,AX1]=0.0000\n$AA_ENC_COMP_STEP"
            in files["AX_EEC.INI"]
        )

    def test_second_measuring_system_has_index_one(self):
        files = data_files(
            replace(plain_profile(), options=SiemensOptions(measuring_system=2)), "EXX"
        )
        assert "$AA_ENC_COMP[1,0,AX1]=0.0000" in files["AX_EEC.INI"]

    def test_six_pairs_get_six_tables(self):
        """Three axes have six straightness curves, each a CEC table of its own."""
        text = data_files(
            plain_profile(first_cec_table=10), "EYX", "EZX", "EXY", "EZY", "EXZ", "EYZ"
        )["NC_CEC.INI"]
        pairs = [
            (
                f"$AN_CEC_INPUT_AXIS[{10 + n}]=(AX{i})",
                f"$AN_CEC_OUTPUT_AXIS[{10 + n}]=(AX{o})",
            )
            for n, (i, o) in enumerate([(1, 2), (1, 3), (2, 1), (2, 3), (3, 1), (3, 2)])
        ]
        assert all(base in text and out in text for base, out in pairs)

    def test_direction_dependent_positioning_uses_two_cec_tables(self):
        """K3 p. 264: the same axis as base and compensated axis, DIRECTION 1 and -1."""
        profile = plain_profile(cec_tables={"EXX": [4, 7]})
        profile = replace(
            profile,
            machine=type(profile.machine)(
                **{**_fields(profile.machine), "direction": "both"}
            ),
        )
        curves = curves_of(
            made_result({"EXX": [4, 1, 0, -2, -5]}, reversal={"EXX": [0, 2, 2, 2, 2]}),
            ["EXX"],
        )
        text = SIEMENS.render(SIEMENS.plan(curves, profile).tables, profile)[0].data.decode()
        assert "$AN_CEC_DIRECTION[4]=1\n" in text
        assert "$AN_CEC_DIRECTION[7]=-1\n" in text
        assert "$AN_CEC_OUTPUT_AXIS[7]=(AX1)" in text


class TestLoadingPrograms:
    def test_guards_come_before_anything_is_switched_off(self):
        """A refusal must leave the machine as it was."""
        for name in ("LOAD_EEC.MPF", "LOAD_CEC.MPF"):
            lines = data_files(plain_profile(), "EXX", "EYX")[name].splitlines()
            guards = [index for index, line in enumerate(lines) if line.startswith("IF ")]
            assert guards
            assert max(guards) < min(
                index for index, line in enumerate(lines) if line.startswith("$")
            )

    def test_switches_off_writes_and_switches_on(self):
        lines = data_files(plain_profile(), "EXX")["LOAD_EEC.MPF"].splitlines()
        off, on = (
            lines.index("$MA_ENC_COMP_ENABLE[0,AX1]=0"),
            lines.index("$MA_ENC_COMP_ENABLE[0,AX1]=1"),
        )
        assert (
            off
            < lines.index("$AA_ENC_COMP[0,0,AX1]=0.0000")
            < lines.index("$AA_ENC_COMP_IS_MODULO[0,AX1]=0")
            < on
        )
        assert lines[off + 1 : off + 3] == ["NEWCONF", "STOPRE"]
        assert "IF $MA_MM_ENC_COMP_MAX_POINTS[0,AX1]<5 GOTOF TOO_SMALL" in lines

    def test_a_table_of_zeros_may_be_switched_off(self):
        """It does nothing either way: the program that takes an old table away leaves its switch at
        0; one with values must not."""
        profile = plain_profile()
        for values, refused in (([0.0] * 5, False), ([4.0, 1.0, 0.0, -2.0, -5.0], True)):
            text = data_files(profile, "EXX", values={"EXX": values})["LOAD_EEC.MPF"]
            off = text.replace("$MA_ENC_COMP_ENABLE[0,AX1]=1", "$MA_ENC_COMP_ENABLE[0,AX1]=0")
            assert off != text
            with (
                pytest.raises(DataError, match="ENC_COMP_ENABLE")
                if refused
                else nullcontext()
            ):
                SIEMENS.parse([ControlFile(name="LOAD_EEC.MPF", data=off.encode())], profile)

    def test_every_jump_has_its_label(self):
        for text in (
            text
            for name, text in data_files(plain_profile(), "EXX", "EYX").items()
            if name.endswith(".MPF")
        ):
            for line in text.splitlines():
                if "GOTOF" in line:
                    assert f"{line.split()[-1]}:" in text.splitlines()

    def test_program_and_data_file_hold_the_same_table(self):
        profile = plain_profile()
        curves = curves_of(
            made_result({"EXX": [4, 1, 0, -2, -5], "EYX": [0, 1, 2, 1, 0]}), ["EXX", "EYX"]
        )
        files = SIEMENS.render(SIEMENS.plan(curves, profile).tables, profile)
        assert len(SIEMENS.parse(files, profile)) == 2


class TestReading:
    def test_production_eec_snippet(self):
        """controllers.md 3.1, sample 2: an archive writes METRIC and drops trailing zeros; point 3
        is surplus."""
        (table,) = SIEMENS.parse(
            [ControlFile(name="AX_EEC.INI", data=ARCHIVE_EEC.encode())], plain_profile()
        )
        assert table.place == {"measuring system": 2, "axis": "AX1"}
        np.testing.assert_allclose(table.value_um, [0, 0.2, 5.4])

    def test_production_cec_snippet_that_ends_off_its_grid(self):
        """controllers.md 3.2: MAX 950 with STEP 100, surplus points zero; the control uses the part
        up to 950."""
        (table,) = SIEMENS.parse(
            [ControlFile(name="NC_CEC.INI", data=ARCHIVE_CEC.encode())], plain_profile()
        )
        assert table.name == "EYX"
        assert correction_um(table, np.array([300.0, 350.0, 800.0, 925.0]))[
            :3
        ] == pytest.approx([-8, -8, 6])
        assert table.position_mm[-1] == 950.0

    @pytest.mark.parametrize(
        ("old", "new", "found"),
        [
            ("M17\n", "", "no end of file"),
            ("$AA_ENC_COMP[0,2,AX1]=0.0000\n", "", "no point 2"),
            ("=0.0010", "=0.0O10", "line 4"),
            ("$AA_ENC_COMP[0,1,AX1]=0.0010", "$AA_ENC_COMP[0,1,AX1]  0.0010", "line 4"),
            ("CHANDATA(1)", "INCH", "INCH"),
            ("IS_MODULO[0,AX1]=0", "IS_MODULO[0,AX1]=1", "rotary"),
            ("STEP[0,AX1]=100.0", "STEP[0,AX1]=0", "STEP 0"),
            ("=0.0010", "=nan", "line 4"),
            ("M17\n", "M17\n$AA_ENC_COMP[0,4,AX1]=1\n", "line 13"),
        ],
    )
    def test_a_damaged_file_is_refused_with_its_place(self, old, new, found):
        with pytest.raises(DataError, match=found.replace("[", r"\[")):
            SIEMENS.parse(
                [ControlFile(name="AX_EEC.INI", data=EEC_GOLDEN.replace(old, new).encode())],
                plain_profile(),
            )

    def test_an_axis_that_the_profile_does_not_name_is_refused(self):
        with pytest.raises(UsageError, match=r"AX9.*did you mean"):
            SIEMENS.parse(
                [
                    ControlFile(
                        name="AX_EEC.INI", data=EEC_GOLDEN.replace("AX1", "AX9").encode()
                    )
                ],
                plain_profile(),
            )

    def test_two_files_that_disagree_are_refused(self):
        other = EEC_GOLDEN.replace("0.0010", "0.0011")
        files = [
            ControlFile(name="A.INI", data=EEC_GOLDEN.encode()),
            ControlFile(name="B.INI", data=other.encode()),
        ]
        with pytest.raises(DataError, match="same EXX"):
            SIEMENS.parse(files, plain_profile())

    def test_law_of_the_manual(self):
        """K3 p. 241: a positive value moves the axis in the negative direction; ends are held."""
        (table,) = SIEMENS.parse(
            [ControlFile(name="AX_EEC.INI", data=EEC_GOLDEN.encode())], plain_profile()
        )
        assert _at(table, -200.0) == pytest.approx(-4.0)
        assert _at(table, -150.0) == pytest.approx(-2.5)
        assert _at(table, 999.0) == pytest.approx(5.0)


def _at(table: Table, position: float) -> float:
    return float(correction_um(table, np.array([position]))[0])


def _fields(struct: object) -> dict[str, object]:
    return {name: getattr(struct, name) for name in struct.__struct_fields__}


@pytest.mark.parametrize(
    ("held", "first", "refused"),
    [(8, 0, False), (6, 0, False), (5, 0, True), (8, 3, True), (None, 50, False)],
)
def test_more_tables_than_the_control_holds_are_refused(held, first, refused, tmp_path):
    """An 828D has eight CEC tables, counted from 0 (controllers.md 3.2)."""
    profile = profile_of("siemens", VOLUME)
    profile = replace(
        profile,
        options=msgspec.structs.replace(
            profile.options, cec_tables_held=held, first_cec_table=first
        ),
    )
    result = made_result({"EXX": [0, 3, 8, 12, 20], "EYX": [0, 1.5, 2, 1, 0]})
    with (
        pytest.raises(SafetyError, match="the control has only") if refused else nullcontext()
    ):
        export(result, "siemens", profile, out_dir=tmp_path / "out")


@pytest.mark.parametrize(("share", "refused"), [(None, True), (0.1, False)])
def test_the_slope_of_cec_is_judged_by_the_controls_own_limit(share, refused, tmp_path):
    """MD32730 lets the correction move at a tenth of the top speed: 1.2 µm/mm is far below it, and
    above what is plausible elsewhere."""
    profile = profile_of("siemens", VOLUME)
    profile = replace(
        profile, options=msgspec.structs.replace(profile.options, cec_max_velo=share)
    )
    result = made_result({"EYX": [0, 0, 95, 0, 0]})
    with (
        pytest.raises(SafetyError, match=r"µm/mm, the limit is 0\.8")
        if refused
        else nullcontext()
    ):
        export(result, "siemens", profile, out_dir=tmp_path / "out")
