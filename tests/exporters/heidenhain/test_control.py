"""Heidenhain .COM and .CMA: both generations, assignment, the control's own column widths,
limits."""

from dataclasses import replace

import msgspec
import numpy as np
import pytest

from stepdiag.base.errors import DataError, SafetyError, UsageError
from stepdiag.base.volume import Volume
from stepdiag.exporters.files.control_file import ControlFile
from stepdiag.exporters.files.naming import UNTESTED, suffixed
from stepdiag.exporters.heidenhain.control import Heidenhain
from stepdiag.exporters.tables.curves import curves_of
from stepdiag.exporters.tables.tables import correction_um
from testkit.exact.machines import profile_of
from testkit.exact.results import VOLUME, made_result

HEIDENHAIN = Heidenhain()
RESULT = made_result({"EXX": [4.0, 1.0, 0.0, -2.0, -5.0], "EYX": [0.0, 1.5, 2.0, 1.0, 0.0]})


def profile(generation="tnc640", existing=(), **machine):
    plain = profile_of("heidenhain", VOLUME, reference_at=2)
    return replace(
        plain,
        options=msgspec.structs.replace(plain.options, generation=generation),
        machine=msgspec.structs.replace(plain.machine, **machine),
        existing=tuple(existing),
    )


def files_of(which, names=("EXX", "EYX"), result=RESULT):
    plan = HEIDENHAIN.plan(curves_of(result, names), which)
    return {file.name: file for file in HEIDENHAIN.render(plan.tables, which)}, plan


def cells(file):
    return [line.split() for line in file.data.decode("ascii").split("\r\n")[:-1]]


def test_newer_generation():
    """MANUALplus 620 p. 716: AXISPOS from the machine datum, BACKLASH, a column for each axis;
    values are errors in mm."""
    files, _ = files_of(profile())
    assert cells(files["AXIS_AX1.COM"]) == [
        ["BEGIN", "AXIS_AX1.COM", "MM"],
        ["NR", "AXISPOS", "BACKLASH", "AX1", "AX2", "AX3"],
        ["0", "-200.0000", "+0.0000", "+0.0040", "-0.0020", "+0.0000"],
        ["1", "-100.0000", "+0.0000", "+0.0010", "-0.0005", "+0.0000"],
        ["2", "+0.0000", "+0.0000", "+0.0000", "+0.0000", "+0.0000"],
        ["3", "+100.0000", "+0.0000", "-0.0020", "-0.0010", "+0.0000"],
        ["4", "+200.0000", "+0.0000", "-0.0050", "-0.0020", "+0.0000"],
        ["[END]"],
    ]
    assert cells(files["CONFIG.CMA"]) == [
        ["BEGIN", "CONFIG.CMA", "MM"],
        ["NR", "ACTIVE", "AX1", "AX2", "AX3"],
        ["0", "*", "AXIS_AX1.COM"],
        ["[END]"],
    ]


def test_older_generation():
    """iTNC 530: the first line says DATUM and DISTANCE, the rows have no position."""
    files, _ = files_of(profile("itnc530"))
    first, heading, row = cells(files["AXIS-AX1.COM"])[:3]
    assert first == ["BEGIN", "AXIS-AX1.COM", "DATUM:-200.0000", "DISTANCE:+100.0000", "MM"]
    assert heading == ["NR", "AX1", "AX2", "AX3"]
    assert row == ["0", "+0.0040", "-0.0020", "+0.0000"]


@pytest.mark.parametrize("generation", ["tnc640", "itnc530"])
def test_the_cma_says_which_axis_each_table_is_for(generation):
    """[axis in the column of .COM] = F([axis in the column of .CMA]) (MANUALplus 620 p. 718)."""
    which = profile(generation)
    files, _ = files_of(which, ("EYX", "EZZ"))
    tables = HEIDENHAIN.parse([file for file in files.values() if file.role == "data"], which)
    assert {(table.input_axis, table.place["file"]) for table in tables} == {
        ("X", next(name for name in files if "AX1" in name)),
        ("Z", next(name for name in files if "AX3" in name)),
    }
    moved = [
        float(correction_um(table, np.array([-200.0]))[0])
        for table in tables
        if table.name == "EYX"
    ]
    assert moved == pytest.approx([2.0])


def test_the_warning_in_a_file_name_is_seen_through():
    """An export marks untested files in their names; read back, they are the tables that the .CMA
    calls."""
    which = profile()
    files, _ = files_of(which)
    marked = [
        replace(file, name=suffixed(file.name, UNTESTED))
        for file in files.values()
        if file.role == "data"
    ]
    assert [table.label for table in HEIDENHAIN.parse(marked, which)] == [
        table.label for table in HEIDENHAIN.parse(list(files.values()), which)
    ]
    assert len(HEIDENHAIN.parse(marked[:1], which)) == 3


def test_column_widths_are_those_of_the_control():
    """A heading taken from the control's own file is kept to the letter, values stand under it."""
    own = "NR        AXISPOS    BACKLASH   AX1        AX2        AX3        "
    template = ControlFile(
        name="AXIS_AX1.COM", data=f"BEGIN AXIS_AX1.COM MM\r\n{own}\r\n[END]\r\n".encode()
    )
    files, plan = files_of(profile(existing=[template]))
    lines = files["AXIS_AX1.COM"].data.decode().split("\r\n")
    assert lines[1] == own.rstrip()
    assert lines[2].index("+0.0040") == own.index("AX1")
    assert "profile-assumed.columns" not in {finding.key for finding in plan.findings}
    assert "profile-assumed.columns" in {
        finding.key for finding in files_of(profile())[1].findings
    }


