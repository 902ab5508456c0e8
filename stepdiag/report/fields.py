"""The error field of the volume as plain numbers, for those who draw it elsewhere."""

from typing import Any

from stepdiag.report import space
from stepdiag.report.figures import Correction, field_statistics, volumetric_errors
from stepdiag.solver.result.result import Result


def field_of(result: Result, correction: Correction | None) -> dict[str, Any]:
    """Return lattice points in mm and the error there in um before and (None without correction) after, rigid motion removed.

    ``longest_um`` is the length of the longest vector: what both drawings are scaled by.
    """
    fields = volumetric_errors(result, correction, space.LATTICE)
    after = fields[1].tolist() if len(fields) > 1 else None
    longest = max(field_statistics(field)[1] for field in fields)
    return {
        "points_mm": space.lattice_mm(result.volume).tolist(),
        "before_um": fields[0].tolist(),
        "after_um": after,
        "longest_um": longest,
    }
