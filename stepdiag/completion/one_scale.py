"""An equal scale of all axes: its cause is a wrong entry about air, wavelength or expansion, or a
machine with this scale.

A wrong entry in the survey file lengthens all axes equally by a known amount. The scales of a
machine have a common part (a warm screw, a glass scale) and a part per axis; three axes that are
all too long by 270 µm/m are rare. For each wrong entry, the program subtracts the effect of the
entry from the measured scales. The program then compares the likelihood of these scales with the
likelihood of the measured scales. The prior contains the odds against a wrong entry. If the scales
cannot separate both explanations, the finding contains both explanations. The finding also contains
the reading of the laser that decides between both explanations.
"""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from stepdiag.base.conditions.air import Air, refractive_index
from stepdiag.base.conditions.expansion import REFERENCE_TEMPERATURE_C
from stepdiag.base.findings import Finding, finding
from stepdiag.base.messages import Message, Place, message
from stepdiag.base.result.result import Result
from stepdiag.daq.capture.cause.hypotheses import laser_change
from stepdiag.daq.capture.cause.likelihood import Change
from stepdiag.daq.capture.noise import FAULT, ORDINARY
from stepdiag.daq.survey.models import Survey

TOGETHER_UM_M, TOGETHER_AT_20_C_UM_M, EACH_UM_M = 60.0, 25.0, 30.0
"""Standard deviations in um/m: of the common scale of a machine's axes (5 K on steel, or the
remainder after a correction to 20 C), and of the separate scale of each axis."""
HENE_NM = 632.991
ALIKE = 3.0
"""Logarithm of the odds above which a machine with this common scale is the better explanation: the
probability of a wrong entry is then below one in twenty."""
TWICE = 5.0
"""Logarithm of the odds against an expansion that is removed twice. These odds are smaller than the
odds against other wrong entries, because displays with a material sensor remove the expansion by
default."""


def one_scale(survey: Survey, result: Result) -> list[Finding]:
    """Return the finding about the entry on air, wavelength or expansion that can explain the equal
    scales. Return no finding without such an entry, or with a single measured axis.

    The finding belongs to the first linear run, so a person can accept this finding for this run.
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

    def gain(statement: _Statement) -> float:
        left = value - statement.effect_um_m
        return 0.5 * (plain - float(left @ weight @ left)) - statement.odds

    likeliest = max(_statements(survey, result), key=gain)
    if gain(likeliest) <= -ALIKE:
        return []
    shown = [
        f"{axis} {number:+.0f}" for axis, number in zip(scales, value.tolist(), strict=True)
    ]
    run = next(
        (name for name in survey.plan.all_setups if name.startswith("linear")),
        survey.plan.all_setups[0],
    )
    line, to = likeliest.change
    words = message(
        "step-mismatch.scales",
        scales=shown,
        what=likeliest.what,
        effect_um_m=likeliest.effect_um_m,
        reading=likeliest.reading,
        line=line,
        value=to,
    )
    return [finding("error", words, Place(setup=run, pass_number=1))]


@dataclass(frozen=True, slots=True)
class _Statement:
    """An entry of the survey file that can be wrong: the lengthening of all axes in µm/m if it is
    wrong, the line with its new value, and the reading that shows the fault. ``odds`` is the
    logarithm of the odds against this fault."""

    effect_um_m: float
    what: Message
    reading: Message
    change: Change
    odds: float = FAULT + ORDINARY


def _statements(survey: Survey, result: Result) -> Iterator[_Statement]:
    laser, stated = survey.laser, survey.environment
    air = Air(
        temperature_c=np.array(stated.air_temperature_c),
        pressure_hpa=np.array(stated.air_pressure_hpa),
        humidity_percent=np.array(stated.relative_humidity_percent),
    )
    index = float(refractive_index(air, HENE_NM)) - 1
    yield _Statement(
        1e6 * index if laser.compensated else -1e6 * index,
        message("cause-air-never") if laser.compensated else message("cause-air-twice"),
        message("reading-air"),
        ("laser.compensated", "false" if laser.compensated else "true"),
    )
    factor = laser.wavelength_nm / HENE_NM
    if abs(factor - 1) < 2e-3:
        yield _Statement(
            1e6 * (factor - 1),
            message("cause-wavelength-in-air"),
            message("reading-wavelength"),
            laser_change(survey, factor),
        )
    material_c = result.lengths.material_c if result.lengths is not None else None
    if material_c is not None and survey.machine.apply_expansion:
        warmer_c = np.array(material_c) - REFERENCE_TEMPERATURE_C
        yield _Statement(
            -float(np.mean(np.array(survey.machine.expansion_um_m_c) * warmer_c)),
            message("cause-expansion-twice"),
            message("reading-expansion"),
            ("machine.apply_expansion", "false"),
            TWICE,
        )
