"""The files at the start of the demo: the virtual machine, the survey, and the profiles."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from stepdiag.exporters.fanuc.punch import EOB
from stepdiag.virtual.bench.building import build_machine
from stepdiag.virtual.bench.config import read_config

SIZE_MM = (500.0, 400.0, 300.0)
INCREMENTS = 8
SETUPS = ("ppp", "npp", "pnp", "ppn", "linear-x", "linear-y", "linear-z")
PASSES = 2
U_ANGLE_URAD = 1.0
"""Standard uncertainty of the demo's autocollimator in urad."""

_BENCH = """\
# The virtual machine of the demo, with its true errors. The survey file does not contain them.
seed = {seed}
time_scale = {scale}

[volume]
size_mm = [500.0, 400.0, 300.0]
increments = {n}

[program]
setups = [{setups}]
passes = {passes}
feed_mm_min = 24000.0
acceleration_mm_s2 = 4000.0
dwell_s = {dwell}
overrun_mm = 2.0
start = "command"
pause_s = 1.0
patient = true
decimals = 3

# An ordinary machine with linear scales. The repeatability of each axis is 0.5 um (standard
# deviation). The control sends the actual positions of its encoders.
[machine]
positioning_um = 6.0
straightness_um = 5.0
scale_um_m = 20.0
squareness_urad = 30.0
angle_urad = 15.0
backlash_um = [2.0, 2.0, 2.0]
repeatability_um = 0.5
servo_um = 0.2
screw_um = [0.2, 0.2, 0.2]
screw_pitch_mm = 0.02

[plc]
positions = "actual"
scatter_um = 0.3

[alignment]
mirror_mrad = {mirror}
beam_mrad = {mirror}

[laser]
format = "umd"
optics = 1
noise_um = 0.3
"""

_SURVEY = """\
# The survey file of the demo. `stepdiag init` writes a survey file with comments.
[survey]
name = "demo"
machine = "virtual machine"

[volume]
size_mm = [500.0, 400.0, 300.0]
increments = {n}

[plan]
setups = [{setups}]
return_pass = true
feed_mm_min = 24000.0
dwell_s = {dwell}
overrun_mm = 2.0

[machine]
chain = "FXYZ"
compensation = "off"

[solver]
angles = "angles.csv"

[laser]
format = "umd"
port = "{laser}"
optics = 1

[plc]
host = "127.0.0.1"
port = {port}
poll_hz = 100.0

[stop]
settle_s = {settle}
min_window_s = {window}

[page]
{page}

[[export]]
controller = "siemens"
profile = "siemens.toml"

[[export]]
controller = "fanuc"
profile = "fanuc.toml"
"""

_AXES = """
[axes.X]
name = "{x}"
step_mm = 25.0
reference_mm = 0.0

[axes.Y]
name = "{y}"
step_mm = 25.0
reference_mm = 0.0

[axes.Z]
name = "{z}"
step_mm = 25.0
reference_mm = 0.0
"""

_MACHINE = """\
[machine]
name = "virtual machine"
controller = "{controller}"
measured_with = "off"
{existing}

[limits]
slope_um_mm = 0.5
"""

_FANUC = """
[fanuc]
detection_unit_um = 1.0

[fanuc.axes.X]
number = 1
reference_point = 1

[fanuc.axes.Y]
number = 2
reference_point = 41

[fanuc.axes.Z]
number = 3
reference_point = 81
"""


