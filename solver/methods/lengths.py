"""The temperature of a result's lengths, that of the survey or 20 C (ISO 1), and the lengths at the
other of these two temperatures.

The scales, and with them EXX, EYY and EZZ, are valid for one temperature: that of the survey, or 20
C if every reading was reduced to 20 C before. The tables correct these scales. The report also
shows the scales at the other temperature, which no table uses.
"""

from collections.abc import Mapping
from dataclasses import replace
from typing import get_args

import numpy as np

from stepdiag.base.conditions.assumptions import Assumptions
from stepdiag.base.conditions.expansion import REFERENCE_TEMPERATURE_C
from stepdiag.base.errors import DataError
from stepdiag.base.findings import Finding, info, warning
from stepdiag.base.messages import message
from stepdiag.base.readings.readings import Readings
from stepdiag.base.result.members import Axis, Lengths, LengthScale, LengthsReport, Tool
from stepdiag.base.result.result import ROTATIONS, Function, Scale
from stepdiag.base.volume import Vector
from stepdiag.solver.model.warmth import expansions

AS_MEASURED: Lengths = "as_measured"
AT_20_C: Lengths = "at_20_c"
UNMEASURED_C = 3.5
"""Standard uncertainty in C of an assumed material temperature (20 C, or the value in a survey
file): that of a sensor without a reading for an hour. A value stated by the user replaces this
assumption.
"""
REACH_MM = 100.0
"""Distance from the mirror to the tool tip for which the effect of the angles is reported."""


def at_their_temperature(
    readings: Readings, assumed: Assumptions | None, source: str
) -> Assumptions:
    """Return the assumptions with two facts added: whether the readings are reduced to 20 C, and
    the material's temperature.

    Readings reduced to 20 C from an unmeasured temperature carry the uncertainty of this
    temperature: the value stated by the user, else `UNMEASURED_C`. Raises ``DataError`` if some
    readings were reduced to 20 C and others not.
    """
    found = assumed or Assumptions()
    reduced = bool(len(readings) and readings.at_20_c.all())
    if readings.at_20_c.any() and not readings.at_20_c.all():
        row = int(np.argmin(readings.at_20_c))
        place = (
            f"{source}: setup {readings.setup[row]}, pass {readings.pass_number[row]}, stop "
            f"{readings.stop[row]}"
        )
        raise DataError(
            place, expected=message("at-20"), found="0", remedy=message("all-or-none")
        )
    known = readings.temperature_c[np.isfinite(readings.temperature_c)]
    if len(known):
        mean = float(np.mean(known))
        found = replace(found, material_c=(mean, mean, mean))
    if (
        reduced
        and not found.material_stated
        and not np.all(np.isfinite(readings.temperature_c))
    ):
        found = replace(found, u_material_c=max(found.u_material_c, UNMEASURED_C))
    return replace(found, reduced_to_20_c=reduced) if len(readings) else found


def temperature_findings(temperature_c: Vector, assumed: Assumptions) -> tuple[Finding, ...]:
    """Return the findings about readings without a measured temperature (NaN in ``temperature_c``).

    A machine's sensor, or the operator, gives a temperature for each reading: a temperature of only
    some readings is not the temperature of the survey.
    """
    missing = int(np.count_nonzero(~np.isfinite(temperature_c)))
    if not missing:
        return ()
    count = len(temperature_c)
    if assumed.reduced_to_20_c and assumed.material_stated:
        return (
            warning(
                "material-unmeasured.stated",
                count=missing,
                readings=count,
                u_c=assumed.u_material_c,
            ),
        )
    if assumed.reduced_to_20_c:
        return (
            warning(
                "material-unmeasured.assumed",
                count=missing,
                readings=count,
                u_c=assumed.u_material_c,
            ),
        )
    return (
        info(
            "material-unmeasured",
            count=missing,
            readings=count,
            expansions=expansions(assumed),
        ),
    )


def lengths_report(
    scales: Mapping[str, Scale], assumed: Assumptions, *, known: bool
) -> LengthsReport:
    """Return which lengths the tables correct, and the scales as measured and at 20 C with the
    combined u of each.

    ``known`` is true if the material's temperature was measured; else the scale at the other
    temperature is None.
    """
    here, other = (
        (AT_20_C, AS_MEASURED) if assumed.reduced_to_20_c else (AS_MEASURED, AT_20_C)
    )
    both: dict[str, dict[Axis, LengthScale]] = {
        here: {
            axis: LengthScale(value=scales[axis].value, u=scales[axis].u)
            for axis in get_args(Axis)
        },
        other: {
            axis: _elsewhere(scales[axis], place, assumed, known=known)
            for place, axis in enumerate(get_args(Axis))
        },
    }
    return LengthsReport(
        tables=here,
        material_c=assumed.material_c if known else None,
        expansion_um_m_c=assumed.expansion_um_m_c,
        as_measured=both[AS_MEASURED],
        at_20_c=both[AT_20_C],
    )


def _elsewhere(scale: Scale, axis: int, assumed: Assumptions, *, known: bool) -> LengthScale:
    """Return a scale (um/m) at the other temperature, and the u of this scale: a warm measuring
    scale is longer, so the machine moves too far.
    """
    if scale.value is None or scale.u is None or not known:
        return LengthScale(value=None, u=None)
    excess, coefficient = (
        assumed.material_c[axis] - REFERENCE_TEMPERATURE_C,
        assumed.expansion_um_m_c[axis],
    )
    material = float(assumed.u_grown_um_m()[axis])
    if not assumed.reduced_to_20_c:
        return LengthScale(
            value=scale.value - coefficient * excess, u=float(np.hypot(scale.u, material))
        )
    # the conversion from 20 C back subtracts the uncertainty of the reduction to 20 C; the
    # readings' own part stays
    least = scale.u_readings or 0.0
    return LengthScale(
        value=scale.value + coefficient * excess,
        u=float(np.sqrt(max(scale.u**2 - material**2, least**2))),
    )


def tool_report(
    errors: Mapping[str, Function], expected: Mapping[str, Function], assumed: Assumptions
) -> Tool:
    """Return the point to which the errors belong, and the effect of the angles on a tool tip at
    `REACH_MM` from this point, in um (k = 2).

    The functions belong to the point where the beam meets the mirror: the model's tool offset is
    zero. An angular function enters with its largest value and U, an undetermined angular function
    with the assumed range.
    """
    reach = []
    for name in ROTATIONS:
        function = errors.get(name) or expected.get(name)
        if function is None or function.value is None:
            reach.append(2.0 * assumed.angle_range_urad(name))
        else:
            reach.append(
                float(
                    np.max(
                        np.abs(function.value)
                        + (0.0 if function.u is None else 2.0 * function.u)
                    )
                )
            )
    return Tool(
        offset_mm=(0.0, 0.0, 0.0),
        up_to_um_per_100_mm=1e-3 * REACH_MM * float(np.linalg.norm(reach)),
    )
