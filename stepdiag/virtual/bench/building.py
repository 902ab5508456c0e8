"""The machine, its set-ups and its devices, built from a configuration; this module starts no
thread."""

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from stepdiag.virtual.base.clock import Clock
from stepdiag.virtual.base.faults import FaultBoard
from stepdiag.virtual.bench.config import BenchConfig, HeadPart, LaserPart
from stepdiag.virtual.control.compensation import load_files
from stepdiag.virtual.drive.player import Drive
from stepdiag.virtual.drive.program import Plan
from stepdiag.virtual.drive.sequence import (
    Box,
    base_name,
    outward_direction,
    outward_stops_mm,
    register_of,
)
from stepdiag.virtual.drive.setups import Alignment, aligned_setup
from stepdiag.virtual.instruments.binary import BinaryFrames
from stepdiag.virtual.instruments.head import Disturbance, HeadStand, VirtualHead, Wander
from stepdiag.virtual.instruments.head_wire import FourdofHead, Look, QuadrantDetector
from stepdiag.virtual.instruments.interferometers import AskClimate, Ids3010, Lasertex, Qudis
from stepdiag.virtual.instruments.laser_source import (
    AskedLaser,
    CommandedLaser,
    Counter,
    MarkedLaser,
    Read,
    TalkingLaser,
)
from stepdiag.virtual.instruments.lasers import (
    BOARDS,
    AsciiLine,
    Encoder,
    Flags,
    NdDisplay,
    UmdBoard,
)
from stepdiag.virtual.instruments.talker import Answering, Talking
from stepdiag.virtual.physics.environment import Environment
from stepdiag.virtual.physics.error_functions import (
    AXES,
    Amplitudes,
    Array,
    ErrorFunction,
    ErrorSet,
    Table,
    Waved,
    random_errors,
)
from stepdiag.virtual.physics.growth import Growth
from stepdiag.virtual.physics.machine import Machine, Setup
from stepdiag.virtual.physics.optics import perpendiculars, tilted

_LINE_RATE_HZ = 100.0


def build_box(config: BenchConfig) -> Box:
    volume = config.volume
    return Box(
        origin_mm=volume.origin_mm,
        size_mm=volume.size_mm,
        increments=volume.increments,
        decimals=config.program.decimals,
        incremental=config.program.incremental,
    )


def build_errors(config: BenchConfig) -> ErrorSet:
    """Return the 21 errors of the machine, and its backlash as lost motion: the axis lags by half
    of the backlash in either direction."""
    part, volume = config.machine, config.volume
    amplitudes = Amplitudes(
        positioning_um=part.positioning_um,
        straightness_um=part.straightness_um,
        angle_urad=part.angle_urad,
        scale_um_m=part.scale_um_m,
        squareness_urad=part.squareness_urad,
    )
    drawn = random_errors(config.seed, volume.origin_mm, volume.size_mm, amplitudes)
    tables = {
        name: Table(table.position_mm, table.value) for name, table in part.tables.items()
    }
    lost = {
        f"E{a}{a}": Table((0.0,), (-um,))
        for a, um in zip(AXES, part.backlash_um, strict=True)
        if um
    }
    return replace(
        drawn,
        functions={
            **drawn.functions,
            **tables,
            **_on_screws(config, {**drawn.functions, **tables}),
        },
        squareness_urad={**drawn.squareness_urad, **part.squareness},
        reversal=lost,
    )


def _on_screws(
    config: BenchConfig, functions: Mapping[str, ErrorFunction]
) -> dict[str, ErrorFunction]:
    part, low_mm = config.machine, config.volume.origin_mm
    phases = np.random.default_rng((config.seed, 10)).uniform(0.0, 2.0 * math.pi, size=3)
    return {
        f"E{a}{a}": Waved(
            functions[f"E{a}{a}"],
            part.screw_um[axis],
            part.screw_pitch_mm,
            float(phases[axis]),
            low_mm[axis],
        )
        for axis, a in enumerate(AXES)
        if part.screw_um[axis]
    }


def _build_growth(config: BenchConfig) -> Growth | None:
    part = config.machine
    if not any(part.growth_um_m):
        return None
    return Growth(
        um_m=part.growth_um_m,
        bearing_mm=part.growth_bearing_mm,
        tau_s=part.growth_tau_s,
        begun_s=part.growth_begun_s,
    )


