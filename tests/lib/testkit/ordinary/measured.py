"""A pass measured without servers, at ideal stops."""

from dataclasses import dataclass, field

import numpy as np

from stepdiag.virtual.drive.registers import PositionRegisters
from stepdiag.virtual.drive.sequence import Box, driven_pass
from stepdiag.virtual.drive.setups import Alignment, aligned_setup
from stepdiag.virtual.physics.error_functions import Array
from stepdiag.virtual.physics.machine import Machine
from testkit.ordinary.arrivals import Scatter, Standing, arrivals, standing_at_end


@dataclass(frozen=True, slots=True)
class SimulatedPass:
    """The readings of a pass as columns: positions (by the registers) and readings in mm, relative
    to the pass's first stop.

    ``first_mm`` is the count at the first stop: passes of a set-up with an unbroken beam share its
    zero. ``end`` is the place of the axes after the pass.
    """

    setup: str
    number: int
    stop: np.ndarray[tuple[int], np.dtype[np.int64]]
    position_mm: Array
    reading_mm: Array
    time_s: Array
    temperature_c: Array
    beam_mm: Array
    first_mm: float
    end: Standing


@dataclass(frozen=True, slots=True, kw_only=True)
class Conditions:
    """Conditions of a pass.

    White noise of ``noise_um`` (standard deviation) on each reading, drawn by ``seed``, and the
    time. ``scatter`` is the scatter of the axes about their targets, ``registers`` the control's
    display of the position. ``before`` is the place of the axes before the pass, ``overrun``
    whether they come to its first stop in the direction of the pass
    (`arrivals`).
    """

    noise_um: float = 0.0
    seed: int = 0
    start_s: float = 0.0
    seconds_per_stop: float = 10.0
    scatter: Scatter = field(default_factory=Scatter)
    registers: PositionRegisters = field(default_factory=PositionRegisters)
    before: Standing | None = None
    overrun: bool = True


def simulate_pass(
    machine: Machine,
    box: Box,
    setup: str,
    number: int = 1,
    *,
    alignment: Alignment | None = None,
    conditions: Conditions | None = None,
    axis_order: str = "xyz",
) -> SimulatedPass:
    """Measure one pass without servers, at ideal stops."""
    how = alignment or Alignment()
    taken = conditions or Conditions()
    placed = aligned_setup(machine, box, setup, how)
    driven = driven_pass(box, setup, number, axis_order)
    times: Array = taken.start_s + taken.seconds_per_stop * np.arange(
        len(driven.stop_mm), dtype=np.float64
    )
    drawing = np.random.default_rng((taken.seed, 1))
    came = arrivals(
        driven, taken.scatter, drawing, before=taken.before, overrun=taken.overrun
    )
    indicated = machine.indicated_mm(
        placed, driven.stop_mm + came.off_mm, direction=came.side, time_s=times
    )
    noisy = indicated + np.random.default_rng(taken.seed).normal(
        scale=taken.noise_um * 1e-3, size=len(times)
    )
    return SimulatedPass(
        setup=setup,
        number=number,
        stop=np.arange(len(times), dtype=np.int64),
        position_mm=taken.registers.shown_mm(driven.stop_mm, came.servo_um, drawing),
        reading_mm=noisy - noisy[0],
        time_s=times,
        temperature_c=machine.environment.material_c.at(times),
        beam_mm=np.broadcast_to(placed.zero_mm + how.beam_offset_mm, driven.stop_mm.shape),
        first_mm=float(noisy[0]),
        end=standing_at_end(driven, came),
    )
