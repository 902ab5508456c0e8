"""The one door of the solver: readings in, result out."""

from collections.abc import Sequence

from stepdiag.solver.geometry.kinematics import parse_chain
from stepdiag.solver.methods.registry import Options, method_of
from stepdiag.solver.model.angles import Angles
from stepdiag.solver.model.lateral import MeasuredStraightness
from stepdiag.solver.model.layout import lay_out
from stepdiag.solver.readings.readings import Readings
from stepdiag.solver.result.result import Result


def solve(
    readings: Readings,
    *,
    chain: str = "FXYZ",
    method: str = "estimate",
    angles: Angles | None = None,
    estimate_angles: bool = False,
    straightness: Sequence[MeasuredStraightness] = (),
    source: str = "readings",
) -> Result:
    """Return what the readings of a survey say about the machine.

    ``chain`` is ``FXYZ`` .. ``XYZF`` or the ISO form ``[w X' b Y Z t]``. ``angles`` are angular functions known from elsewhere;
    ``estimate_angles`` solves the others from the readings, as far as they are identifiable. ``straightness`` is what a 4-DOF head
    measured. ``source`` names the readings in messages.
    Raises ``UsageError`` for a wrong chain or method, ``DataError`` where the readings are no survey or the method needs others.
    """
    parse_chain(chain)
    chosen = method_of(method)
    options = Options(chain=chain, angles=angles, estimate_angles=estimate_angles, straightness=tuple(straightness))
    return chosen(lay_out(readings, source), options)
