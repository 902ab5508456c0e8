"""A shop that measures a machine: its program, its instruments, its hall; and its whole survey, as
columns.
"""

from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from typing import Literal

import numpy as np

from stepdiag.virtual.drive.registers import PositionRegisters
from stepdiag.virtual.drive.sequence import Box, axis_of_run
from stepdiag.virtual.drive.setups import Alignment
from stepdiag.virtual.physics.error_functions import (
    AXES,
    Array,
    ErrorFunction,
    ErrorSet,
    zero,
)
from stepdiag.virtual.physics.growth import Three
from stepdiag.virtual.physics.machine import Machine
from testkit.ordinary.arrivals import Scatter, Standing
from testkit.ordinary.machines import OrdinaryMachine
from testkit.ordinary.measured import Conditions, SimulatedPass, simulate_pass

DIAGONALS = ("ppp", "npp", "pnp", "ppn")
RUNS = ("linear-x", "linear-y", "linear-z")
Overrun = Literal["always", "turns", "never"]
"""Overruns of the program: at every first stop; at the turns between passes, but not before the
first pass of a setup; nowhere.
"""


@dataclass(frozen=True, slots=True)
class Sloped:
    """A function with a straight line added that is ``at_low`` at ``low_mm`` and rises by
    ``slope_per_mm``."""

    base: ErrorFunction
    low_mm: float
    slope_per_mm: float
    at_low: float = 0.0

    def __call__(self, position_mm: Array) -> Array:
        travelled = np.asarray(position_mm, dtype=np.float64) - self.low_mm
        value: Array = self.base(position_mm) + self.at_low + self.slope_per_mm * travelled
        return value


@dataclass(frozen=True, slots=True, kw_only=True)
class Beam:
    """Errors of a laser's readings beside the machine.

    ``noise_um``: sensor noise and vibration, a draw per stop. ``drift_um``: standard deviation of
    the straight drift over a pass; ``wander_um``: of a random walk at the end of a pass. ``index``:
    relative error of the wavelength, a draw per survey; ``index_setup``: a further draw per setup.
    ``largest_mrad``: largest tilt of mirror and beam.
    """

    noise_um: float = 0.3
    drift_um: float = 0.0
    wander_um: float = 0.0
    index: float = 0.0
    index_setup: float = 0.0
    largest_mrad: float = 0.5


@dataclass(frozen=True, slots=True, kw_only=True)
class Shop:
    """Conditions of a survey.

    ``passes`` of each setup, odd passes outward. ``one_count``: the beam is unbroken from pass to
    pass of a setup. ``thermometer``: the readings carry the material temperature. ``setup_c``:
    standard deviation of the unseen change of the material temperature between setups. ``seed``
    draws all random values of the survey.
    """

    box: Box
    setups: tuple[str, ...] = (*DIAGONALS, *RUNS)
    passes: int = 2
    axis_order: str = "xyz"
    overrun: Overrun = "always"
    scatter: Scatter = field(default_factory=Scatter)
    registers: PositionRegisters = field(default_factory=PositionRegisters)
    beam: Beam = field(default_factory=Beam)
    one_count: bool = True
    thermometer: bool = False
    setup_c: float = 0.0
    seconds_per_stop: float = 10.0
    turn_s: float = 30.0
    setup_s: float = 600.0
    seed: int = 0


@dataclass(frozen=True, slots=True, kw_only=True)
class DrivenSurvey:
    """A survey as columns of N stops, and the ``truth``: the machine at the survey's mean time,
    mean of both approaches (`mean_machine`).

    ``reading_mm`` counts from the first stop of the setup where ``zero`` numbers its count, from
    the first stop of the pass where ``zero`` is -1. ``turned`` marks the first stop of a pass whose
    reading is the last one of the pass before. ``u_um`` is the standard deviation of the sensor
    noise. ``temperature_c`` is NaN without a thermometer.
    """

    setup: tuple[str, ...]
    pass_number: tuple[int, ...]
    stop: tuple[int, ...]
    position_mm: Array
    reading_mm: Array
    time_s: Array
    temperature_c: Array
    u_um: Array
    zero: tuple[int, ...]
    turned: tuple[bool, ...]
    truth: Machine


