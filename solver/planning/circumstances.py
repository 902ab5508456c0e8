"""Everything about the job of a survey that is not in its plan."""

from collections.abc import Iterable
from dataclasses import dataclass, field
from math import sqrt

from stepdiag.base.conditions.assumptions import Assumptions
from stepdiag.base.readings.runs import Run
from stepdiag.base.result.result import AXIS_LETTERS, ROTATIONS
from stepdiag.solver.planning.information import Aim, Zone

USUAL_DWELL_S = 2.0
"""Averaging time in s assumed for a reading that states no noise of its own."""

PITCH_AND_YAW = tuple(
    name for name in ROTATIONS if name[1] != "ABC"[AXIS_LETTERS.index(name[2])]
)


@dataclass(frozen=True, slots=True, kw_only=True)
class Circumstances:
    """``head``: an instrument of angles is available; ``head_turns``: the functions that its runs
    measure, pitch and yaw of a 4-DOF head, and ``head_u_urad`` their uncertainty. ``shift_mm``: how
    far a beam or a mirror can be shifted beside its usual line. ``aim``: the errors that the
    control's tables can correct; ``zone``: the part of the volume that must be accurate.
    ``in_step``: numbers of increments whose targets meet a wave of the screws always at the same
    phase. ``dwells_s``: further possible dwells at each stop, besides the planned one.
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
        """Return the noise of a reading, the mean over a dwell."""
        return self.assumed.reading_um * sqrt(USUAL_DWELL_S / dwell_s)

    def head_ranges_urad(self, runs: Iterable[Run]) -> dict[str, float]:
        """Return the ranges of the functions that runs of the head measure, known to its
        uncertainty."""
        axes = {run.travel.axis.upper() for run in runs if run.is_fourdof}
        names = [name for name in self.head_turns if name[2] in axes]
        return {
            name: min(2.0 * self.head_u_urad, self.assumed.angle_range_urad(name))
            for name in names
        }
