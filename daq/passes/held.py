"""The uncertainty of the values that replace missing values of a sensor, for the budget of a
survey.
"""

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, replace

import numpy as np

from stepdiag.base.conditions.air import HALL, Air, AirUncertainty, index_u
from stepdiag.base.conditions.assumptions import Assumptions
from stepdiag.daq.capture.captured_stop import CapturedStop
from stepdiag.daq.capture.conditions import COURSES
from stepdiag.daq.capture.remarks.remarks import credible_of
from stepdiag.daq.passes.pass_book import PassBook
from stepdiag.daq.survey.environment import AIR
from stepdiag.daq.survey.models import Survey

NEVER_SEEN_S = 3600.0
"""Age in s at which a reading of a sensor is as uncertain as an unconfirmed value of the survey
file.
"""


@dataclass(frozen=True, slots=True)
class Held:
    """A condition that no sensor measured at some stops: the number of these stops, and the largest
    standard uncertainty of the replacing values.
    """

    name: str
    stops: int
    u: float


def held_conditions(book: PassBook, stated: Iterable[str] = ()) -> tuple[Held, ...]:
    """Return the conditions with a replaced value at used stops, except conditions ``stated``
    afterwards.

    The uncertainty covers the possible change of a value since its last valid reading
    (`capture.conditions`), taken as the half width of a rectangular distribution (GUM 4.3.7).
    """
    u = _u_by_name(sorted(_in_use(book), key=lambda stop: stop.time_s))
    return tuple(
        Held(name, len(values), max(values))
        for name, values in u.items()
        if values and name not in set(stated)
    )


def with_held(assumed: Assumptions, survey: Survey, held: Iterable[Held]) -> Assumptions:
    """Return the assumptions with the uncertainty of the replaced values of air and material added
    in quadrature.

    The part of the uncertainty that is common to all setups is unknown, so the full uncertainty is
    added to two assumptions: for the whole survey, and from setup to setup.
    """
    u: dict[str, float] = {}
    for each in held:
        u[each.name] = max(each.u, u.get(each.name, 0.0))
    index, material = _index_u(survey, u), u.get("material_temperature_c", 0.0)
    return replace(
        assumed,
        index=float(np.hypot(assumed.index, index)),
        index_setup=float(np.hypot(assumed.index_setup, index)),
        u_material_c=float(np.hypot(assumed.u_material_c, material)),
    )


def assumed_conditions(
    book: PassBook, survey: Survey, stated: Iterable[str] = ()
) -> tuple[Held, ...]:
    """Return the conditions of the air that affect the readings and that no sensor measured at some
    used stops.

    At these stops the value of the survey file was used. Conditions stated in the file or
    afterwards are left out. The material temperature is left out because the solver includes its
    uncertainty.
    """
    if survey.laser.compensated or survey.environment.source == "fixed":
        return ()
    wanted = [name for name in AIR if name not in set(stated)]
    missing = {
        name: sum(
            getattr(stop, name) is None and name not in stop.held for stop in _in_use(book)
        )
        for name in wanted
    }
    unsure = {
        name: (COURSES[name].at_once + COURSES[name].an_hour * NEVER_SEEN_S / 3600.0)
        / np.sqrt(3.0)
        for name in wanted
    }
    return tuple(
        Held(name, stops, float(unsure[name])) for name, stops in missing.items() if stops
    )


def _in_use(book: PassBook) -> Iterator[CapturedStop]:
    for each in book.passes:
        yield from each.chosen().values()


def _u_by_name(stops: Iterable[CapturedStop]) -> dict[str, list[float]]:
    found: dict[str, list[float]] = {name: [] for name in COURSES}
    seen_s: dict[str, float] = {}
    for stop in stops:
        seen_s |= dict.fromkeys(credible_of(stop), stop.time_s)
        for name in stop.held:
            age_s = stop.time_s - seen_s[name] if name in seen_s else NEVER_SEEN_S
            found[name].append(
                (COURSES[name].at_once + COURSES[name].an_hour * age_s / 3600.0)
                / np.sqrt(3.0)
            )
    return found


def _index_u(survey: Survey, u: Mapping[str, float]) -> float:
    """Return the additional relative uncertainty of the index of air; 0 for an instrument that
    corrects its own air.
    """
    if survey.laser.compensated or not any(name in u for name in AIR):
        return 0.0
    usual = [np.clip(getattr(survey.environment, name), *HALL[name]) for name in AIR]
    air = Air(temperature_c=usual[0], pressure_hpa=usual[1], humidity_percent=usual[2])
    temperature, pressure, humidity = (u.get(name, 0.0) for name in AIR)
    unsure = AirUncertainty(
        temperature_c=temperature, pressure_hpa=pressure, humidity_percent=humidity
    )
    return float(index_u(air, survey.laser.wavelength_nm, unsure))
