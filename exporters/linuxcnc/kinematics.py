"""LinuxCNC: compensation of the whole error field by the kinematics component of stepdiag, which
reads a lattice when the control starts.

LinuxCNC has no volumetric compensation. A kinematics module can provide volumetric compensation,
because this module processes all axes together. The component ``stepdiagkins.c`` replaces
``trivkins``; ``halcompile`` (package linuxcnc-uspace-dev) builds it on the control. The source code
of the component shows its effect on the joints, so no sign test is needed. The lattice contains the
mean of both directions. ``BACKLASH`` corrects the reversal; a COMP_FILE would switch ``BACKLASH``
off.

LinuxCNC compares the limits of an axis ([AXIS_L]) with its command, and the limits of a joint
([JOINT_n]) with the output of the kinematics. At the ends of the travel, the correction moves a
joint beyond the limits of its axis. So the joint limits are widened by the largest correction.
"""

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from stepdiag.base.errors import SafetyError
from stepdiag.base.findings import Finding, warning
from stepdiag.base.messages import message
from stepdiag.base.volume import Vector
from stepdiag.exporters.files.control_file import ControlFile
from stepdiag.exporters.files.listing import ascii_lines
from stepdiag.exporters.linuxcnc.ini import (
    COMPONENT_HAL,
    NAME,
    Joints,
    Naming,
    back,
    change,
    named_by,
    unless_named,
)
from stepdiag.exporters.tables import lattice
from stepdiag.exporters.tables.lattice import Lattice
from stepdiag.exporters.tables.profile import Profile

MOST_VERTICES = 65536
"""Largest number of vertices that the component can store."""
SOURCE = "stepdiagkins.c"
HAL = COMPONENT_HAL
TITLE = "LinuxCNC (kinematics component with a lattice over the volume)"


def require_room(axes_mm: Sequence[Vector], profile: Profile) -> None:
    """Raise ``SafetyError`` if a lattice on these axes is too large for the component."""
    vertices = math.prod(len(axis) for axis in axes_mm)
    if vertices > MOST_VERTICES:
        raise SafetyError(
            f"{profile.source}: axes",
            code="control-full.points",
            expected=message("vertices-at-most", count=MOST_VERTICES),
            found=str(vertices),
            remedy=message("larger-steps"),
        )


def control_files(held: Lattice, profile: Profile, joints: Joints) -> tuple[ControlFile, ...]:
    """Return the lattice, the source code of the component, its HAL lines, and a note with the
    lines for the INI file.

    The note lists the machine's own COMP_FILEs and coefficients for removal, because they would act
    in addition to the lattice. The note also contains wider limits of the joints. Raises
    ``UsageError`` for joint numbers with a gap.
    """
    file = lattice.render(held)
    before, after = (_naming(files, profile, joints) for files in (profile.existing, (file,)))
    notes = (
        *unless_named(before, profile.machine.measured_with),
        *_limits_unstated(held, profile, joints),
    )
    hal = ascii_lines(["addf stepdiagkins.update servo-thread", "setp stepdiagkins.enable 1"])
    return (
        file,
        ControlFile(
            name=SOURCE, data=Path(__file__).with_name(SOURCE).read_bytes(), role="program"
        ),
        ControlFile(name=HAL, data=hal, role="program"),
        change(before, after, notes),
    )


def restore_files(held: Lattice, profile: Profile, joints: Joints) -> tuple[ControlFile, ...]:
    """Return the machine's own files, the lines for the INI file, and a lattice of zeros if the
    machine had no lattice.
    """
    file = lattice.render(held)
    before, after = (_naming(files, profile, joints) for files in (profile.existing, (file,)))
    had_lattice = any(map(lattice.recognises, profile.existing))
    zeros = (
        ()
        if had_lattice
        else (lattice.render(replace(held, vectors_um=np.zeros(held.vectors_um.shape))),)
    )
    notes = (
        *unless_named(before, profile.machine.measured_with),
        *_limits_unstated(held, profile, joints),
    )
    return (*profile.existing, *zeros, back(before, after, notes))


