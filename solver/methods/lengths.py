"""The temperature for which the lengths of a result are valid: that of the survey, or 20 C (ISO 1)
if every reading was reduced to 20 C.

The tables correct the scales (and with them EXX, EYY, EZZ) at this temperature. The report also
contains the scales at the other temperature.
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
"""Standard uncertainty in C of an assumed material temperature, as for a sensor whose last value
is one hour old. An uncertainty in the survey file replaces this value."""
REACH_MM = 100.0
"""Distance between mirror and tool tip for which the effect of the angles is reported."""


def at_their_temperature(
    readings: Readings, assumed: Assumptions | None, source: str
) -> Assumptions:
    """Return the assumptions with the material's temperature, and whether the readings are reduced
    to 20 C.

    Without a measured temperature, readings reduced to 20 C have the stated uncertainty of the
    temperature, or else `UNMEASURED_C`. Raises ``DataError`` if only some readings were reduced.
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
    """Return the findings about readings without a temperature (NaN in ``temperature_c``)."""
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
    """Return the lengths that the tables correct, and the scales as measured and at 20 C with their
    combined u.

    The scale at the other temperature is None if the material's temperature was not measured
    (``known`` is False).
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
    """Return a scale in um/m at the other temperature, with its u. A warm measuring scale is
    longer, so the machine moves too far."""
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
    # the scale as measured does not contain the uncertainty of the reduction to 20 C; the part of
    # the readings does not change
    least = scale.u_readings or 0.0
    return LengthScale(
        value=scale.value + coefficient * excess,
        u=float(np.sqrt(max(scale.u**2 - material**2, least**2))),
    )


def tool_report(
    errors: Mapping[str, Function], expected: Mapping[str, Function], assumed: Assumptions
) -> Tool:
    """Return the point for which the errors are reported, and the effect of the angles in um (k =
    2) on a tool tip at `REACH_MM` from this point. The errors are reported for the point where the
    beam meets the mirror. The effect is computed from the largest value and U of each angular
    function, or from its assumed range."""
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
