"""What is loaded into a real control: profile, COMP_FILEs of a result, and any movement as a
lattice for the product's component."""

from pathlib import Path

import numpy as np

from stepdiag.base.result.result import Result
from stepdiag.base.volume import Volume
from stepdiag.exporters.export.export import export
from stepdiag.exporters.files.naming import UNTESTED, suffixed
from stepdiag.exporters.linuxcnc.control import LinuxCnc
from stepdiag.exporters.profiles.file import load_profile
from stepdiag.exporters.tables import lattice
from stepdiag.exporters.tables.tables import total_correction_um


def profile_text(way: str, volume: Volume) -> str:
    """Return the profile of the control for COMP_FILEs or for the kinematics component."""
    steps = {
        letter: size / (2 * volume.increments)
        for letter, size in zip("XYZ", volume.size_mm, strict=True)
    }
    axes = [
        f'[axes.{letter}]\nname = "{letter}"\nstep_mm = {steps[letter]}\nreference_mm = '
        f"{low}\nbacklash_um = 0.0"
        for letter, low in zip("XYZ", volume.origin_mm, strict=True)
    ]
    machine = (
        '[machine]\nname = "LinuxCNC, simulated axes"\ncontroller = "linuxcnc"\nmeasured_with = '
        '"off"'
    )
    limits, joints = (
        "[limits]\nslope_um_mm = 1.0",
        f'[linuxcnc]\njoints = {{ X = [0], Y = [1], Z = [2] }}\nway = "{way}"',
    )
    return "\n".join([machine, *axes, limits, joints, ""])


def screw_files(result: Result, folder: Path) -> tuple[dict[str, bytes], lattice.Lattice]:
    """Return the COMP_FILEs of the same result by axis, and the movement of its matrixkins
    coefficients as a lattice.

    Debian's LinuxCNC has no matrixkins: the same straight lines go through our component.
    """
    (folder / "screw.toml").write_text(profile_text("screw", result.volume), encoding="utf-8")
    profile = load_profile(folder / "screw.toml", LinuxCnc(), result.volume)
    report = export(
        result, "linuxcnc", profile, out_dir=folder / "screw", accept=("sign-untested",)
    )
    comp = {
        letter: (
            folder / "screw" / suffixed(f"screw_{letter.lower()}.comp", UNTESTED)
        ).read_bytes()
        for letter in "XYZ"
    }
    axes = tuple(
        np.array([low, low + size])
        for low, size in zip(result.volume.origin_mm, result.volume.size_mm, strict=True)
    )
    corners = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1)
    moved = total_correction_um(
        [table for table in report.tables if table.kind == "matrixkins"],
        corners.reshape(-1, 3),
    )
    return comp, lattice.Lattice(axes_mm=axes, vectors_um=moved.reshape(corners.shape))


def lattice_file(held: lattice.Lattice) -> dict[str, bytes]:
    """Return a lattice with the INI line that loads it, in the place of those of an export."""
    rows = held.vectors_um[..., 0].size
    ini = (
        "[KINS]\nKINEMATICS = stepdiagkins coordinates=XYZ lattice=lattice.csv "
        f"vertices={rows}\n[HAL]\nHALFILE = stepdiagkins.hal\n"
    )
    return {"lattice.csv": lattice.render(held).data, "ini_lines.txt": ini.encode()}
