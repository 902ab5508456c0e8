"""The virtual controls apply the worked examples of the controllers' reference (section 12) by
their own laws."""

import numpy as np
import pytest

from stepdiag.virtual.control.compensation import load_files
from stepdiag.virtual.control.fanuc import load_fanuc
from stepdiag.virtual.control.linuxcnc import load_matrix, load_screw_file
from stepdiag.virtual.control.siemens import load_siemens
from stepdiag.virtual.physics.error_functions import ErrorSet, Table, random_errors
from stepdiag.virtual.physics.machine import Machine
from testkit.exact.siemens_files import CEC_GOLDEN, EEC_GOLDEN

NODES = (-200.0, -100.0, 0.0, 100.0, 200.0)
SCREW = ErrorSet(
    low_mm=(-200.0, 0.0, 0.0),
    size_mm=(400.0, 400.0, 300.0),
    functions={"EXX": Table(NODES, (4.0, 1.0, 0.0, -2.0, -5.0))},
)
"""The screw of the worked examples: too short everywhere."""

FANUC_NEW = (
    "%\r\n(CNCID=VIRTUAL)\r\nN03605Q1A1P00000000A2P00000000\nN03620Q1A1P40\r\nN03621Q1A1P39\n"
    "N03622Q1A1P42\n"
    "N03623Q1A1P1\nN03624Q1A1P100.0\nN10001Q1A1P77\nN10039Q0P3\n\r\rN10040Q0P1\nN10041Q0P2\n"
    "N10042Q0P3\n%\n"
)
FANUC_OLD = (
    "%\nN03620 A1 P 40\nN03621 A1 P 39\nN03622 A1 P 42\nN03623 A1 P 1\nN03624 A1 P 100000\n"
    "N10039 P 3\nN10040 P 1\nN10041 P 2\nN10042 P 3\n%\n"
)
COMP = (
    "-200 -199.996 -199.996\n-100  -99.999  -99.999\n0 0 0\n100 99.998 99.998\n200 199.995 "
    "199.995\n"
)


def error_x(tables, position, direction=0.0):
    points = np.zeros((len(position), 3))
    points[:, 0] = position
    machine = Machine(errors=SCREW, reference_mm=(0.0, 0.0, 0.0), compensations=tables)
    return machine.error_at(points, direction=np.full(3, direction))[:, 0]


@pytest.mark.parametrize(
    "tables",
    [
        load_siemens(EEC_GOLDEN),
        load_fanuc([FANUC_NEW]),
        load_fanuc([FANUC_OLD]),
        load_screw_file(COMP, 0),
    ],
    ids=["siemens", "fanuc-new", "fanuc-old", "linuxcnc"],
)
def test_the_worked_screw_is_straight_at_every_node(tables):
    """Controllers 12.1, 12.2, 12.4: residual 0 at all five points; the wrong sense would double the
    error."""
    assert error_x([], NODES) == pytest.approx([4.0, 1.0, 0.0, -2.0, -5.0])
    assert error_x(tables, NODES) == pytest.approx(0.0, abs=1e-3)


def test_fanuc_steps_at_the_points_and_interpolates_only_when_told():
    between = np.array([50.0, 199.0, 260.0, -260.0])
    stepped, smooth = (load_fanuc([FANUC_NEW], interpolated=flag) for flag in (False, True))
    assert error_x(stepped, between) == pytest.approx([-1.0, -4.97 + 2.0, 0.0, 0.0], abs=1e-3)
    assert error_x(smooth, between) == pytest.approx([0.0, 0.0, 0.0, 0.0], abs=1e-3)


def test_fanuc_bidirectional_tables_act_by_direction():
    """3605#0 = 1: the second block begins at 3626 and is anchored by 3627 at the reference."""
    more = (
        "%N03605Q1A1P00000001\nN03626Q1A1P139\nN03627Q1A1P4\nN10139Q0P0\nN10140Q0P0\nN10141Q0P0\n"
        "N10142Q0P0\n%"
    )
    tables = load_fanuc([FANUC_NEW, more])
    assert error_x(tables, [200.0], 1.0) == pytest.approx(0.0, abs=1e-3)
    assert error_x(tables, [200.0], -1.0) == pytest.approx(-5.0 + 4.0, abs=1e-3)