_FOURS = [
    first + 10 * one + point
    for first in (5731, 5761)
    for one in range(3)
    for point in range(4)
]
_STRAIGHTNESS = sorted([*range(5711, 5714), *range(5721, 5724), *_FOURS])
"""FANUC parameters of straightness compensation; these numbers are valid only for the virtual
control."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Pace:
    """Pace of the virtual machine, and the survey's settings of a stop. ``machine_s`` is the number
    of machine seconds per wall second; the other fields are in wall seconds."""

    machine_s: float = 10.0
    dwell_s: float = 0.26
    settle_s: float = 0.03
    min_window_s: float = 0.08


FAST = Pace()
WATCHED = Pace(machine_s=2.0, dwell_s=1.2, settle_s=0.15, min_window_s=0.4)
"""Pace of the live demo: one stop every 1.5 s, so that a person can follow."""


def write_bench(folder: Path, seed: int, pace: Pace = FAST) -> Path:
    """Write the settings file of the virtual machine; return its path."""
    dwell = pace.dwell_s * pace.machine_s
    bench = _BENCH.format(
        seed=seed,
        n=INCREMENTS,
        setups=_quoted(),
        passes=PASSES,
        scale=pace.machine_s,
        dwell=dwell,
        mirror=0.2,
    )
    return _write_new(folder / "machine.toml", bench)


def write_survey(
    folder: Path,
    plc_port: str,
    laser_link: str,
    *,
    pace: Pace = FAST,
    page: str = "enabled = false",
) -> Path:
    """Write the survey file for devices at these addresses; return its path. ``page`` is the text
    of its section."""
    survey = _SURVEY.format(
        n=INCREMENTS,
        setups=_quoted(),
        laser=laser_link,
        port=plc_port,
        page=page,
        dwell=pace.dwell_s,
        settle=pace.settle_s,
        window=pace.min_window_s,
    )
    return _write_new(folder / "survey.toml", survey)


def write_angles(folder: Path, bench: Path, seed: int) -> None:
    """Write the angles file of an autocollimator at the positions of the stops, with the
    uncertainty `U_ANGLE_URAD`."""
    truth, rng = (
        build_machine(read_config(bench)).truth(INCREMENTS),
        np.random.default_rng(seed),
    )
    rows = ["axis,position_mm,EA_urad,EB_urad,EC_urad,u_urad"]
    for letter in "XYZ":
        seen = [
            truth.errors[f"E{turn}{letter}"] + rng.normal(0.0, U_ANGLE_URAD, INCREMENTS + 1)
            for turn in "ABC"
        ]
        for index, at in enumerate(truth.position_mm[letter]):
            rows.append(
                f"{letter.lower()},{at:g},"
                + ",".join(f"{one[index] - one[0]:.3f}" for one in seen)
                + f",{U_ANGLE_URAD:g}"
            )
    _write_new(folder / "angles.csv", "\n".join([*rows, ""]))


def write_profiles(folder: Path) -> None:
    """Write the profiles of both controls of the demo, and the punch file of a FANUC control
    without compensation."""
    (folder / "PITCH.TXT").write_bytes(
        _punch([f"N{10000 + point:05d}Q0P0" for point in range(1, 129)])
    )
    (folder / "CNCPARAM.TXT").write_bytes(_punch(_parameters()))
    _write_new(folder / "siemens.toml", siemens_profile())
    _write_new(folder / "fanuc.toml", fanuc_profile())


def siemens_profile(
    *, functions: str = "", products: bool = False, held: int | None = None
) -> str:
    """Return the profile of a SINUMERIK with nine tables, or with the tables of ``functions`` and
    products of ``held`` CEC tables."""
    chosen = f"functions = {functions}" if functions else ""
    section = "\n[siemens]\nmeasuring_system = 1\n" + (
        "products = true\n" if products else ""
    )
    section += "" if held is None else f"cec_tables_held = {held}\n"
    return (
        _MACHINE.format(controller="siemens", existing=chosen)
        + _AXES.format(x="AX1", y="AX2", z="AX3")
        + section
    )


def fanuc_profile(*, straightness: bool = False) -> str:
    """Return the profile of a FANUC control with stored pitch error compensation, and straightness
    compensation if the control has this option."""
    own = 'existing = ["PITCH.TXT", "CNCPARAM.TXT"]'
    unit = "detection_unit_um = 1.0"
    section = (
        _FANUC.replace(unit, f"{unit}\nstraightness_option = true")
        if straightness
        else _FANUC
    )
    return (
        _MACHINE.format(controller="fanuc", existing=own)
        + _AXES.format(x="X", y="Y", z="Z")
        + section
    )


def beckhoff_profile(chain: str) -> str:
    section = (
        f'\n[beckhoff]\nway = "volumetric"\naxis_numbers = {{ X = 1, Y = 2, Z = 3 }}\nchain = '
        f'"{chain}"\n'
    )
    return (
        _MACHINE.format(controller="beckhoff", existing="")
        + _AXES.format(x="X", y="Y", z="Z")
        + section
    )


def heidenhain_profile(chain: str) -> str:
    section = f'\n[heidenhain]\ngeneration = "itnc530"\nchain = "{chain}"\n'
    return (
        _MACHINE.format(controller="heidenhain", existing="")
        + _AXES.format(x="X", y="Y", z="Z")
        + section
    )


def linuxcnc_profile() -> str:
    section = '\n[linuxcnc]\njoints = { X = [0], Y = [1], Z = [2] }\nway = "kinematics"\n'
    return (
        _MACHINE.format(controller="linuxcnc", existing="")
        + _AXES.format(x="X", y="Y", z="Z")
        + section
    )


def _parameters() -> list[str]:
    axes = (1, 2, 3)
    zero = "".join(f"A{axis}P0" for axis in axes)
    return [
        "N01020Q1"
        + "".join(f"A{axis}P{code}" for axis, code in zip(axes, (88, 89, 90), strict=True)),
        *(f"N{number:05d}Q1{zero}" for number in (3620, 3621, 3622, 3623)),
        "N03624Q1" + "".join(f"A{axis}P0.0" for axis in axes),
        *(f"N{number:05d}Q1P0" for number in _STRAIGHTNESS),
    ]


def _punch(lines: list[str]) -> bytes:
    return (
        EOB.join(line.encode("ascii") for line in ("%", "(CNCID=VIRTUAL)", *lines, "%")) + EOB
    )


def _quoted() -> str:
    return ", ".join(f'"{setup}"' for setup in SETUPS)


def _write_new(path: Path, text: str) -> Path:
    with path.open("x", encoding="utf-8", newline="\n") as file:
        file.write(text)
    return path
