"""The user's assumptions about machine, laser and hall: the ``[uncertainty]`` of the survey
file.
"""

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
"""Usual sizes by class of machine, by their names in `Assumptions`."""

FEEDBACKS: Mapping[str, Mapping[str, float]] = {
    "screw": {"good": 0.7, "ordinary": 1.5, "poor": 3.0},
    "scale": {"good": 0.1, "ordinary": 0.15, "poor": 0.3},
}
"""``between_um`` by position feedback and class. A rotary encoder on a ball screw has waves of 1 to
3 um, once or twice a pitch; a linear scale has the error of its interpolation.
"""


@dataclass(frozen=True, slots=True, kw_only=True)
class Assumptions:
    """Usual sizes (k = 1 unless a range is named) of an ordinary machine with ball screws; zero
    switches a source off. Sizes marked * start the search: the closure of the readings shows their
    size on this machine; otherwise the stated size stands.

    ``angles_urad`` *: range of each angular function over the travel of its axis; ``angle_urad``
    overrides this range for single functions. ``drift_um`` *: linear drift in one pass without
    return; ``wander_um`` *: sum of the further drift by the end of a pass. ``repeatability_um`` *:
    scatter of one approach of one axis to a target; 0.05 to 3 um are likely if the readings show
    it. ``setup_c`` *: change of the machine's temperature from setup to setup. ``growth_um_m`` *:
    growth of the axes from the first to the last reading of the survey that no sensor shows.
    ``expansion_um_m_c``: material of the axes, ``u_expansion_um_m_c`` its standard uncertainty.
    ``index``: relative, of the air's index and the laser's wavelength, a single error for the whole
    survey; ``index_setup`` its unseen change between setups. ``alignment_mrad``: largest angle of a
    beam to mirror or travel. ``between_um``: waves of the positioning functions too short for the
    targets. ``reading_um`` is used for a stop without its own noise. ``material_c``: temperature of
    the axes, ``u_material_c`` its standard uncertainty, part of the uncertainty of lengths at 20 C,
    thus of the readings if ``reduced_to_20_c``; ``material_stated`` if the user states it.
    ``shape_um``, ``squareness_urad``, ``scale_um_m``: usual sizes of a machine of its class without
    a measurement.
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
        """Return the uncertainty of each axis' difference from its length at 20 C, in um/m, shape
        (3,).
        """
        excess_c = np.array(self.material_c) - REFERENCE_TEMPERATURE_C
        u: Vector = np.hypot(
            np.array(self.expansion_um_m_c) * self.u_material_c,
            excess_c * self.u_expansion_um_m_c,
        )
        return u

    def stated(self) -> Assumed:
        """Return the sizes as a result states them; relative ones in ppm, since 2e-7 would be zero
        in the six decimals of a result.
        """
        sizes = asdict(self)
        index, index_setup = (1e6 * sizes.pop(name) for name in ("index", "index_setup"))
        return Assumed(index_ppm=index, index_setup_ppm=index_setup, **sizes)

    def angle_range_urad(self, name: str) -> float:
        """Return the range assumed for an angular function."""
        return self.angle_urad.get(name, self.angles_urad)


def usual_sizes(machine: str = "ordinary", feedback: str = "screw") -> dict[str, float]:
    """Return the usual sizes of a class of machine with a position feedback, by their names in
    `Assumptions`."""
    return {**CLASSES[machine], "between_um": FEEDBACKS[feedback][machine]}