def test_a_stray_percent_ends_the_reading():
    """Controllers 2.6: 258 lines were lost in one real file."""
    with pytest.raises(ValueError, match="pitch point 41: expected a value"):
        load_fanuc([FANUC_NEW.replace("N10041", "%N10041")])


def test_siemens_cross_table_moves_the_other_axis_against_the_table_and_holds_its_ends():
    """Controllers 12.3: the table is the error (T = e)."""
    (table,) = load_siemens(CEC_GOLDEN)
    points = np.array([[0.0, 5.0, 0.0], [150.0, 5.0, 0.0], [900.0, 5.0, 0.0]])
    assert table.correction_mm(points, np.ones((3, 3))) == pytest.approx(
        np.array([[0, 0, 0], [0, -0.00325, 0], [0, -0.004, 0]]), abs=1e-12
    )


def test_siemens_directional_tables_add_up_to_their_mean():
    forward = load_siemens(CEC_GOLDEN.replace("DIRECTION[0]=0", "DIRECTION[0]=1"))[0]
    point = np.array([[200.0, 0.0, 0.0]])
    by_direction = [
        forward.correction_mm(point, np.full((1, 3), sign))[0, 1] for sign in (1.0, 0.0, -1.0)
    ]
    assert by_direction == pytest.approx([-0.004, -0.002, 0.0])


def test_siemens_multiplies_by_the_table_with_the_next_number():
    second = (
        CEC_GOLDEN.replace("[0,", "[1,")
        .replace("[0]", "[1]")
        .replace("MULT_BY_TABLE[1]=0", "MULT_BY_TABLE[1]=1")
    )
    (product,) = load_siemens(
        CEC_GOLDEN + second
    )  # linked tables give their product alone (K3 p. 252)
    point = np.array([[200.0, 0.0, 0.0]])
    assert product.correction_mm(point, np.zeros((1, 3)))[0, 1] == pytest.approx(
        -0.004 * 0.004
    )


def test_siemens_program_switches_off_and_on_again():
    program = (
        "$MA_ENC_COMP_ENABLE[0,AX1]=0\nNEWCONF\n"
        + EEC_GOLDEN
        + "$MA_ENC_COMP_ENABLE[0,AX1]=1\nNEWCONF\n"
    )
    assert len(load_siemens(program)) == 1
    assert load_siemens(EEC_GOLDEN + "$MA_ENC_COMP_ENABLE[0,AX1]=0\n") == []
    assert load_siemens(CEC_GOLDEN + "$MA_CEC_ENABLE[AX2]=FALSE\n") == []
    assert load_siemens(EEC_GOLDEN, measuring_system=1) == []


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        (
            "$AA_ENC_COMP[0,3,AX1]=-0.0020\n",
            "",
            r"\$AA_ENC_COMP\[0,3,AX1\]: expected an assignment",
        ),
        ("STEP[0,AX1]=100.0", "STEP[0,AX1]=90.0", "whole number of steps"),
        ("MODULO[0,AX1]=0", "MODULO[0,AX1]=1", "expected 0 on a linear axis"),
    ],
)
def test_siemens_refuses_what_would_go_wrong_silently(old, new, message):
    with pytest.raises(ValueError, match=message):
        load_siemens(EEC_GOLDEN.replace(old, new))


def test_linuxcnc_ends_at_the_first_foreign_line_and_takes_trims_as_they_are():
    """usrmotLoadComp: the first line without three numbers ends the file; a positive trim moves the
    motor in +."""
    forward, reverse = load_screw_file(
        "0 0.001 -0.002\n10 0.001 -0.002\n# end\n20 9 9\n", 1, kind=1
    )
    assert forward.position_mm == (0.0, 10.0)
    point = np.zeros((1, 3))
    assert forward.correction_mm(point, np.full((1, 3), 1.0))[0] == pytest.approx(
        [0.0, 0.001, 0.0]
    )
    assert reverse.correction_mm(point, np.full((1, 3), -1.0))[0] == pytest.approx(
        [0.0, -0.002, 0.0]
    )


def test_linuxcnc_refuses_what_the_source_refuses():
    with pytest.raises(ValueError, match="ascending"):
        load_screw_file("0 0 0\n0 1 1\n", 0)
    with pytest.raises(ValueError, match="at most 256"):
        load_screw_file("".join(f"{n} {n} {n}\n" for n in range(257)), 0)
    with pytest.raises(ValueError, match="expected one value per position"):
        load_screw_file("; a header\n0 0 0\n", 0)


