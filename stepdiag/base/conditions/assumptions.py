"""The assumed sizes of the errors of machine, laser and hall: section ``[uncertainty]`` of the
survey file."""

from collections.abc import Mapping
from dataclasses import asdict, dataclass, field

import numpy as np

from stepdiag.base.conditions.expansion import REFERENCE_TEMPERATURE_C
from stepdiag.base.result.members import Assumed
from stepdiag.base.volume import Vector

CLASSES: Mapping[str, Mapping[str, float]] = {
    "good": {
        "angles_urad": 5.0,
        "repeatability_um": 0.2,
        "setup_c": 0.03,
        "growth_um_m": 5.0,
        "drift_um": 0.1,
        "wander_um": 0.07,
        "squareness_urad": 10.0,
        "scale_um_m": 5.0,
        "shape_um": 3.0,
    },
    "ordinary": {
        "angles_urad": 15.0,
        "repeatability_um": 0.5,
        "setup_c": 0.15,
        "growth_um_m": 20.0,
        "drift_um": 0.15,
        "wander_um": 0.1,
        "squareness_urad": 30.0,
        "scale_um_m": 20.0,
        "shape_um": 5.0,
    },
    "poor": {
        "angles_urad": 50.0,
        "repeatability_um": 1.5,
        "setup_c": 0.5,
        "growth_um_m": 60.0,
        "drift_um": 1.0,
        "wander_um": 0.5,
        "squareness_urad": 100.0,
        "scale_um_m": 50.0,
        "shape_um": 20.0,
    },
}
"""Usual sizes of a machine's errors by class of machine; the keys are fields of `Assumptions`."""

FEEDBACKS: Mapping[str, Mapping[str, float]] = {
    "screw": {"good": 0.7, "ordinary": 1.5, "poor": 3.0},
    "scale": {"good": 0.1, "ordinary": 0.15, "poor": 0.3},
}
"""Usual size in um of the waves between the targets, by feedback and class of machine. A rotary
encoder on a ball screw has waves of 1 to 3 um, once or twice a pitch. A linear scale has only its
interpolation error."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Assumptions:
    """The assumed sizes of the error sources: standard uncertainties (k = 1), unless the
    description of a field states a range or a largest value. The default values are those of an
    ordinary machine with ball screws; zero switches a source off.

    A size marked * is only the initial value: the solver estimates the size on this machine from
    the closure of the readings. Every other size is used unchanged.

    ``angles_urad`` *: range of each angular function over the travel of its axis; ``angle_urad``
    replaces this range for single functions. ``drift_um`` *: linear drift in a pass without a
    return pass. ``wander_um`` *: irregular drift at the end of a pass. ``repeatability_um`` *:
    scatter of one approach of one axis to a target; the solver expects 0.05 to 3 um. ``setup_c`` *:
    change of the machine's temperature from setup to setup. ``growth_um_m`` *: growth of the axes
    during the survey that no sensor measures.

    ``expansion_um_m_c``: expansion coefficient of the axes' material, ``u_expansion_um_m_c`` its
    standard uncertainty. ``index``: relative error of the refractive index and the laser's
    wavelength, constant over the survey; ``index_setup``: unmeasured change of this error between
    setups. ``alignment_mrad``: largest angle between beam and mirror normal or travel.
    ``between_um``: waves of the positioning functions that are too short for the targets.
    ``reading_um``: noise of a stop for which the log contains no noise.

    ``material_c``: temperature of the axes, ``u_material_c`` its standard uncertainty, which
    applies to lengths at 20 C. If ``reduced_to_20_c``, it applies to the readings.
    ``material_stated``: the survey file contains the temperature. ``shape_um``,
    ``squareness_urad``, ``scale_um_m``: usual sizes of the errors of a machine of this class, used
    for errors that the survey does not measure.
    """

    angles_urad: float = 15.0
    angle_urad: Mapping[str, float] = field(default_factory=dict)
    drift_um: float = 0.15
    wander_um: float = 0.1
    repeatability_um: float = 0.5
    setup_c: float = 0.15
    growth_um_m: float = 20.0
    expansion_um_m_c: tuple[float, float, float] = (11.7, 11.7, 11.7)
    u_expansion_um_m_c: float = 1.0
    index: float = 2e-7
    index_setup: float = 1e-7
    alignment_mrad: float = 0.5
    between_um: float = 1.5
    reading_um: float = 0.3
    material_c: tuple[float, float, float] = (20.0, 20.0, 20.0)
    u_material_c: float = 0.3
    material_stated: bool = False
    reduced_to_20_c: bool = False
    shape_um: float = 5.0
    squareness_urad: float = 30.0
    scale_um_m: float = 20.0

    def u_grown_um_m(self) -> Vector:
        """Return, for each axis, the uncertainty of the difference between its present length and
        its length at 20 C, in um/m, shape (3,)."""
        excess_c = np.array(self.material_c) - REFERENCE_TEMPERATURE_C
        u: Vector = np.hypot(
            np.array(self.expansion_um_m_c) * self.u_material_c,
            excess_c * self.u_expansion_um_m_c,
        )
        return u

    def stated(self) -> Assumed:
        """Return the assumed sizes in the form stored in a result. Relative sizes are in ppm,
        because six decimals round 2e-7 to zero."""
        sizes = asdict(self)
        index, index_setup = (1e6 * sizes.pop(name) for name in ("index", "index_setup"))
        return Assumed(index_ppm=index, index_setup_ppm=index_setup, **sizes)

    def angle_range_urad(self, name: str) -> float:
        """Return the assumed range of an angular function over the travel of its axis in urad."""
        return self.angle_urad.get(name, self.angles_urad)


def usual_sizes(machine: str = "ordinary", feedback: str = "screw") -> dict[str, float]:
    """Return the usual sizes of the errors of a machine by its class and feedback; the keys are
    fields of `Assumptions`."""
    return {**CLASSES[machine], "between_um": FEEDBACKS[feedback][machine]}