@dataclass(frozen=True, slots=True)
class _Taken:
    """A pass as measured: its count in mm from the zero of the setup's count, and the unseen rise
    of the material's temperature.
    """

    one: SimulatedPass
    count_mm: Array
    position_mm: Array
    time_s: Array
    zero: int
    turned: bool
    unseen_c: float


def drive_survey(machine: Machine, shop: Shop) -> DrivenSurvey:
    """Drive a whole survey and return its columns."""
    taken = list(_taken_passes(machine, shop))
    ones = [each.one for each in taken]
    times = np.concatenate([each.time_s for each in taken])
    unseen = np.concatenate([np.full(len(each.one.stop), each.unseen_c) for each in taken])
    seen = np.round(machine.environment.material_c.at(times), 2)
    return DrivenSurvey(
        setup=tuple(one.setup for one in ones for _ in one.stop),
        pass_number=tuple(one.number for one in ones for _ in one.stop),
        stop=tuple(int(stop) for one in ones for stop in one.stop),
        position_mm=np.concatenate([each.position_mm for each in taken]),
        reading_mm=np.concatenate([each.count_mm for each in taken]),
        time_s=times,
        temperature_c=seen if shop.thermometer else np.full(len(times), np.nan),
        u_um=np.full(len(times), shop.beam.noise_um),
        zero=tuple(each.zero for each in taken for _ in each.one.stop),
        turned=tuple(each.turned and stop == 0 for each in taken for stop in each.one.stop),
        truth=mean_machine(machine, times, unseen),
    )


def mean_machine(machine: Machine, time_s: Array, unseen_c: Array) -> Machine:
    """Return the machine at the mean of the readings' times (N,), without drift and reversal.

    Growth and material temperature (``unseen_c`` on top of its course, (N,)) enter as their means
    over the readings, as straight lines in the positioning functions.
    """
    warmth_c = float(np.mean(machine.environment.material_c.at(time_s) + unseen_c)) - 20.0
    share = 0.0 if machine.growth is None else float(np.mean(machine.growth.share(time_s)))
    functions = dict(machine.errors.functions)
    for axis, letter in enumerate(AXES):
        name = f"E{letter}{letter}"
        functions[name] = _grown(machine, axis, functions.get(name, zero), warmth_c, share)
    errors = ErrorSet(
        low_mm=machine.errors.low_mm,
        size_mm=machine.errors.size_mm,
        functions=functions,
        squareness_urad=machine.errors.squareness_urad,
    )
    return Machine(
        errors=errors,
        chain=machine.chain,
        reference_mm=machine.reference_mm,
        tool_offset_mm=machine.tool_offset_mm,
    )


def _grown(
    machine: Machine, axis: int, function: ErrorFunction, warmth_c: float, share: float
) -> ErrorFunction:
    """Return a positioning function with the mean growth of its axis."""
    origin_mm = float(machine.origin_mm[axis])
    heat_um_mm = machine.expansion_um_m_c[axis] * warmth_c * 1e-3
    warm = Sloped(function, origin_mm, heat_um_mm)
    if machine.growth is None:
        return warm
    rise_um_mm = machine.growth.um_m[axis] * share * 1e-3
    return Sloped(warm, machine.growth.bearing_mm[axis], rise_um_mm)