def build_machine(config: BenchConfig) -> Machine:
    """Return the machine with the compensation files loaded into its control."""
    part, hall = config.machine, config.hall
    return Machine(
        errors=build_errors(config),
        chain=part.chain,
        reference_mm=part.reference_mm,
        tool_offset_mm=part.tool_offset_mm,
        expansion_um_m_c=part.expansion_um_m_c,
        drift_um_h=part.drift_um_h,
        growth=_build_growth(config),
        environment=Environment(
            material_c=hall.material_c,
            air_c=hall.air_c,
            pressure_hpa=hall.pressure_hpa,
            humidity_percent=hall.humidity_percent,
        ),
        compensations=[
            table
            for loaded in config.compensation
            for table in load_files(
                loaded.control, [Path(f) for f in loaded.files], part.chain
            )
        ],
    )


def build_drive(config: BenchConfig) -> Drive:
    part, program = config.machine, config.program
    return Drive(
        feed_mm_min=program.feed_mm_min,
        acceleration_mm_s2=program.acceleration_mm_s2,
        ring_um=part.ring_um,
        ring_hz=part.ring_hz,
        ring_decay_s=part.ring_decay_s,
        hum_um=part.hum_um,
        hum_hz=part.hum_hz,
        repeatability_um=part.repeatability_um,
        servo_um=part.servo_um,
    )


def shifted_setups(config: BenchConfig) -> dict[str, tuple[float, float, float]]:
    """Return the beam offset of every setup with a shifted beam, by its name."""
    offsets: dict[str, tuple[float, float, float]] = {}
    for part in config.program.beam_offset:
        number = 1 + sum(base_name(name) == part.setup for name in offsets)
        offsets[f"{part.setup}+{number}"] = part.offset_mm
    return offsets


def build_plan(config: BenchConfig) -> Plan:
    """Return the plan of the program. Raises ValueError for an unknown setup."""
    program = config.program
    setups = (*program.setups, *shifted_setups(config))
    for setup in setups:
        register_of(setup)
    return Plan(
        box=build_box(config),
        setups=setups,
        passes=program.passes,
        axis_order=config.volume.axis_order,
        dwell_s=program.dwell_s,
        overrun_mm=program.overrun_mm,
        first_overrun=program.first_overrun,
        pause_s=program.pause_s if program.start == "auto" else None,
        commission_s=program.commission_s,
    )


def alignment_of(config: BenchConfig, setup: str) -> Alignment:
    """Return the alignment errors of a setup; the directions of their angles are drawn by the seed
    and the name of the setup."""
    part, laser = config.alignment, config.laser or LaserPart()
    rng = np.random.default_rng([config.seed, *setup.encode("ascii")])
    mirror, beam = rng.uniform(0.0, 2.0 * math.pi, size=2)
    return Alignment(
        mirror_mrad=(
            part.mirror_mrad * math.cos(mirror),
            part.mirror_mrad * math.sin(mirror),
        ),
        beam_mrad=(part.beam_mrad * math.cos(beam), part.beam_mrad * math.sin(beam)),
        beam_offset_mm=shifted_setups(config).get(setup, (0.0, 0.0, 0.0)),
        target_mm=part.target_mm,
        flatness_um=part.flatness_um,
        flatness_seed=config.seed,
        standoff_mm=part.standoff_mm,
        stand=part.stand,
        assumed_index=None if laser.compensated else 1.0,
        wavelength_nm=laser.wavelength_nm,
    )


def setup_builder(config: BenchConfig, machine: Machine) -> Callable[[str], Setup]:
    """Return a function from the name of a setup to its laser and target. The function aligns the
    laser and target of each setup only once."""
    box = build_box(config)
    built: dict[str, Setup] = {}

    def setup_of(name: str) -> Setup:
        if name not in built:
            built[name] = aligned_setup(machine, box, name, alignment_of(config, name))
        return built[name]

    return setup_of


