"""The measurement uncertainty of positioning values, from the sources of ISO/TR 230-9.

The report is not public: theory.md 8.7 derives the effect of each source on each value, and every
result states this. Errors proportional to length (laser, alignment, temperature) are equal in all
runs: they are part of E, M and A and cancel in B and R. Errors that change from run to run
(environment, noise) are averaged over the runs in E, M and B. The uncertainty of R and A also
contains that of standard deviations computed from few runs.
"""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from stepdiag.base.conformity import COVERAGE

SOURCE_STATUS = "sources of ISO/TR 230-9, combined by derivation; k = 2"


@dataclass(frozen=True, slots=True, kw_only=True)
class RunSources:
    """Standard uncertainties in the runs of a setup: ``relative`` for every length (wavelength,
    air, expansion, cosine), ``reading_um`` for one reading, ``environment_um`` for the drift
    within a run."""

    relative: float
    reading_um: float
    environment_um: float


def expanded_um(
    figures: Mapping[str, float],
    length_mm: float,
    runs: tuple[int, int],
    targets: int,
    sources: RunSources,
) -> dict[str, float]:
    """Return U (k = 2) in um of each value of ``solver.iso230.PositioningFigures.numbers`` over a
    length.

    ``runs`` are the numbers of upward and downward runs. B is the largest of the reversal values at
    ``targets`` targets: noise increases it by up to sqrt(2 ln targets) standard uncertainties of
    one value (a bound of the expected maximum of normal variables), which is treated as the limit
    of a rectangular distribution.
    """
    stretch = sources.relative * length_mm * 1e3
    single = float(np.hypot(sources.reading_um, sources.environment_um))
    mean = single / np.sqrt(min(runs))
    # the relative uncertainty of a scatter from n runs is 1 / sqrt(2 (n - 1))
    scatter = {
        name: figures[name] / np.sqrt(2.0 * (number - 1))
        for name, number in zip(("R_up", "R_down"), runs, strict=True)
        if name in figures
    }
    of_range = float(np.hypot(stretch, np.sqrt(2.0) * mean))
    u = dict.fromkeys(("E_up", "E_down", "E"), of_range)
    u["M"] = float(np.hypot(stretch, mean))
    u["B"] = np.sqrt(2.0) * mean * np.sqrt(1.0 + 2.0 * np.log(targets) / 3.0)
    u["B_mean"] = np.sqrt(2.0) * mean
    u |= scatter
    if len(scatter) == 2:
        # R = 2 s_up + 2 s_down + |B| is R_up / 2 + R_down / 2 + |B|, because R_up = 4 s_up
        u["R"] = float(np.hypot(np.hypot(scatter["R_up"], scatter["R_down"]) / 2.0, u["B"]))
    widened = {"A_up": "R_up", "A_down": "R_down", "A": "R"}
    u |= {
        name: float(np.hypot(of_range, u[by]))
        for name, by in widened.items()
        if name in figures and by in u
    }
    return {name: COVERAGE * float(u[name]) for name in figures if name in u}
