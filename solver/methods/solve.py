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
    """Return the result of a survey: the machine's errors.

    ``chain`` is ``FXYZ`` .. ``XYZF`` or the ISO form ``[w X' b Y Z t]``. ``angles`` are angular
    functions from another measurement; all other angular functions are estimated. ``straightness``
    are values of a 4-DOF head. ``assumed`` are the user's assumptions about machine and hall.
    ``source`` is the name of the readings in messages. ``monte_carlo`` is the number of simulated
    surveys (JCGM 101). Raises ``UsageError`` for an invalid chain or method, and ``DataError`` if
    the readings do not form a survey or the method needs other readings.
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