def _taken_passes(machine: Machine, shop: Shop) -> Iterator[_Taken]:
    rng = np.random.default_rng((shop.seed, 3))
    index, start_s = float(rng.normal(scale=shop.beam.index)), 0.0
    before = Standing(
        np.array(shop.box.origin_mm), np.full(3, -1.0), np.zeros(3), np.zeros(3)
    )
    for number, setup in enumerate(shop.setups):
        unseen_c = float(rng.normal(scale=shop.setup_c))
        stretch = _factor(index, shop, rng)
        for each in _taken_setup(
            _warmer(machine, unseen_c), shop, setup, before, start_s, rng
        ):
            before, start_s = each.one.end, float(each.one.time_s[-1]) + shop.turn_s
            yield replace(
                each,
                count_mm=each.count_mm * stretch,
                zero=number if each.zero >= 0 else -1,
                unseen_c=unseen_c,
            )
        start_s += shop.setup_s


def _factor(index: float, shop: Shop, rng: np.random.Generator) -> float:
    return 1.0 + index + float(rng.normal(scale=shop.beam.index_setup))


def _warmer(machine: Machine, unseen_c: float) -> Machine:
    """Return the machine with material that is warmer by ``unseen_c``."""
    hall = machine.environment
    course = replace(hall.material_c, start=hall.material_c.start + unseen_c)
    return replace(machine, environment=replace(hall, material_c=course))


def _taken_setup(
    machine: Machine,
    shop: Shop,
    setup: str,
    before: Standing,
    start_s: float,
    rng: np.random.Generator,
) -> Iterator[_Taken]:
    """Yield the passes of one setup; the machine of a program without overrun turns round at the
    last stop."""
    how = _alignment(shop, setup, rng)
    origin_mm, moved_um = 0.0, 0.0
    last = (0.0, np.zeros(3), 0.0)
    for number in range(1, shop.passes + 1):
        overrun = shop.overrun == "always" or (shop.overrun == "turns" and number > 1)
        taken = Conditions(
            noise_um=shop.beam.noise_um,
            seed=int(rng.integers(1 << 31)),
            start_s=start_s,
            seconds_per_stop=shop.seconds_per_stop,
            scatter=shop.scatter,
            registers=shop.registers,
            before=before,
            overrun=overrun,
        )
        one = simulate_pass(
            machine,
            shop.box,
            setup,
            number,
            alignment=how,
            conditions=taken,
            axis_order=shop.axis_order,
        )
        drift_um = moved_um + _drift_um(shop.beam, len(one.stop), rng)
        count_mm = one.first_mm + one.reading_mm + 1e-3 * drift_um
        position_mm, time_s = one.position_mm.copy(), one.time_s.copy()
        turned = number > 1 and not overrun
        if turned:
            count_mm[0], position_mm[0], time_s[0] = last
        origin_mm = float(count_mm[0]) if number == 1 or not shop.one_count else origin_mm
        yield _Taken(
            one,
            count_mm - origin_mm,
            position_mm,
            time_s,
            0 if shop.one_count else -1,
            turned,
            0.0,
        )
        last, moved_um = (
            (float(count_mm[-1]), position_mm[-1], float(time_s[-1])),
            float(drift_um[-1]),
        )
        before, start_s = one.end, float(one.time_s[-1]) + shop.turn_s


def _alignment(shop: Shop, setup: str, rng: np.random.Generator) -> Alignment:
    """Draw tilts of mirror and beam, evenly over a disc; the corner cube of a run along one axis
    has no tilt."""
    tilts = [_tilt(shop.beam.largest_mrad, rng) for _ in range(2)]
    linear = axis_of_run(setup) is not None
    return Alignment(mirror_mrad=(0.0, 0.0) if linear else tilts[0], beam_mrad=tilts[1])


def _tilt(largest_mrad: float, rng: np.random.Generator) -> tuple[float, float]:
    size, turn = (
        largest_mrad * float(np.sqrt(rng.random())),
        float(rng.uniform(0.0, 2.0 * np.pi)),
    )
    return size * float(np.cos(turn)), size * float(np.sin(turn))


