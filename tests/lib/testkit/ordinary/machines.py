"""Ordinary machines: sizes of the errors of real three-axis machines, as a table with its sources,
and a draw from the table by seed.

`FIGURES` is the table. Each figure has a value for a good, an ordinary and a poor machine and a
mark of its source: READ (a public source was opened, in 2026-11), DERIVED (computed from another
figure), RECALLED (general knowledge, not checked), MEASURED (found on exact machines), CHOSEN (a
choice for this table). Lengths of axes: 300 mm to 1 m; with ``large`` 1 to 4 m.

Sizes of machines of a class scatter by `SPREAD`. Figures in um (shapes, growth) scale with the
travel; figures in urad do not.
"""

from dataclasses import dataclass
from typing import Literal

import numpy as np

from stepdiag.virtual.physics.environment import Course, Environment
from stepdiag.virtual.physics.error_functions import (
    AXES,
    DISPLACEMENTS,
    ROTATIONS,
    SQUARENESS,
    ErrorFunction,
    ErrorSet,
    Smooth,
    Table,
    Waved,
    smooth,
)
from stepdiag.virtual.physics.growth import Growth, Three
from stepdiag.virtual.physics.machine import Machine

Quality = Literal["good", "ordinary", "poor"]
Feedback = Literal["scale", "screw"]
Mark = Literal["READ", "MEASURED", "DERIVED", "RECALLED", "CHOSEN"]
QUALITIES: tuple[Quality, ...] = ("good", "ordinary", "poor")
SHARES = (0.25, 0.60, 0.15)
"""Shares of good, ordinary and poor machines (CHOSEN: most weight on ordinary)."""
CHAINS = ("FXYZ", "XYFZ", "XFYZ", "XYZF")


@dataclass(frozen=True, slots=True, kw_only=True)
class Figure:
    """A size for each quality, with its unit, its mark and its source."""

    good: float
    ordinary: float
    poor: float
    unit: str
    mark: Mark
    source: str

    def of(self, quality: Quality) -> float:
        """Return the size for a quality."""
        return {"good": self.good, "ordinary": self.ordinary, "poor": self.poor}[quality]


FIGURES = {
    "repeatability": Figure(
        good=0.2,
        ordinary=0.5,
        poor=1.5,
        unit="um, standard deviation of one approach of one axis",
        mark="DERIVED",
        source=(
            "R of one direction is 4 standard deviations (READ: an ISO 230-2 report, github "
            "paulscherrerinstitute/ecmccfg, "
            "examples/test/fat_sat); makers of precise machines state +-2 um or less (READ: "
            "jmcncmachine.com), others 1 to "
            "5 um (RECALLED)"
        ),
    ),
    "reversal": Figure(
        good=0.5,
        ordinary=2.0,
        poor=20.0,
        unit="um",
        mark="RECALLED",
        source="general knowledge; one good machine showed 0.15 um (READ: site report of a "
        "Bostomatic 32GS, 2009)",
    ),
    "angle": Figure(
        good=5.0,
        ordinary=15.0,
        poor=50.0,
        unit="urad, range over the travel",
        mark="RECALLED",
        source="general knowledge",
    ),
    "squareness": Figure(
        good=10.0,
        ordinary=30.0,
        poor=100.0,
        unit="urad",
        mark="RECALLED",
        source="general knowledge; the tolerances of ISO 10791-1 were not found in public",
    ),
    "scale": Figure(
        good=5.0,
        ordinary=20.0,
        poor=50.0,
        unit="um/m",
        mark="RECALLED",
        source="general knowledge",
    ),
    "positioning": Figure(
        good=2.0,
        ordinary=6.0,
        poor=12.0,
        unit="um per 500 mm, largest deviation from the end-point line",
        mark="RECALLED",
        source="general knowledge",
    ),
    "straightness": Figure(
        good=1.5,
        ordinary=4.0,
        poor=10.0,
        unit="um per 500 mm, largest deviation from the end-point line",
        mark="RECALLED",
        source="general knowledge",
    ),
    "growth": Figure(
        good=2.0,
        ordinary=10.0,
        poor=30.0,
        unit="um per 500 mm in the first hour",
        mark="RECALLED",
        source=(
            "ISO 230-3 is the test; a part that was machined twice by a screw without a scale "
            "differed by 44 um (READ: "
            "prodbyog.com on HEIDENHAIN), but a survey moves less than machining does"
        ),
    ),
    "setup_c": Figure(
        good=0.03,
        ordinary=0.15,
        poor=0.5,
        unit="C, standard deviation of the material from setup to setup",
        mark="RECALLED",
        source="the product's own table of classes",
    ),
    "screw": Figure(
        good=1.0,
        ordinary=1.7,
        poor=3.0,
        unit="um, amplitude of the periodic error of a screw",
        mark="RECALLED",
        source="general knowledge",
    ),
    "periodic_scale": Figure(
        good=0.1,
        ordinary=0.2,
        poor=0.3,
        unit="um, amplitude of the periodic error of a glass scale",
        mark="READ",
        source="at most about 1 % of the signal period, 0.2 um of 20 um (READ: HEIDENHAIN, "
        "Exposed Linear Encoders)",
    ),
    "screw_feedback": Figure(
        good=0.2,
        ordinary=0.7,
        poor=0.9,
        unit="share of machines with ball screw and rotary encoder",
        mark="RECALLED",
        source="general knowledge",
    ),
}
"""The sizes of ordinary machines."""

