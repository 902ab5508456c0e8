"""An equal scale on every axis: either a wrong statement on the laser's air, its wavelength or the
expansion, or a machine with this scale.

Both lengthen all axes alike, by a known amount. A machine's own scales share a part (a warm screw,
a scale of glass) and differ in another; three axes that are all 270 µm/m long are rarely a machine.
The likelihoods of the scales as estimated, and after subtracting the effect of each statement, are
compared, with the odds of a wrong statement as prior.
"""

from collections.abc import Iterator

import numpy as np

from stepdiag.base.conditions.air import Air, refractive_index
from stepdiag.base.conditions.expansion import REFERENCE_TEMPERATURE_C
from stepdiag.base.findings import Finding, finding
from stepdiag.base.messages import Message, Place, message
from stepdiag.base.result.result import Result
from stepdiag.daq.capture.cause.hypotheses import laser_change
from stepdiag.daq.capture.cause.likelihood import CAUSE
from stepdiag.daq.survey.models import Survey

TOGETHER_UM_M, TOGETHER_AT_20_C_UM_M, EACH_UM_M = 60.0, 25.0, 30.0
"""Standard deviation of the common scale of a machine's axes, caused by 5 K on steel or left after
a correction; and of the separate scale of each.
"""
HENE_NM = 632.991
LEAST_UM_M = 100.0
"""A smaller effect cannot be distinguished from a machine's own scales."""


def one_scale(survey: Survey, result: Result) -> list[Finding]:
    """Return the error that names a statement on air or wavelength which makes all scales equal;
    None without such a statement, or if a single axis is measured. The error stands at the first
    linear run, the place for its acceptance.
    """
    scales = {axis: scale for axis, scale in result.scale.items() if scale.value is not None}
    if len(scales) < 2:
        return []
    value, u = (
        np.array([getattr(scale, name) or 0.0 for scale in scales.values()])
        for name in ("value", "u")
    )
    together = TOGETHER_AT_20_C_UM_M if survey.machine.apply_expansion else TOGETHER_UM_M
    covariance = together**2 + np.diag(EACH_UM_M**2 + u**2)
    weight = np.linalg.inv(covariance)
    plain = float(value @ weight @ value)
    gains = [
        (
            0.5 * (plain - float((value - effect) @ weight @ (value - effect))) - CAUSE,
            effect,
            what,
            line,
        )
        for effect, what, line in _statements(survey, result)
        if abs(effect) > LEAST_UM_M
    ]
    gain, effect, what, (line, to) = max(
        gains, key=lambda each: each[0], default=(0.0, 0.0, "", ("", ""))
    )
    if gain <= 0.0:
        return []
    shown = [f"{axis} {number:+.0f}" for axis, number in zip(scales, value.tolist(), strict=True)]
    run = next(
        (name for name in survey.plan.all_setups if name.startswith("linear")),
        survey.plan.all_setups[0],
    )
    words = message(
        "step-mismatch.scales", scales=shown, what=what, effect_um_m=effect, line=line, value=to
    )
    return [finding("error", words, Place(setup=run, pass_number=1))]


def _statements(survey: Survey, result: Result) -> Iterator[tuple[float, Message, tuple[str, str]]]:
    """Yield by how much each wrong statement lengthens all axes, in µm/m, and the line to change
    with its new value."""
    laser, stated = survey.laser, survey.environment
    air = Air(
        temperature_c=np.array(stated.air_temperature_c),
        pressure_hpa=np.array(stated.air_pressure_hpa),
        humidity_percent=np.array(stated.relative_humidity_percent),
    )
    index = float(refractive_index(air, HENE_NM)) - 1
    if laser.compensated:
        yield 1e6 * index, message("cause-air-never"), ("laser.compensated", "false")
    else:
        yield -1e6 * index, message("cause-air-twice"), ("laser.compensated", "true")
    factor = laser.wavelength_nm / HENE_NM
    yield (
        1e6 * (factor - 1) if abs(factor - 1) < 2e-3 else 0.0,
        message("cause-wavelength-in-air"),
        laser_change(survey, factor),
    )
    warm_c = (
        result.lengths.material_c
        if result.lengths is not None and survey.machine.apply_expansion
        else None
    )
    if warm_c is not None:
        twice = -float(
            np.mean(
                np.array(survey.machine.expansion_um_m_c)
                * (np.array(warm_c) - REFERENCE_TEMPERATURE_C)
            )
        )
        yield twice, message("cause-expansion-twice"), ("machine.apply_expansion", "false")