def test_matrix_kinematics_take_the_squareness_out():
    """X_joint = C_xx X + C_xy Y: a Y axis leaning to -X by C0Y needs C_xy = +C0Y."""
    leaning = ErrorSet(
        low_mm=(0.0, 0.0, 0.0), size_mm=(500.0, 400.0, 300.0), squareness_urad={"C0Y": 50.0}
    )
    tables = load_matrix("setp matrixkins.C_xx 1.0\nsetp matrixkins.C_xy 0.00005\n")
    point = np.array([[100.0, 400.0, 0.0]])
    assert Machine(errors=leaning).error_at(point)[0, 0] == pytest.approx(-20.0)
    assert Machine(errors=leaning, compensations=tables).error_at(point) == pytest.approx(
        0.0, abs=1e-6
    )


def eec_and_cec(truth):
    """Return the tables that the manual's law wants for a known machine: T = e, squareness in EXY,
    EXZ and EYZ."""
    lean = {
        "EXY": -truth.squareness_urad["C0Y"],
        "EXZ": truth.squareness_urad["B0Z"],
        "EYZ": -truth.squareness_urad["A0Z"],
    }
    text = ""
    for table, name in enumerate(name for name in truth.errors if name[1] in "XYZ"):
        nodes = truth.position_mm[name[2]]
        values = (truth.errors[name] + lean.get(name, 0.0) * (nodes - nodes[0]) * 1e-3) * 1e-3
        own = name[1] == name[2]
        array, index = (
            ("$AA_ENC_COMP", f"0,%s,{name[2]}1") if own else ("$AN_CEC", f"{table},%s")
        )
        bare = index.replace("%s,", "").replace(",%s", "")
        text += "".join(
            f"{array}[{index % node}]={value:.7f}\n" for node, value in enumerate(values)
        )
        text += (
            f"{array}_STEP[{bare}]={nodes[1] - nodes[0]}\n{array}_MIN[{bare}]={nodes[0]}\n{array}"
            f"_MAX[{bare}]={nodes[-1]}\n"
        )
        if not own:
            text += (
                f"$AN_CEC_INPUT_AXIS[{bare}]=({name[2]}1)\n$AN_CEC_OUTPUT_AXIS[{bare}]=({name[1]}"
                "1)\n"
            )
    return load_siemens(text)


def test_the_truth_loaded_by_the_law_leaves_only_what_lies_between_the_nodes():
    """Squareness, scales and straightness of a random machine: everywhere in the volume below a
    tenth of what it was."""
    low, size = (-100.0, 50.0, 0.0), (500.0, 400.0, 300.0)
    errors = random_errors(11, low, size)
    points = np.random.default_rng(1).uniform(low, np.add(low, size), size=(500, 3))
    before = Machine(errors=errors).error_at(points)
    tables = eec_and_cec(Machine(errors=errors).truth(20))
    after = Machine(errors=errors, compensations=tables).error_at(points)
    after = after - Machine(errors=errors, compensations=tables).error_at(np.array([low]))
    assert np.sqrt(np.mean(np.sum(before**2, axis=1))) > 10.0
    assert np.max(np.abs(after)) < 1.0


def test_files_are_loaded_by_the_law_of_their_control(tmp_path):
    for name, text in (
        ("AX_EEC.INI", EEC_GOLDEN),
        ("screwcompX.dat", COMP),
        ("y_axis.comp", COMP),
        ("squareness.hal", "setp matrixkins.C_xz 1e-5"),
    ):
        (tmp_path / name).write_text(text, encoding="ascii")
    assert error_x(load_files("siemens", [tmp_path / "AX_EEC.INI"]), NODES) == pytest.approx(
        0.0, abs=1e-3
    )
    tables = load_files(
        "linuxcnc",
        [tmp_path / name for name in ("screwcompX.dat", "y_axis.comp", "squareness.hal")],
    )
    assert [table.output_axis for table in tables] == [0, 0, 1, 1, 0]
    (tmp_path / "screw.comp").write_text(COMP, encoding="ascii")
    with pytest.raises(ValueError, match=r"screw\.comp: expected an axis"):
        load_files("linuxcnc", [tmp_path / "screw.comp"])