def room_findings(held: Lattice, profile: Profile) -> Iterator[Finding]:
    """Yield a warning for each axis whose joint would leave the travel although the axis stays
    within its travel.
    """
    for index, (letter, at) in enumerate(zip("XYZ", held.axes_mm, strict=True)):
        travel = profile.axis(letter).travel_mm
        if travel is None:
            continue
        joint_mm = (
            np.moveaxis(held.vectors_um[..., index], index, 0).reshape(len(at), -1) / 1000.0
            + at[:, None]
        )
        inside = joint_mm[(at >= travel[0]) & (at <= travel[1])]
        if inside.size and (inside.min() < travel[0] or inside.max() > travel[1]):
            reached = {
                "low_mm": float(inside.min()),
                "high_mm": float(inside.max()),
                "first_mm": travel[0],
                "last_mm": travel[1],
            }
            yield warning("beyond-travel.corrected", axis=letter, file=NAME, **reached)


def _naming(files: Sequence[ControlFile], profile: Profile, joints: Joints) -> Naming:
    named = named_by(
        files, joints, inch=profile.machine.units == "inch", source=profile.source
    )
    held = next((lattice.parse(file) for file in files if lattice.recognises(file)), None)
    return replace(named, limits=_limits(held, profile, joints))


def _limits(
    held: Lattice | None, profile: Profile, joints: Joints
) -> Mapping[int, tuple[float, float]]:
    unit = 25.4 if profile.machine.units == "inch" else 1.0
    limits: dict[int, tuple[float, float]] = {}
    for index, letter in enumerate("XYZ"):
        travel = profile.axis(letter).travel_mm
        if travel is not None:
            more = 0.0 if held is None else _largest_mm(held, index)
            limits |= dict.fromkeys(
                joints.get(letter, ()), ((travel[0] - more) / unit, (travel[1] + more) / unit)
            )
    return limits


def _limits_unstated(held: Lattice, profile: Profile, joints: Joints) -> Iterator[str]:
    for index, letter in enumerate("XYZ"):
        if profile.axis(letter).travel_mm is None:
            names = ", ".join(f"[JOINT_{joint}]" for joint in joints.get(letter, ()))
            more = _largest_mm(held, index)
            yield (
                f"{names}: axes.{letter}.travel_mm is not stated; the lattice needs MIN_LIMIT "
                f"and MAX_LIMIT {more:.3f} mm further out."
            )


def _largest_mm(held: Lattice, axis: int) -> float:
    return (math.floor(float(np.max(np.abs(held.vectors_um[..., axis])))) + 1) / 1000.0


def instructions(profile: Profile) -> tuple[str, ...]:
    return (
        (
            f"Back up the configuration folder. Its unit is {profile.machine.units}; the lattice "
            "is "
            "in mm and µm, the component converts it."
        ),
        (
            "Once for each LinuxCNC version: apt install linuxcnc-uspace-dev, then sudo halcompile "
            f"--install {SOURCE}."
        ),
        f"Copy lattice.csv and {HAL} beside the INI file.",
        (
            f"Change the INI file as {NAME} says: its KINEMATICS line in the place of the present "
            "one, its HALFILE line after the others."
        ),
        (
            "No COMP_FILE line may stay: the lattice holds the positioning errors too. BACKLASH "
            "stays as it is."
        ),
        (
            "MIN_LIMIT and MAX_LIMIT of [JOINT_n] move out by the largest correction, those of "
            "[AXIS_L] stay: see that no switch stands there."
        ),
        (
            "Start LinuxCNC. It does not start with a damaged lattice: the reason stands in the "
            "terminal. Home all axes."
        ),
        (
            "halcmd show pin stepdiagkins: weight rises to 1, no joint faster than "
            "stepdiagkins.slew-um-per-second."
        ),
        (
            "setp stepdiagkins.enable 0 brings the machine back to where it was, and 1 again; the "
            "positions on the screen do not change."
        ),
        (
            "Measure again; if the residual has grown, change the INI file back as "
            "ini_lines_RESTORE.txt says."
        ),
    )
