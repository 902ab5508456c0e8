"""Etalon Exchange: what goes out comes back as the same machine; the page's own example is read;
damage is refused by its line."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from stepdiag.base.errors import DataError, UsageError
from stepdiag.base.result.field import error_field_um, without_rigid_motion
from stepdiag.base.result.result import DISPLACEMENTS, ROTATIONS, Result
from stepdiag.base.volume import grid_points_mm
from stepdiag.exporters.export.export import export
from stepdiag.exporters.files.control_file import ControlFile
from stepdiag.exporters.neutral import etalon
from testkit.exact.results import VOLUME, made_result

POINTS = grid_points_mm(VOLUME, 5)


def drawn(seed: int, chain: str) -> Result:
    rng, along = np.random.default_rng(seed), np.linspace(0.0, 1.0, 5)
    shapes = {
        name: 8 * rng.normal() * np.sin(np.pi * along)
        + (10 * along if name[1] == name[2] else 0)
        for name in DISPLACEMENTS
    }
    angles = {
        name: 10 * (rng.normal() * along + rng.normal() * np.sin(np.pi * along))
        for name in ROTATIONS
    }
    return made_result(
        shapes, squareness={"C0Y": 20.0, "B0Z": -9.0, "A0Z": 4.0}, angles=angles, chain=chain
    )


@settings(max_examples=15)
@given(seed=st.integers(0, 10_000), chain=st.sampled_from(["FXYZ", "XFYZ", "XYFZ", "ZYXF"]))
def test_what_goes_out_comes_back_as_the_same_machine(seed: int, chain: str) -> None:
    """The levers count from another point in between; the field is the same, up to where the
    workpiece lies."""
    result = drawn(seed, chain)
    back = etalon.parse(etalon.render(result), chain)
    apart = error_field_um(back, POINTS) - error_field_um(result, POINTS)
    assert np.max(np.abs(without_rigid_motion(VOLUME, POINTS, apart))) < 2e-3
    for name, quantity in result.squareness.items():
        assert back.squareness[name].value == pytest.approx(quantity.value, abs=2e-3)


def test_angles_that_do_not_begin_at_zero_give_their_lever_to_the_squareness() -> None:
    text = "".join(
        f"[{name}]\nGridpoints = {{\n0 0\n100 0\n}}\n" for name in ("EXX", "EYY", "EZZ")
    )
    text += "[ECX]\nGridpoints = {\n0 0.000010\n100 0.000010\n}\n"
    found = etalon.parse(ControlFile(name="t.txt", data=text.encode()), "FXYZ")
    assert found.squareness["C0Y"].value == pytest.approx(
        10.0
    )  # X turned by 10 urad about Z carries Y by dX = -ECX y
    assert found.errors["ECX"].value == pytest.approx([0.0, 0.0])


def test_the_example_of_the_page_is_read() -> None:
    """infosys 296430091: comments behind rows and braces, indented rows."""
    zeros = "".join(
        f"[{name}]\nGridpoints = {{\n-280.0 0\n270.0 0\n}}\n"
        for name in ("EXX", "EYY", "EZZ")
    )
    page = (
        "// Every parameter in a block\n[C0Y]\nVALUE = 0.000022355737\n[EXY]\nGridpoints = {\n   "
        " -280.0 -0.0013586\n   // more\n"
    )
    found = etalon.parse(
        ControlFile(
            name="t.txt",
            data=(page + "    270.0 -0.0003162\n}  // end of EXY\n" + zeros).encode(),
        ),
        "FXYZ",
    )
    slope_urad = (-0.3162 + 1.3586) / 550 * 1e3
    assert found.squareness["C0Y"].value == pytest.approx(22.355737 - slope_urad, abs=1e-6)


@pytest.mark.parametrize(
    ("old", "new"),
    [
        (
            "}\n",
            "",
        ),
        ("[EYY]", "[EXX]"),
        ("[EYY]", "[EQQ]"),
        ("100 0", "100"),
        ("100 0", "100 nan"),
        ("100 0", "-5 0"),
        ("Gridpoints = {", "Gridpoints {"),
        ("[EZZ]", "[EAZ]"),
    ],
)
def test_damage_is_refused(old: str, new: str) -> None:
    text = "".join(
        f"[{name}]\nGridpoints = {{\n0 0\n100 0\n}}\n" for name in ("EXX", "EYY", "EZZ")
    )
    with pytest.raises(DataError, match=r"t\.txt"):
        etalon.parse(
            ControlFile(name="t.txt", data=text.replace(old, new, 1).encode()), "FXYZ"
        )


def test_the_chain_is_asked() -> None:
    with pytest.raises(UsageError, match="chain"):
        etalon.parse(etalon.render(drawn(1, "FXYZ")), "FXY")


def test_is_exported_without_a_profile(tmp_path) -> None:
    report = export(drawn(2, "FXYZ"), "etalon", None, out_dir=tmp_path)
    assert etalon.FILE_NAME in report.files
    assert (
        etalon.parse(
            ControlFile(name="e.txt", data=(tmp_path / etalon.FILE_NAME).read_bytes()), "FXYZ"
        ).chain
        == "FXYZ"
    )