def _drift_um(beam: Beam, count: int, rng: np.random.Generator) -> Array:
    """Draw what drifts along the beam over one pass of ``count`` stops, in um: a straight line and
    a random walk."""
    straight = rng.normal(scale=beam.drift_um) * np.linspace(0.0, 1.0, count)
    steps = rng.normal(scale=beam.wander_um / np.sqrt(max(count - 1, 1)), size=count)
    steps[0] = 0.0
    drifted: Array = straight + np.cumsum(steps)
    return drifted


ORDINARY_BEAM = Beam(
    drift_um=0.15, wander_um=0.1, index=2e-7, index_setup=1e-7, largest_mrad=1.0
)
"""Beam of an ordinary shop: drift, wander and air as the product's own table has them, tilts up to
1 mrad (CHOSEN)."""
NOISE_UM = (0.02, 0.5)
"""Sensor noise at a stop, standard deviation: 0.02 um as the mean of a dwell in the demo
(MEASURED), more where a machine hums (CHOSEN)."""
SCATTER_UM = (0.1, 3.0)
"""Scatter of encoder positions (MEASURED to matter; the sizes are RECALLED)."""


def draw_shop(rng: np.random.Generator, drawn: OrdinaryMachine) -> Shop:
    """Draw how an ordinary shop measures a machine: program, registers, overrun, passes, laser and
    hall."""
    registers, servo_um = _draw_registers(rng)
    noise_um = float(np.exp(rng.uniform(*np.log(NOISE_UM))))
    overrun: Overrun = ("always", "turns", "never")[int(rng.choice(3, p=(0.6, 0.2, 0.2)))]
    passes = int(rng.choice((1, 2, 4, 6), p=(0.3, 0.45, 0.15, 0.1)))
    return Shop(
        box=_draw_box(rng, drawn.machine.errors.size_mm),
        setups=(*DIAGONALS, *RUNS) if rng.random() < 0.8 else DIAGONALS,
        passes=passes,
        axis_order=str(rng.choice(("xyz", "xzy", "yxz", "yzx", "zxy", "zyx"))),
        overrun=overrun,
        scatter=Scatter(arrival_um=drawn.repeatability_um, servo_um=(servo_um,) * 3),
        registers=registers,
        beam=replace(ORDINARY_BEAM, noise_um=noise_um),
        one_count=overrun == "never" or bool(rng.random() < 0.8),
        thermometer=bool(rng.random() < 0.5),
        setup_c=drawn.setup_c,
        seconds_per_stop=float(rng.uniform(5.0, 15.0)),
        turn_s=float(rng.uniform(10.0, 60.0)),
        setup_s=float(rng.uniform(300.0, 1200.0)),
        seed=int(rng.integers(1 << 31)),
    )


def _draw_box(rng: np.random.Generator, size_mm: Three) -> Box:
    """Draw increments and the program's rounding: 2, 3 or 4 decimals, one program in four with
    G91."""
    decimals = int(rng.choice((2, 3, 4), p=(0.25, 0.5, 0.25)))
    return Box(
        size_mm=size_mm,
        increments=int(rng.integers(5, 21)),
        decimals=decimals,
        incremental=bool(rng.random() < 0.25),
    )


def _draw_registers(rng: np.random.Generator) -> tuple[PositionRegisters, float]:
    """Draw what the position registers show; the second figure is how far the axes truly stand off,
    in um."""
    resolution_mm = 1e-4 if rng.random() < 0.7 else 1e-3
    if rng.random() < 0.4:
        return PositionRegisters(shows="commanded", resolution_mm=resolution_mm), 0.0
    scatter_um = float(np.exp(rng.uniform(*np.log(SCATTER_UM))))
    if rng.random() < 0.5:
        return PositionRegisters(shows="actual", resolution_mm=resolution_mm), scatter_um
    return PositionRegisters(
        shows="actual", scatter_um=scatter_um, resolution_mm=resolution_mm
    ), 0.0
