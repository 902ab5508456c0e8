"""LinuxCNC: the whole error field through a kinematics component of ours, which reads the lattice when the control starts.

LinuxCNC has no volumetric compensation; a kinematics module is the place for one, because it alone sees all axes at once.
``stepdiagkins.c`` stands in for ``trivkins``: it is built on the control with ``halcompile`` (package linuxcnc-uspace-dev). What it does to
the joints is in its source, so its sense is known and not a claim to be tested. The lattice holds the mean of both directions: reversal is
left to ``BACKLASH``, which a COMP_FILE would switch off.
"""

import math
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path

from stepdiag.exporters.files.control_file import ControlFile
from stepdiag.exporters.files.listing import ascii_lines
from stepdiag.exporters.tables import lattice
from stepdiag.exporters.tables.lattice import Lattice
from stepdiag.exporters.tables.profile import Profile
from stepdiag.solver.errors import SafetyError, UsageError
from stepdiag.solver.geometry.volume import Vector

MOST_VERTICES = 65536
"""As many as the component has room for."""
SOURCE = "stepdiagkins.c"
HAL = "stepdiagkins.hal"
INI = "ini_lines.txt"
TITLE = "LinuxCNC (kinematics component with a lattice over the volume)"


def require_room(axes_mm: Sequence[Vector], profile: Profile) -> None:
    """Raise ``SafetyError`` for a lattice on these axes that the component has no room for."""
    vertices = math.prod(len(axis) for axis in axes_mm)
    if vertices > MOST_VERTICES:
        raise SafetyError(
            f"{profile.source}: axes",
            code="points-beyond-limit",
            expected=f"at most {MOST_VERTICES} vertices",
            found=str(vertices),
            remedy="take larger steps: three or four to each measured section are plenty",
        )


def control_files(held: Lattice, profile: Profile, joints: Mapping[str, Sequence[int]]) -> tuple[ControlFile, ...]:
    """Return the lattice, the component's source, its HAL lines, and the lines for the INI file as a note.

    Raises ``UsageError`` for joints that have a gap.
    """
    hal = ascii_lines(["addf stepdiagkins.update servo-thread", "setp stepdiagkins.enable 1"])
    ini = ascii_lines(_ini_lines(coordinates(joints, profile), held.vectors_um[..., 0].size, inch=profile.machine.units == "inch"))
    return (
        lattice.render(held),
        ControlFile(name=SOURCE, data=Path(__file__).with_name(SOURCE).read_bytes(), role="program"),
        ControlFile(name=HAL, data=hal, role="program"),
        ControlFile(name=INI, data=ini, role="note"),
    )


def coordinates(joints: Mapping[str, Sequence[int]], profile: Profile) -> str:
    """Return the axis letter of each joint in order, ``XYYZ``. Raises ``UsageError`` where a joint has no letter, or two."""
    letters = {joint: letter for letter, each in joints.items() for joint in each}
    numbers = sorted(joint for each in joints.values() for joint in each)
    if numbers != list(range(len(numbers))) or not all(joints.get(letter) for letter in "XYZ"):
        raise UsageError(
            f"{profile.source}: linuxcnc.joints",
            expected="all joints of the machine, each once, from 0: { X = [0], Y = [1, 2], Z = [3], A = [4] }",
            found=str({letter: list(each) for letter, each in joints.items()}),
        )
    return "".join(letters[number] for number in numbers)


def _ini_lines(letters: str, vertices: int, *, inch: bool) -> Iterator[str]:
    unit = " inch=1" if inch else ""
    yield from ("[KINS]", f"KINEMATICS = stepdiagkins coordinates={letters} lattice=lattice.csv vertices={vertices}{unit}")
    yield from ("[HAL]", f"HALFILE = {HAL}")


def instructions(profile: Profile) -> tuple[str, ...]:
    """Return the steps for the person who maintains the configuration."""
    return (
        f"Back up the configuration folder. Its unit is {profile.machine.units}; the lattice is in mm and um, the component converts it.",
        f"Once for each LinuxCNC version: apt install linuxcnc-uspace-dev, then sudo halcompile --install {SOURCE}.",
        f"Copy lattice.csv and {HAL} beside the INI file.",
        f"Put the KINEMATICS line of {INI} in the place of the present one, and its HALFILE line after the others.",
        "Take every COMP_FILE line out: the lattice holds the positioning errors too. BACKLASH stays as it is.",
        "Start LinuxCNC. It does not start with a damaged lattice: the reason stands in the terminal. Home all axes.",
        "halcmd show pin stepdiagkins: weight rises to 1, no joint faster than stepdiagkins.slew-um-per-second.",
        "setp stepdiagkins.enable 0 brings the machine back to where it was, and 1 again; the positions on the screen do not change.",
        "Measure again; if the residual has grown, put the old KINEMATICS line back and take the HALFILE line out.",
    )
