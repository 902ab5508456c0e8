"""Beckhoff/ISG: the volumetric file, the axis lists after the manual's example, what is asked and
what is refused."""

from dataclasses import replace

import msgspec
import numpy as np
import pytest

from stepdiag.base.errors import DataError, SafetyError, UsageError
from stepdiag.exporters.beckhoff.control import Beckhoff
from stepdiag.exporters.files.control_file import ControlFile
from stepdiag.exporters.tables.curves import FUNCTIONS, curves_of
from stepdiag.exporters.tables.tables import correction_um
from testkit.exact.machines import profile_of
from testkit.exact.results import VOLUME, made_result

BECKHOFF = Beckhoff()
RESULT = made_result(
    {"EXX": [4.0, 1.0, 0.0, -2.0, -5.0], "EXY": [0.0, 3.0, 5.0, 2.0, 0.0]},
    squareness={"C0Y": 10.0},
)


def profile(direction="mean", **options):
    plain = profile_of("beckhoff", VOLUME, reference_at=2, direction=direction)
    return replace(plain, options=msgspec.structs.replace(plain.options, **options))


def files_of(which, names=FUNCTIONS, result=RESULT):
    plan = BECKHOFF.plan(curves_of(result, names), which)
    return {file.name: file for file in BECKHOFF.render(plan.tables, which)}, plan


def test_volumetric_file():
    """TF5280, ISG CSV format: a heading of argument and components, rows in mm, ``#`` before the
    next; dX = -C0Y y is within EXY."""
    files, _ = files_of(profile())
    lines = [
        line.split()
        for line in files["volumetric_errors.csv"].data.decode().splitlines()
        if not line.startswith("//")
    ]
    assert lines[0] == ["X", "EXX", "EYX", "EZX"]
    assert lines[1] == ["-200.0", "0.00400", "0.00000", "0.00000"]
    assert lines[6:8] == [["#"], ["Y", "EYY", "EXY", "EZY"]]
    # zero at the reference (200 mm): 0 - 5 + 10 urad x 200 mm = -3 µm at 0 mm, 0 - 5 - 2 = -7 µm at
    # 400 mm
    assert lines[8] == ["0.0", "0.00000", "-0.00300", "0.00000"]
    assert lines[12] == ["400.0", "0.00000", "-0.00700", "0.00000"]
    assert "file_format[0] ISG_CSV" in files["volcomp_lines.txt"].data.decode().splitlines()


def test_negate_turns_the_sense_of_an_axis_but_not_its_numbers():
    """P-VOLC-00009: the file holds the errors of the machine either way; the law is that of the
    configured control."""
    plain, turned = profile(), profile(negate="X")
    sense = {
        table.name: table.law.sense
        for table in BECKHOFF.plan(curves_of(RESULT, ["EXX", "EYY"]), turned).tables
    }
    assert sense == {"EXX": "as-compensation", "EYY": "as-error"}
    assert "negate X" in files_of(turned)[0]["volcomp_lines.txt"].data.decode()
    assert "negate" not in files_of(plain)[0]["volcomp_lines.txt"].data.decode()


def test_reads_the_example_of_the_manual():
    """TF5200, non-equidistant bilateral example: 19856.5 µm measured at 19866.7 µm is -102 units of
    0.1 µm, 19874.7 is +80."""
    text = """\
kopf.achs_nr                        2
kopf.log_achs_name                  Y-ACHSE
kw.ssfk.interval                    0
kw.ssfk.kw_startpos                 0
kw.ssfk.kw_nr_max                   3
kw.ssfk.unit                        1
kw.ssfk.bilateral                   1  /* two columns */
kw.ssfk.table[0].setpoint           0
kw.ssfk.table[1].setpoint           100000
kw.ssfk.table[2].setpoint           198667
kw.ssfk.table[0].pos                0
kw.ssfk.table[1].pos                24
kw.ssfk.table[2].pos                -102
kw.ssfk.table[0].neg                0
kw.ssfk.table[1].neg                67
kw.ssfk.table[2].neg                80
"""
    forward, reverse = BECKHOFF.parse(
        [ControlFile(name="achskw2.lis", data=text.encode())], profile(way="lists")
    )
    assert (forward.name, forward.direction, reverse.direction) == ("EYY", 1, -1)
    assert correction_um(forward, np.array([19.8667]), 1) == pytest.approx([10.2])
    assert correction_um(reverse, np.array([19.8667]), -1) == pytest.approx([-8.0])


@pytest.mark.parametrize(
    "remark", ["/**/", "/***/", "/* * / */", "/* a */ /* b **/", "# /* the rest", "/*/ a */"]
)
def test_remarks_of_a_list_are_passed_over(remark):
    lines = [
        "kopf.achs_nr 2",
        "kw.ssfk.interval 10",
        "kw.ssfk.kw_nr_max 2",
        "kw.ssfk.unit 1",
        f"kw.ssfk.kw_startpos 7 {remark}",
    ]
    text = "\n".join([*lines, "kw.ssfk.table[0].pos 3", "kw.ssfk.table[1].pos 4"])
    (table,) = BECKHOFF.parse(
        [ControlFile(name="achskw2.lis", data=text.encode())], profile(way="lists")
    )
    assert table.position_mm == pytest.approx([0.0007, 0.0017])


def test_a_remark_that_is_not_closed_is_no_remark():
    text = "kopf.achs_nr 2\nkw.ssfk.interval 10 /* of ten"
    with pytest.raises(DataError, match="line 2"):
        BECKHOFF.parse(
            [ControlFile(name="achskw2.lis", data=text.encode())], profile(way="lists")
        )