def head_builder(
    config: BenchConfig, part: HeadPart, machine: Machine
) -> Callable[[str], VirtualHead]:
    """Return a function that mounts the 4-DOF head for a run along an axis; each mounting is made
    once.

    The detectors measure in two directions across the beam, ``right`` and ``up``: +Y and +Z for a
    beam along +X, -X and +Z for a beam along +Y, +X and +Y for a beam along +Z.
    """
    box = build_box(config)
    built: dict[str, VirtualHead] = {}

    def head_of(setup: str) -> VirtualHead:
        if setup not in built:
            built[setup] = _stand_up(config, part, machine, box, setup)
        return built[setup]

    return head_of


def _stand_up(
    config: BenchConfig, part: HeadPart, machine: Machine, box: Box, setup: str
) -> VirtualHead:
    rng = np.random.default_rng([config.seed, *setup.encode("ascii")])
    angle = rng.uniform(0.0, 2.0 * math.pi)
    beam = tilted(
        outward_direction(box, setup),
        (part.beam_mrad * math.cos(angle), part.beam_mrad * math.sin(angle)),
    )
    right, up = perpendiculars(beam)
    vertex = np.array(part.vertex_mm, dtype=np.float64)
    start = machine.pose(outward_stops_mm(box, setup)[:1], stand=config.alignment.stand)
    stand = HeadStand(start.point_mm(vertex)[0] - part.standoff_mm * beam, beam, right, up)
    disturbance = Disturbance(
        pointing_urad=Wander(
            amplitude=part.pointing_urad, period_s=part.pointing_period_s, seed=config.seed
        ),
        wobble_urad=Wander(
            amplitude=part.wobble_urad, period_s=part.wobble_period_s, seed=config.seed + 2
        ),
        bending_urad_m=Wander(
            amplitude=part.bending_urad_m,
            period_s=part.bending_period_s,
            seed=config.seed + 1,
        ),
    )
    return VirtualHead(
        part.optics, stand, start, vertex_mm=vertex, disturbance=disturbance, seed=config.seed
    )


def build_head_device(part: HeadPart, look: Look) -> Talking | Answering:
    if part.format == "tqd":
        return QuadrantDetector(look, full_sum=part.optics.qd.full_sum)
    return FourdofHead(look, rate_hz=part.rate_hz, encoding=part.encoding)


@dataclass(frozen=True, slots=True)
class Surroundings:
    """The surroundings of an instrument: air, material, and whether the stop relay is closed at
    wall times."""

    climate: AskClimate
    stopped: Callable[[Array], Flags]


def build_laser(
    laser: LaserPart,
    read: Read,
    seed: int,
    around: Surroundings,
    *,
    clock: Clock,
    faults: FaultBoard,
) -> Talking | Answering:
    counter = Counter(sign=laser.sign, noise_um=laser.noise_um, seed=seed)
    match laser.format:
        case "nd" | "ids3010":
            display = (
                NdDisplay(resolution_mm=laser.resolution_mm)
                if laser.format == "nd"
                else Ids3010(around.climate)
            )
            return AskedLaser(
                display, read, counter, clock=clock, faults=faults, latency_s=laser.latency_s
            )
        case "lasertex":
            return CommandedLaser(
                Lasertex(around.climate),
                read,
                counter,
                clock=clock,
                faults=faults,
                latency_s=laser.latency_s,
            )
        case "qudis":
            return MarkedLaser(
                Qudis(around.stopped),
                read,
                counter,
                clock=clock,
                faults=faults,
                latency_s=laser.latency_s,
            )
    return TalkingLaser(
        _encoder(laser), read, counter, clock=clock, faults=faults, latency_s=laser.latency_s
    )


def _encoder(laser: LaserPart) -> Encoder:
    if laser.format == "frames":
        return BinaryFrames(rate_hz=laser.rate_hz or _LINE_RATE_HZ, order=laser.byte_order)
    if laser.format == "line":
        return AsciiLine(
            rate_hz=laser.rate_hz or _LINE_RATE_HZ,
            text=laser.line_text,
            counter_modulus=laser.counter_modulus,
        )
    return UmdBoard(
        BOARDS[laser.board],
        wavelength_nm=laser.wavelength_nm,
        optics=laser.optics,
        rate_hz=laser.rate_hz or None,
        axes=laser.axes,
    )
