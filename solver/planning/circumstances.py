from collections.abc import Iterable
from dataclasses import dataclass, field
from math import sqrt

from stepdiag.base.conditions.assumptions import Assumptions
from stepdiag.base.readings.runs import Run
from stepdiag.base.result.result import AXIS_LETTERS, ROTATIONS
from stepdiag.solver.planning.information import Aim, Zone

USUAL_DWELL_S = 2.0
"""Dwell in s for which the assumed noise of a reading is valid."""

PITCH_AND_YAW = tuple(
    name for name in ROTATIONS if name[1] != "ABC"[AXIS_LETTERS.index(name[2])]
)


@dataclass(frozen=True, slots=True, kw_only=True)
class Circumstances:
    """The conditions of a survey that are not in its plan.

    ``head`` is True if an instrument for angles is available; ``head_turns`` are the functions that
    this instrument measures (pitch and yaw for a 4-DOF head), and ``head_u_urad`` is their
    uncertainty. ``shift_mm`` is the largest shift of a beam from its usual line. ``aim`` is the
    kind of compensation tables of the control. ``zone`` is the part of the volume that must be
    accurate. ``in_step`` are numbers of increments with which all targets have the same phase of a
    ball screw's wave. ``dwells_s`` are possible dwells in addition to the planned dwell.
    """

    chain: str = "FXYZ"
    assumed: Assumptions = field(default_factory=Assumptions)
    head: bool = True
    head_u_urad: float = 1.0
    head_turns: tuple[str, ...] = PITCH_AND_YAW
    shift_mm: float = 150.0
    aim: Aim = "lattice"
    zone: Zone | None = None
    in_step: tuple[int, ...] = ()
    dwells_s: tuple[float, ...] = (2.0, 4.0)

    def reading_um(self, dwell_s: float) -> float:
        """Return the noise of a reading averaged over a dwell."""
        return self.assumed.reading_um * sqrt(USUAL_DWELL_S / dwell_s)

    def head_ranges_urad(self, runs: Iterable[Run]) -> dict[str, float]:
        """Return the range of each angular function that remains uncertain after the head's
        runs."""
        axes = {run.travel.axis.upper() for run in runs if run.is_fourdof}
        names = [name for name in self.head_turns if name[2] in axes]
        return {
            name: min(2.0 * self.head_u_urad, self.assumed.angle_range_urad(name))
            for name in names
        }