def test_columns_that_are_too_narrow_are_refused():
    """Two values that would run into one another would be read as something else."""
    own = "NR AXISPOS BACKLASH AX1 AX2 AX3"
    template = ControlFile(
        name="AXIS_AX1.COM", data=f"BEGIN AXIS_AX1.COM MM\r\n{own}\r\n[END]\r\n".encode()
    )
    with pytest.raises(SafetyError, match="columns wide enough") as refused:
        files_of(profile(existing=[template]))
    assert refused.value.code == "field-too-narrow.column"


def test_the_spacing_of_old_controls_is_a_power_of_two():
    """TNC 407 p. 153: 7 mm wanted, 2^16 x 0.1 µm = 6.5536 mm possible."""
    with pytest.raises(
        SafetyError, match=r"found 100 mm; the nearest values are 52\.4288 and 104\.858 mm"
    ):
        files_of(profile("tnc4xx"))
    fitting = Volume(
        origin_mm=(0.0, 0.0, 0.0), size_mm=(26.2144, 26.2144, 26.2144), increments=4
    )
    which = profile_of("heidenhain", fitting)
    which = replace(
        which, options=msgspec.structs.replace(which.options, generation="tnc4xx")
    )
    plan = HEIDENHAIN.plan(
        curves_of(made_result({"EXX": [0.0, 1.0, 2.0, 3.0, 4.0]}, volume=fitting), ["EXX"]),
        which,
    )
    limits = HEIDENHAIN.limits(plan.tables[0], which)
    assert (limits.points, limits.neighbour_um_mm) == (256, 15.625)


def test_two_directions_become_their_mean_and_a_remark():
    """The sense of the BACKLASH column is not public: it stays 0, and the reversal is named."""
    result = made_result({"EXX": [4.0, 1.0, 0.0, -2.0, -5.0]}, reversal={"EXX": [-6.0] * 5})
    files, plan = files_of(profile(direction="both"), ("EXX",), result)
    assert "EXX: the table contains the mean of both directions; the backlash" in next(
        f.text for f in plan.findings if f.key == "direction-averaged.written"
    )
    assert cells(files["AXIS_AX1.COM"])[2][3] == "+0.0040"


def test_damaged_and_foreign_files_are_named():
    """Truncated, in inches, a hole in the numbering, an axis nobody knows, a table that the .CMA
    calls but nobody gave."""
    which = profile()
    files, _ = files_of(which)
    text = files["AXIS_AX1.COM"].data.decode()

    def parse(*given):
        return HEIDENHAIN.parse(
            [ControlFile(name=name, data=data.encode()) for name, data in given], which
        )

    with pytest.raises(
        DataError,
        match=r"AXIS_AX1\.COM: expected heading, rows and \[END\], found no end of file",
    ):
        parse(("AXIS_AX1.COM", text.replace("[END]\r\n", "")))
    with pytest.raises(
        DataError,
        match=r"AXIS_AX1\.COM: expected heading, rows and \[END\], found no end of file",
    ):
        parse(("AXIS_AX1.COM", text.partition("\n")[0] + "\n[END]\r\n"))
    with pytest.raises(DataError, match=r"line 1: expected BEGIN <name> \.\. MM"):
        parse(("AXIS_AX1.COM", text.replace(" MM", " INCH", 1)))
    with pytest.raises(DataError, match=r"line 4: expected row 1 with 6 cells"):
        parse(("AXIS_AX1.COM", text.replace("\r\n1 ", "\r\n7 ")))
    with pytest.raises(DataError, match=r"line 3: expected a number, found '\+0\.00x0'"):
        parse(("AXIS_AX1.COM", text.replace("+0.0040", "+0.00x0")))
    with pytest.raises(
        UsageError, match=r"heading: expected an axis that the profile names, found AX9"
    ):
        parse(("AXIS_AX1.COM", text.replace("AX2", "AX9")))
    with pytest.raises(DataError, match=r"expected BACKLASH 0 in every row"):
        parse(("AXIS_AX1.COM", text.replace("+0.0000", "+0.0010", 1)))
    with pytest.raises(
        DataError,
        match=r"CONFIG\.CMA: expected AXIS_AX1\.COM, the table that the \.CMA file names for AX1, "
        r"found OTHER_AX1\.COM",
    ):
        parse(("OTHER_AX1.COM", text), ("CONFIG.CMA", files["CONFIG.CMA"].data.decode()))
    with pytest.raises(DataError, match=r"a name that ends with an axis"):
        parse(("SCREW.COM", text))


def test_points_half_a_millimetre_apart_are_read():
    which = profile_of("heidenhain", VOLUME, sections=800)
    plan = HEIDENHAIN.plan(
        curves_of(made_result({"EXX": [4.0, 1.0, 0.0, -2.0, -5.0]}), ["EXX"]), which
    )
    read = HEIDENHAIN.parse(HEIDENHAIN.render(plan.tables, which), which)
    assert np.diff(
        next(table for table in read if table.name == "EXX").position_mm
    ) == pytest.approx(0.5)
