"""A finished profile for every controller, so that one contract test can run over all of them."""

from collections.abc import Mapping
from dataclasses import dataclass, field

from stepdiag.base.volume import Volume
from stepdiag.exporters.profiles.file import parse_profile
from stepdiag.exporters.profiles.registry import controller_named
from stepdiag.exporters.tables.profile import Profile

EOB = b"\n\r\r"


@dataclass(frozen=True, kw_only=True)
class Machine:
    """What a machine of one controller adds to the common part of a profile: section, own files,
    axis lines, directions it separates."""

    section: str
    files: Mapping[str, bytes] = field(default_factory=dict)
    directions: tuple[str, ...] = ("mean", "both")
    axis_lines: tuple[str, ...] = ()
    functions: tuple[str, ...] = (
        "EXX",
        "EYY",
        "EZZ",
        "EYX",
        "EZX",
        "EXY",
        "EZY",
        "EXZ",
        "EYZ",
    )


def new_punch_file(points: int = 700) -> bytes:
    """Return a punch file in the form of a 30i: parameters of three axes and pitch data that are
    all zero."""
    lines = ["%", "(CNCID=000000000000)"]
    lines += ["N03605Q1A1P00000000A2P00000000A3P00000000"]
    lines += [f"N0{number}Q1A1P0A2P0A3P0" for number in (3620, 3621, 3622)] + [
        "N03623Q1A1P1A2P1A3P1"
    ]
    lines += ["N03624Q1A1P0.0A2P0.0A3P0.0", "N03626Q1A1P0A2P0A3P0", "N03627Q1A1P0A2P0A3P0"]
    lines += [f"N1{point:04}Q0P0" for point in range(points)]
    return EOB.join(line.encode("ascii") for line in [*lines, "%"]) + EOB


FANUC = """\
[fanuc]
detection_unit_um = 1.0
increment_limit = 127
experimental_bidirectional = true
[fanuc.axes.X]
number = 1
reference_point = 100
reverse_first_point = 160
[fanuc.axes.Y]
number = 2
reference_point = 300
reverse_first_point = 360
[fanuc.axes.Z]
number = 3
reference_point = 500
reverse_first_point = 560
"""

OLD = "old_enabled = true\nold_weight = 1.0\n"
"""How a SINUMERIK's own tables were switched before the loading."""
MACHINES: dict[str, Machine] = {
    "siemens": Machine(
        section="[siemens]\nmeasuring_system = 1\neec_points = { X = 50, Y = 50, Z = 50 "
        "}\ncec_points = 60\n" + OLD
    ),
    "fanuc": Machine(
        section=FANUC, files={"PITCH.TXT": new_punch_file()}, functions=("EXX", "EYY", "EZZ")
    ),
    "heidenhain": Machine(
        section='[heidenhain]\ngeneration = "tnc640"\n', directions=("mean",)
    ),
    "linuxcnc": Machine(
        section="[linuxcnc]\njoints = { X = [0], Y = [1], Z = [2] }\n",
        axis_lines=("backlash_um = 0.0",),
    ),
    "beckhoff": Machine(
        section='[beckhoff]\nway = "volumetric"\naxis_numbers = { X = 1, Y = 2, Z = 3 }\n',
        directions=("mean",),
    ),
    "mitsubishi": Machine(
        section='[mitsubishi]\noutput_unit_um = 0.5\ndata = "incremental"\n',
        directions=("mean",),
    ),
    "fagor": Machine(section="[fagor]\n"),
    "neutral": Machine(section="[neutral]\n"),
}


def profile_text(
    controller: str,
    *,
    steps_mm: tuple[float, float, float],
    references_mm: tuple[float, float, float],
    direction: str,
) -> str:
    """Return the TOML of a complete profile whose tables run over the measured volume."""
    machine = MACHINES[controller]
    lines = [
        "[machine]",
        'name = "test machine"',
        f'controller = "{controller}"',
        'measured_with = "off"',
        f'direction = "{direction}"',
    ]
    lines += [f"existing = {list(machine.files)}", f"functions = {list(machine.functions)}"]
    for index, letter in enumerate("XYZ"):
        lines += [
            f"[axes.{letter}]",
            f'name = "AX{index + 1}"',
            f"step_mm = {steps_mm[index]!r}",
            f"reference_mm = {references_mm[index]!r}",
            *machine.axis_lines,
        ]
    return "\n".join([*lines, machine.section])


def profile_of(
    controller: str,
    volume: Volume,
    *,
    sections: int = 4,
    direction: str = "mean",
    reference_at: int = 0,
) -> Profile:
    """Return that profile read, with ``sections`` steps an axis and the reference at grid point
    ``reference_at``."""
    x, y, z = (size / sections for size in volume.size_mm)
    low = volume.origin_mm
    references = (
        low[0] + x * reference_at,
        low[1] + y * reference_at,
        low[2] + z * reference_at,
    )
    text = profile_text(
        controller, steps_mm=(x, y, z), references_mm=references, direction=direction
    )
    return parse_profile(
        text,
        f"{controller}.toml",
        controller_named(controller),
        volume,
        MACHINES[controller].files,
    )