LARGEST_ANGLE_URAD = 90.0
REPEATABILITY_UM = (0.2, 1.5)
REVERSAL_UM = (0.5, 20.0)
PITCH_MM = 10.0
SCALE_PERIOD_MM = 0.02
FIRST_HOUR_S = 3600.0
SPREAD = 0.35
"""Standard deviation of the logarithm of a size among machines of one quality (CHOSEN)."""
SPREAD_AMONG_AXES = 0.2
"""The same among the axes and functions of one machine (CHOSEN)."""
EXPANSION_UM_M_C = {"screw": 11.7, "scale": 10.0}
"""Expansion of a steel screw, and of a glass or steel-tape scale as fastened to cast iron
(RECALLED)."""
SCALE_GROWTH = 0.3
"""Share of the growth that remains with a scale: the scale measures the screw's own growth
(CHOSEN).
"""


@dataclass(frozen=True, slots=True, kw_only=True)
class OrdinaryMachine:
    """A machine drawn from the table.

    ``repeatability_um`` is the standard deviation of an arrival of each axis, ``setup_c`` the
    standard deviation of the material temperature from setup to setup, ``warm`` whether the shop
    warms the machine up before the survey.
    """

    quality: Quality
    feedback: Feedback
    machine: Machine
    repeatability_um: Three
    setup_c: float
    warm: bool


def draw_machine(
    rng: np.random.Generator, *, large: bool = False, quality: Quality | None = None
) -> OrdinaryMachine:
    """Draw a machine; ``large`` draws axes of 1 to 4 m, ``quality`` states the class instead of
    drawing it."""
    chosen = quality or QUALITIES[int(rng.choice(3, p=SHARES))]
    size_mm = _draw_size(rng, large=large)
    feedback: Feedback = (
        "screw" if rng.random() < FIGURES["screw_feedback"].of(chosen) else "scale"
    )
    warm = bool(rng.random() < 0.5)
    machine = Machine(
        errors=_draw_errors(rng, chosen, feedback, size_mm),
        chain=str(rng.choice(CHAINS)),
        expansion_um_m_c=(EXPANSION_UM_M_C[feedback],) * 3,
        growth=_draw_growth(rng, chosen, feedback, size_mm, warm=warm),
        environment=Environment(material_c=Course(start=float(rng.normal(20.0, 1.5)))),
    )
    low, high = REPEATABILITY_UM
    repeats = np.clip(
        _spread(rng, "repeatability", chosen)
        * np.exp(rng.normal(scale=SPREAD_AMONG_AXES, size=3)),
        low,
        high,
    )
    return OrdinaryMachine(
        quality=chosen,
        feedback=feedback,
        machine=machine,
        repeatability_um=_three(repeats),
        setup_c=FIGURES["setup_c"].of(chosen),
        warm=warm,
    )


def _three(values: np.ndarray) -> Three:
    x, y, z = (float(value) for value in values)
    return x, y, z


def _spread(rng: np.random.Generator, name: str, quality: Quality) -> float:
    """Draw the size of a property of one machine."""
    return FIGURES[name].of(quality) * float(np.exp(rng.normal(scale=SPREAD)))


def _draw_size(rng: np.random.Generator, *, large: bool) -> Three:
    """Draw a volume: mostly in steps of 10 mm, one in five of half a millimetre."""
    low, high = (1000.0, 4000.0) if large else (300.0, 1000.0)
    size = np.exp(rng.uniform(np.log(low), np.log(high), size=3))
    step = 10.0 if rng.random() < 0.8 else 0.5
    return _three(np.round(size / step) * step)


