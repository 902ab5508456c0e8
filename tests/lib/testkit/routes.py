"""Routes of passes on their usual lines."""

from stepdiag.base.readings.runs import Plan, Run
from stepdiag.base.volume import Volume
from stepdiag.daq.capture.naming.route import Route, route_of


def make_route(volume: Volume, setup: str, axis_order: str, *, outward: bool) -> Route:
    """Return the route of a pass of a setup on its usual line."""
    return route_of(
        Plan(volume=volume, runs=(Run(setup=setup),), axis_order=axis_order),
        setup,
        1 if outward else 2,
    )
