"""Profiles for the references: every control, with what a case adds to a section or to an axis."""

from collections.abc import Mapping

from stepdiag.base.volume import Volume
from stepdiag.exporters.profiles.file import parse_profile
from stepdiag.exporters.profiles.registry import controller_named
from stepdiag.exporters.tables.profile import Profile
from testkit.exact.machines import EOB
from testkit.recorded.results import VOLUME

SECTIONS = {
    "siemens": "[siemens]\nmeasuring_system = 1\nold_enabled = true\nold_weight = 1.0\n",
    "fanuc": "[fanuc]\ndetection_unit_um = 1.0\nincrement_limit = 127\n",
    "heidenhain": '[heidenhain]\ngeneration = "tnc640"\n',
    "linuxcnc": "[linuxcnc]\njoints = { X = [0], Y = [1, 3], Z = [2] }\n",
    "beckhoff": '[beckhoff]\nway = "volumetric"\naxis_numbers = { X = 1, Y = 2, Z = 3 }\n',
    "mitsubishi": '[mitsubishi]\noutput_unit_um = 0.5\ndata = "incremental"\n',
    "fagor": "[fagor]\n",
    "neutral": "[neutral]\n",
}
POINTS = {"X": (1, 12, 22), "Y": (2, 32, 42), "Z": (3, 52, 62)}
"""FANUC: number of the axis, point of the reference, first point of the - direction."""
STEPS = {"X": 100.0, "Y": 80.0, "Z": 60.0}


def profile_of(
    control: str,
    more: str = "",
    *,
    machine: str = "",
    axes: str = "",
    axis: Mapping[str, str] | None = None,
    limits: str = "",
    tests: str = "",
    steps: Mapping[str, float] | None = None,
    files: Mapping[str, bytes] | None = None,
    volume: Volume | None = VOLUME,
    section: str | None = None,
) -> Profile:
    """Return a profile: ``more`` lines of the control's section, ``axes`` of each axis and ``axis``
    of one, and the machine's ``files``."""
    text = profile_text(
        control,
        more,
        machine=machine,
        axes=axes,
        axis=axis,
        limits=limits,
        tests=tests,
        steps=steps,
        files=files,
        section=section,
    )
    return parse_profile(text, f"{control}.toml", controller_named(control), volume, files)


def profile_text(
    control: str,
    more: str = "",
    *,
    machine: str = "",
    axes: str = "",
    axis: Mapping[str, str] | None = None,
    limits: str = "",
    tests: str = "",
    steps: Mapping[str, float] | None = None,
    files: Mapping[str, bytes] | None = None,
    section: str | None = None,
) -> str:
    """Return the TOML of `profile_of`."""
    lines = [
        "[machine]",
        'name = "test machine"',
        f'controller = "{control}"',
        f"existing = {list(files or {})}",
    ]
    lines += [machine if "measured_with" in machine else f'measured_with = "off"\n{machine}']
    for index, letter in enumerate("XYZ"):
        step, own = {**STEPS, **(steps or {})}[letter], (axis or {}).get(letter, "")
        reference = (
            "" if "reference_mm" in own else f"reference_mm = {(-100.0, 40.0, 30.0)[index]}"
        )
        backlash = (
            "backlash_um = 0.0"
            if control == "linuxcnc" and "backlash" not in own + axes
            else ""
        )
        lines += [
            f"[axes.{letter}]",
            f'name = "{letter}{index + 1}"',
            f"step_mm = {step}",
            reference,
            backlash,
            axes,
            own,
        ]
    lines += [
        "[limits]\nslope_um_mm = 2.0",
        limits,
        tests,
        SECTIONS[control] if section is None else section,
        more,
    ]
    if control == "fanuc" and "[fanuc.axes.X]" not in more and section is None:
        lines += [points_of(letter, *numbers) for letter, numbers in POINTS.items()]
    return "\n".join(line for line in lines if line) + "\n"


def points_of(letter: str, number: int, reference: int, reverse: int) -> str:
    return (
        f"[fanuc.axes.{letter}]\nnumber = {number}\nreference_point = "
        f"{reference}\nreverse_first_point = {reverse}"
    )


def punched(
    pitch: Mapping[int, int] | None = None,
    *more: str,
    points: int = 70,
    parameters: bool = True,
    **own: str,
) -> bytes:
    """Return a punch file of a 30i, all its pitch data zero but for those of ``pitch``; ``own`` are
    parameters by name (``N3620``)."""
    lines = ["%", "(CNCID=000000000000)"]
    head = {
        "N3605": "00000000",
        "N3620": "0",
        "N3621": "0",
        "N3622": "0",
        "N3623": "1",
        "N3624": "0.0",
        "N3626": "0",
        "N3627": "0",
    } | own
    if parameters:
        lines += [f"N0{name[1:]}Q1{_of_axes(value)}" for name, value in head.items()]
    lines += [
        *more,
        *(f"N1{point:04}Q0P{(pitch or {}).get(point, 0)}" for point in range(points)),
    ]
    return EOB.join(line.encode("ascii") for line in [*lines, "%"]) + EOB


def _of_axes(value: str) -> str:
    """Return the values of three axes, or one for all of them, as a block holds them."""
    values = value.split() if " " in value else [value] * 3
    return "".join(f"A{axis}P{each}" for axis, each in enumerate(values, start=1))


SET_UP = {"N3620": "12 32 52", "N3624": "100.0 80.0 60.0"}
"""Parameters of a machine whose pitch data were in use."""
INCLINED = [
    f"N0{5861 + point}Q1A1P{10 + point}A2P{30 + 2 * point}A3P{50 + point}"
    for point in range(4)
] + [f"N0{5871 + point}Q1A1P0A2P0A3P0" for point in range(4)]
STRAIGHT = [
    f"N0{number}Q1P0" for first in (5711, 5721) for number in range(first, first + 3)
] + [
    f"N0{first + 10 * one + point}Q1P{point if first < 5760 else 0}"
    for first in (5731, 5761)
    for one in range(3)
    for point in range(4)
]