def _draw_errors(
    rng: np.random.Generator, quality: Quality, feedback: Feedback, size_mm: Three
) -> ErrorSet:
    low: Three = (0.0, 0.0, 0.0)
    functions: dict[str, ErrorFunction] = {}
    size = {
        name: _spread(rng, name, quality)
        for name in (
            "positioning",
            "straightness",
            "angle",
            "scale",
            "squareness",
            "reversal",
        )
    }
    for name in (*DISPLACEMENTS, *ROTATIONS):
        functions[name] = _draw_function(rng, name, size, size_mm[AXES.index(name[2])])
    for letter in AXES:
        name = f"E{letter}{letter}"
        functions[name] = _draw_periodic(rng, functions[name], quality, feedback)
    lost = np.clip(
        size["reversal"] * np.exp(rng.normal(scale=SPREAD_AMONG_AXES, size=3)), *REVERSAL_UM
    )
    return ErrorSet(
        low_mm=low,
        size_mm=size_mm,
        functions=functions,
        squareness_urad={
            name: float(rng.normal(scale=size["squareness"])) for name in SQUARENESS
        },
        reversal={
            f"E{letter}{letter}": Table((0.0,), (-float(lost[axis]),))
            for axis, letter in enumerate(AXES)
        },
    )


def _draw_function(
    rng: np.random.Generator, name: str, size: dict[str, float], length_mm: float
) -> Smooth:
    """Draw one of the 18 functions; what is in um grows with the travel, what is in urad does
    not."""
    own = float(np.exp(rng.normal(scale=SPREAD_AMONG_AXES)))
    if name in ROTATIONS:
        range_urad = min(size["angle"] * own, LARGEST_ANGLE_URAD)
        drawn = smooth(rng, 0.0, length_mm, 1.0, float(rng.uniform(-1.0, 1.0)))
        wide = float(np.ptp(drawn(np.linspace(0.0, length_mm, 501))))
        factor = range_urad / wide
        return Smooth(
            0.0,
            length_mm,
            tuple(factor * one for one in drawn.amplitudes),
            factor * drawn.slope_per_mm,
        )
    positioning = name[1] == name[2]
    peak_um = size["positioning" if positioning else "straightness"] * own * length_mm / 500.0
    rise_um = (
        float(rng.normal(scale=size["scale"])) * length_mm * 1e-3 if positioning else 0.0
    )
    return smooth(rng, 0.0, length_mm, peak_um, rise_um)


def _draw_periodic(
    rng: np.random.Generator, base: ErrorFunction, quality: Quality, feedback: Feedback
) -> Waved:
    """Put the periodic error of a screw (once or twice a turn), or of a scale (once a signal
    period), on a positioning function."""
    size_um = float(
        FIGURES["screw" if feedback == "screw" else "periodic_scale"].of(quality)
        * np.exp(rng.normal(scale=SPREAD_AMONG_AXES))
    )
    period_mm = PITCH_MM / int(rng.integers(1, 3)) if feedback == "screw" else SCALE_PERIOD_MM
    return Waved(base, size_um, period_mm, float(rng.uniform(0.0, 2.0 * np.pi)))


def _draw_growth(
    rng: np.random.Generator,
    quality: Quality,
    feedback: Feedback,
    size_mm: Three,
    *,
    warm: bool,
) -> Growth:
    """Draw the growth of the axes; the fixed bearing of each stands 50 to 150 mm beyond an end of
    the travel.
    """
    tau_s = FIRST_HOUR_S * float(np.exp(rng.normal(scale=SPREAD)))
    per_500_mm = _spread(rng, "growth", quality) * (
        SCALE_GROWTH if feedback == "scale" else 1.0
    )
    final = (
        2.0 * per_500_mm / -np.expm1(-FIRST_HOUR_S / tau_s) * rng.uniform(0.3, 1.0, size=3)
    )
    beyond = rng.uniform(50.0, 150.0, size=3)
    bearing = np.where(rng.random(3) < 0.5, -beyond, np.array(size_mm) + beyond)
    begun_s = FIRST_HOUR_S * float(rng.uniform(1.0, 3.0) if warm else rng.uniform(0.0, 0.3))
    return Growth(
        um_m=_three(final), bearing_mm=_three(bearing), tau_s=tau_s, begun_s=begun_s
    )
