"""Commissioning of the 4-DOF head during a run. At both ends of the run, the machine jogs the two
axes that the run does not travel, and the operator then moves the laser by hand.

The machine approaches every jog position from below in both axes, so that differences of positions
contain no backlash. `stepdiag.fourdof.commission` finds the jog positions and the standstills in
the log.
"""

from dataclasses import dataclass

from stepdiag.base.names import AXES

PLACES_MM = (-0.3, -0.15, 0.0, 0.15, 0.3)
LEAD_MM = -0.4
"""Start of the approach to every jog position, in mm. The start is below the lowest position by
more than any backlash.
"""
JOG_S, WOBBLE_S, DARK_S = 2.0, 30.0, 5.0
WOBBLE = (
    "wobble the pointing of the laser gently by hand in both directions until the axes move "
    "again. start"
)
BLOCK, FREE = "block the beam and leave it blocked. start", "free the beam. start"


@dataclass(frozen=True, slots=True, kw_only=True)
class Jog:
    """A jog: a position that the machine approaches without a signal to the PLC, the dwell there,
    and a question to the operator before the move.
    """

    position_mm: tuple[float, float, float]
    stand_s: float = 0.0
    ask: str = ""


def jogs_at(
    place_mm: tuple[float, float, float], axis: str, *, last: bool = False
) -> tuple[Jog, ...]:
    """Return the jogs at one end of a run along ``axis`` (x, y, z), with the stop at which the
    operator moves the laser. At the ``last`` end the operator also blocks the beam.
    """
    others = [index for index in range(3) if AXES[index] != axis]

    def beside(*moved_mm: float) -> tuple[float, float, float]:
        place = list(place_mm)
        for index, by in zip(others, moved_mm, strict=True):
            place[index] += by
        x, y, z = place
        return x, y, z

    lead = Jog(position_mm=beside(LEAD_MM, LEAD_MM))
    first = [Jog(position_mm=beside(place, 0.0), stand_s=JOG_S) for place in PLACES_MM]
    second = [Jog(position_mm=beside(0.0, place), stand_s=JOG_S) for place in PLACES_MM]
    centre = beside(0.0, 0.0)
    wobble = Jog(position_mm=centre, stand_s=WOBBLE_S, ask=WOBBLE)
    dark = (
        (
            Jog(position_mm=centre, stand_s=DARK_S, ask=BLOCK),
            Jog(position_mm=centre, ask=FREE),
        )
        if last
        else ()
    )
    return (lead, *first, lead, *second, lead, wobble, *dark)