def test_lists_hold_leadscrew_and_one_cross_table():
    """The slave's list names its master (P-COMP-00005) and holds setpoints of the master in 0.1
    um."""
    which = profile(way="lists", cross_sense="as-compensation", direction="both")
    result = made_result(
        {"EXX": [4.0, 1.0, 0.0, -2.0, -5.0], "EXY": [0.0, 3.0, 5.0, 2.0, 0.0]},
        reversal={"EXX": [2.0] * 5},
    )
    files, plan = files_of(which, ["EXX", "EXY"], result)
    text = files["achskw1.lis"].data.decode()
    for line in (
        "kopf.achs_nr 1",
        "kw.ssfk.bilateral 1",
        "kw.crosscomp.last_index 4",
        "kw.crosscomp.slave_ax_nr 2",
    ):
        assert line in text.split("\r\n")
    back = BECKHOFF.parse(list(files.values()), which)
    assert [(table.name, table.kind, table.direction) for table in back] == [
        (t.name, t.kind, t.direction) for t in plan.tables
    ]
    for read, planned in zip(back, plan.tables, strict=True):
        np.testing.assert_allclose(read.value_um, planned.value_um, atol=1e-9)
    (cross,) = [table for table in back if table.kind == "crosscomp"]
    assert correction_um(cross, np.array([0.0])) == pytest.approx([5.0])


def test_a_list_of_one_direction_says_so():
    """P-COMP: bilateral 0 is one column for both directions, in 0.1 µm; without it the control
    would read a second that is not there."""
    which = profile(way="lists", cross_sense="as-compensation")
    files, _ = files_of(which, ["EXX"], made_result({"EXX": [4.0, 1.0, 0.0, -2.0, -5.0]}))
    text = files["achskw1.lis"].data.decode()
    assert "kw.ssfk.bilateral 0" in text.split("\r\n")
    assert ".neg" not in text
    (table,) = BECKHOFF.parse(list(files.values()), which)
    assert table.direction == 0


def test_numbers_of_a_file_are_as_fine_as_they_are_written():
    """Five places of a millimetre are a hundredth of a micrometre, and so is what reading back may
    differ by."""
    files, _ = files_of(profile())
    tables = BECKHOFF.parse([files["volumetric_errors.csv"]], profile())
    assert {round(table.quantum_um, 9) for table in tables} == {0.01}


def test_a_quick_look_numbers_the_axes_as_they_are_usually_named():
    assert BECKHOFF.quick_options().axis_numbers == {"X": 1, "Y": 2, "Z": 3}


def test_two_masters_for_one_slave_are_refused():
    """One list holds one master axis; the volumetric file holds all."""
    with pytest.raises(SafetyError, match="EXY and EXZ") as refused:
        files_of(profile(way="lists", cross_sense="as-error"), ["EXY", "EXZ"])
    assert refused.value.code == "control-full.cross-table"


def test_the_sense_of_the_cross_table_is_asked():
    """No page of the manual states it: planning and reading ask for the sign test's word."""
    with pytest.raises(
        UsageError,
        match=r"beckhoff\.cross_sense: expected \"as-error\" or \"as-compensation\"",
    ):
        files_of(profile(way="lists"), ["EXY"])
    files, _ = files_of(profile(way="lists", cross_sense="as-error"), ["EXY"])
    with pytest.raises(UsageError, match=r"beckhoff\.cross_sense"):
        BECKHOFF.parse(list(files.values()), profile(way="lists"))


@pytest.mark.parametrize(
    ("name", "data", "message"),
    [
        ("v.csv", "X EXX EYX\n0.0 0.001\n", r"v\.csv: line 2: expected 3 numbers"),
        (
            "v.csv",
            "X EXX\n0.0 0.001\n",
            r"expected two or more rows with rising positions, found 1 rows",
        ),
        ("v.csv", "X EXX\n10.0 0.001\n0.0 0.001\n", r"rising positions"),
        (
            "v.csv",
            "X EXX EAX\n0.0 0.0 0.0\n10.0 0.0 0.00001\n",
            r"expected EAX = 0: the levers of this angle are unknown",
        ),
        ("v.csv", "X EXY\n0.0 0.0\n10.0 0.0\n", r"expected components of X, found EXY"),
        ("v.csv", "X EXX\n0.0 0.0\n10.0 0.0\n#\n", r"found an empty block"),
        (
            "a.lis",
            "kopf.achs_nr 9\nkw.ssfk.unit 1\n",
            r"a\.lis: line 1: expected kopf\.achs_nr with a logical axis number",
        ),
        (
            "a.lis",
            "kopf.achs_nr 1\nkw.ssfk.unit 0\nkw.ssfk.kw_nr_max 3\n",
            r"expected unit 1 \(0\.1 µm\), found encoder increments",
        ),
        (
            "a.lis",
            "kopf.achs_nr 1\nkw.ssfk.unit 1\nkw.ssfk.unit 1\n",
            r"line 3: expected a new key",
        ),
        (
            "a.lis",
            "kopf.achs_nr 1\nkw.ssfk.kw_nr_max 3\nkw.ssfk.unit 1\nkw.ssfk.interval 5\n",
            r"expected kw\.ssfk\.kw_startpos, found nothing",
        ),
        (
            "a.lis",
            "kopf.achs_nr 1\nkw.crosscomp.unit 1\nkw.crosscomp.last_index 1\n",
            r"logical number of another axis as master, found nothing",
        ),
    ],
)
def test_damaged_and_foreign_files_are_named(name, data, message):
    """File and line, what was found and expected; never numbers from a part."""
    with pytest.raises(DataError, match=message):
        BECKHOFF.parse(
            [ControlFile(name=name, data=data.encode())],
            profile(way="lists", cross_sense="as-error"),
        )
