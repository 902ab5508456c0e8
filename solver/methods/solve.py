"""The only entry to the solver: a function that takes the readings and returns the result."""

from collections.abc import Sequence

from stepdiag.base.conditions.assumptions import Assumptions
from stepdiag.base.kinematics import parse_chain
from stepdiag.base.readings.readings import Readings
from stepdiag.base.result.result import Result
from stepdiag.solver.methods.lengths import at_their_temperature
from stepdiag.solver.methods.registry import Options, method_of
from stepdiag.solver.model.angles import Angles
from stepdiag.solver.model.lateral import MeasuredStraightness
from stepdiag.solver.model.layout import lay_out


def solve(
    readings: Readings,
    *,
    chain: str = "FXYZ",
    method: str = "estimate",
    angles: Angles | None = None,
    straightness: Sequence[MeasuredStraightness] = (),
    assumed: Assumptions | None = None,
    source: str = "readings",
    monte_carlo: int = 0,
) -> Result:
    """Return the result of a survey: the machine's errors by the readings.

    ``chain`` is ``FXYZ`` .. ``XYZF`` or the ISO form ``[w X' b Y Z t]``. ``angles`` are angular
    functions known from another measurement. All other angular functions are determined if the
    beams allow this, else estimated within their usual sizes. ``straightness`` are the values
    measured by a 4-DOF head, ``assumed`` the user's assumptions about machine and hall. ``source``
    names the readings in messages. ``monte_carlo`` is the number of surveys simulated to check the
    law of propagation (JCGM 101), 0 for none. Raises ``UsageError`` for a wrong chain or method,
    ``DataError`` where the readings do not form a survey or the method needs other readings.
    """
    parse_chain(chain)
    chosen = method_of(method)
    settled = at_their_temperature(readings, assumed, source)
    options = Options(
        chain=chain,
        angles=angles,
        straightness=tuple(straightness),
        assumed=settled,
        trials=monte_carlo,
    )
    return chosen(lay_out(readings, source), options)
