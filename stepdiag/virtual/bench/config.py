"""The bench in one TOML file: machine, alignment, program, laser, PLC, tables and faults."""

import tomllib
from pathlib import Path
from typing import Literal

import msgspec

from stepdiag.virtual.base.faults import Fault
from stepdiag.virtual.control.compensation import Control
from stepdiag.virtual.instruments.head import HeadOptics
from stepdiag.virtual.physics.environment import Course
from stepdiag.virtual.physics.kinematics import Stand

LARGEST_BYTES = 1_000_000
Three = tuple[float, float, float]


class _Part(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """A table of the configuration file; unknown keys are refused."""


class VolumePart(_Part, frozen=True):
    origin_mm: Three = (0.0, 0.0, 0.0)
    size_mm: Three = (500.0, 400.0, 300.0)
    increments: int = 10
    axis_order: str = "xyz"


class OffsetPart(_Part, frozen=True):
    """A setup that is driven with a shifted beam. The shifted setups of ``ppp`` are named
    ``ppp+1``, ``ppp+2`` and so on, in the order of the file."""

    setup: str
    offset_mm: Three


class ProgramPart(_Part, frozen=True):
    """The program of the control; its times are machine seconds. ``start`` determines when a setup
    begins: after ``pause_s``, or on command.

    ``decimals`` are the decimal places of the positions in a hand-written program; an
    ``incremental`` program (G91) rounds its steps. With ``overrun_mm`` 0 the program reverses at
    the last stop. Without ``first_overrun`` the first pass of a setup begins without overrun. A
    ``patient`` machine prolongs a move or a dwell until the recorder has polled without a break for
    most of this move or dwell (`stepdiag.virtual.plc.attention`).
    """

    setups: tuple[str, ...] = ("ppp", "npp", "pnp", "ppn")
    passes: int = 2
    feed_mm_min: float = 2000.0
    acceleration_mm_s2: float = 1000.0
    dwell_s: float = 2.0
    overrun_mm: float = 5.0
    first_overrun: bool = True
    pause_s: float = 2.0
    start: Literal["auto", "command"] = "auto"
    handshake: bool = False
    patient: bool = False
    decimals: int | None = None
    incremental: bool = False
    commission_s: Three | None = None
    beam_offset: tuple[OffsetPart, ...] = ()


class TablePart(_Part, frozen=True):
    """An error function in um or urad, given at nodes and linear between them."""

    position_mm: tuple[float, ...]
    value: tuple[float, ...]


class MachinePart(_Part, frozen=True):
    """The errors of the machine, drawn by the seed with these amplitudes; a table replaces the
    function of its name.

    ``repeatability_um`` and ``servo_um`` are standard deviations of an arrival of an axis
    (`stepdiag.virtual.drive.player.Drive`). ``screw_um`` is the amplitude of a periodic error of
    each axis with the period ``screw_pitch_mm``; the seed draws the phase. ``growth_um_m`` is the
    final growth of each axis from its bearing at ``growth_bearing_mm``, with the time constant
    ``growth_tau_s``; at the start of the bench the machine has already run for ``growth_begun_s``.
    """

    chain: str = "FXYZ"
    reference_mm: Three | None = None
    tool_offset_mm: Three = (0.0, 0.0, 0.0)
    positioning_um: float = 8.0
    straightness_um: float = 8.0
    angle_urad: float = 0.0
    scale_um_m: float = 15.0
    squareness_urad: float = 20.0
    squareness: dict[str, float] = {}
    tables: dict[str, TablePart] = {}
    backlash_um: Three = (0.0, 0.0, 0.0)
    expansion_um_m_c: Three = (11.7, 11.7, 11.7)
    drift_um_h: Three = (0.0, 0.0, 0.0)
    ring_um: float = 1.0
    ring_hz: float = 30.0
    ring_decay_s: float = 0.08
    hum_um: float = 0.02
    hum_hz: float = 50.0
    repeatability_um: float = 0.0
    servo_um: float = 0.0
    screw_um: Three = (0.0, 0.0, 0.0)
    screw_pitch_mm: float = 10.0
    growth_um_m: Three = (0.0, 0.0, 0.0)
    growth_bearing_mm: Three = (0.0, 0.0, 0.0)
    growth_tau_s: float = 3600.0
    growth_begun_s: float = 0.0


class HallPart(_Part, frozen=True):
    material_c: Course = Course(start=20.0)
    air_c: Course = Course(start=20.0)
    pressure_hpa: Course = Course(start=1013.25)
    humidity_percent: Course = Course(start=50.0)


class AlignmentPart(_Part, frozen=True):
    """Alignment errors of laser and mirror: angles of these sizes, in directions that the seed
    draws for every setup."""

    mirror_mrad: float = 0.0
    beam_mrad: float = 0.0
    flatness_um: float = 0.0
    target_mm: Three = (0.0, 0.0, 0.0)
    standoff_mm: float = 300.0
    stand: Stand = "table"


class LaserPart(_Part, frozen=True):
    """The laser and its port. A ``rate_hz`` of 0 means the usual rate of the instrument. ``link``
    is the path of the serial port, for ``wire = "serial"``.

    ``chunk_s`` is the time for which the adapter collects bytes: the latency timer of an FTDI chip
    in its factory setting.
    """

    format: Literal["umd", "nd", "line", "frames", "ids3010", "lasertex", "qudis"] = "umd"
    wire: Literal["serial", "tcp"] = "serial"
    byte_order: Literal["little", "big"] = "little"
    board: Literal["umd0", "umd1", "umd2"] = "umd2"
    axes: Literal[1, 3] = 1
    rate_hz: float = 0.0
    link: str = "laser"
    wavelength_nm: float = 632.991
    optics: int = 1
    compensated: bool = False
    sign: Literal[1, -1] = 1
    noise_um: float = 0.05
    latency_s: float = 0.0
    line_text: str = "{position_mm:+.6f} {counter:05d} {beam:.2f}\r\n"
    counter_modulus: int = 65536
    resolution_mm: float = 0.0001
    lossless: bool = False
    chunk_s: float = 0.016


class HeadPart(_Part, frozen=True):
    """The 4-DOF head on its own line, with light only during ``fourdof`` runs;
    `stepdiag.virtual.instruments.head` describes the optics."""

    format: Literal["fourdof", "tqd", "elcomat", "wyler"] = "fourdof"
    encoding: Literal["binary", "ascii"] = "binary"
    rate_hz: float = 250.0
    link: str = "head"
    optics: HeadOptics = HeadOptics()
    vertex_mm: Three = (0.0, 0.0, 0.0)
    standoff_mm: float = 300.0
    beam_mrad: float = 0.0
    pointing_urad: float = 0.0
    pointing_period_s: float = 300.0
    wobble_urad: float = 150.0
    wobble_period_s: float = 25.0
    bending_urad_m: float = 0.0
    bending_period_s: float = 60.0


class AirPart(_Part, frozen=True):
    """A sensor of air and material on a pty or a TCP port: a PTU300, which answers requests, or a
    logger, which sends without requests."""

    format: Literal["ptu300", "logger"] = "ptu300"
    wire: Literal["serial", "tcp"] = "serial"
    link: str = "air"


class PlcPart(_Part, frozen=True):
    """The PLC: TCP on ``port`` (0: any free port) or RTU on the pty ``link``.

    ``lag_s`` is the delay in wall seconds of counter and position after the stop signal.
    ``positions`` selects commanded or actual positions. The actual positions contain
    ``machine.servo_um``, and scatter by ``scatter_um`` (standard deviation) from scan to scan;
    ``resolution_mm`` is the last digit of the control.
    """

    transport: Literal["tcp", "rtu"] = "tcp"
    host: str = "127.0.0.1"
    port: int = 0
    link: str = "plc"
    unit: int = 1
    scan_s: float = 0.01
    lag_s: float = 0.0
    base: int = 0
    order: Literal["ABCD", "CDAB", "BADC", "DCBA"] = "ABCD"
    positions: Literal["commanded", "actual"] = "commanded"
    scatter_um: float = 0.0
    resolution_mm: float = 0.0001


class CompensationPart(_Part, frozen=True):
    """Files that are loaded into the virtual control before its start, with paths relative to the
    configuration file."""

    control: Control
    files: tuple[str, ...]


class BenchConfig(_Part, frozen=True):
    """The whole configuration of a bench. ``time_scale`` machine seconds pass in one wall second;
    ``seed`` draws all random values."""

    seed: int = 1
    time_scale: float = 1.0
    volume: VolumePart = VolumePart()
    program: ProgramPart = ProgramPart()
    machine: MachinePart = MachinePart()
    hall: HallPart = HallPart()
    alignment: AlignmentPart = AlignmentPart()
    laser: LaserPart | None = LaserPart()
    head: HeadPart | None = None
    air: AirPart | None = None
    plc: PlcPart | None = PlcPart()
    compensation: tuple[CompensationPart, ...] = ()
    fault: tuple[Fault, ...] = ()


def load_config(text: str) -> BenchConfig:
    """Return the configuration in a TOML text. Raises ValueError with the wrong field."""
    return msgspec.convert(tomllib.loads(text), BenchConfig)


def read_config(file: Path) -> BenchConfig:
    """Return the configuration in a file; the paths of compensation files are relative to the
    folder of this file."""
    if file.stat().st_size > LARGEST_BYTES:
        raise ValueError(f"{file}: expected at most {LARGEST_BYTES} bytes")
    config = load_config(file.read_text(encoding="utf-8"))
    resolved = tuple(
        msgspec.structs.replace(
            part, files=tuple(str(file.parent / name) for name in part.files)
        )
        for part in config.compensation
    )
    return msgspec.structs.replace(config, compensation=resolved)
