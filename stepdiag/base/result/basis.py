"""The basis of a result's U and tables: the assumptions, the lengths, and the point of the tool."""

from collections.abc import Mapping
from dataclasses import dataclass

from stepdiag.base.result.interval import with_expanded
from stepdiag.base.result.members import Assumed, Lengths, LengthsReport
from stepdiag.base.result.result import Result
from stepdiag.base.result.typed import written

ASSUMED = (
    "angles_urad",
    "drift_um",
    "wander_um",
    "repeatability_um",
    "setup_c",
    "growth_um_m",
    "index_ppm",
    "alignment_mrad",
    "between_um",
    "u_material_c",
    "u_expansion_um_m_c",
    "shape_um",
    "squareness_urad",
    "scale_um_m",
)
"""Names of the assumed sizes that a person reads, as in `members.Assumed`."""

Scales = tuple[tuple[str, float, float], ...]
"""The known scales: axis, value in um/m and expanded uncertainty (k = 2)."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Basis:
    """The basis of a result's U and tables. ``assumed`` contains the assumed sizes by name.
    ``tables`` is the kind of lengths that the tables correct (as measured, or at 20 C), None if the
    result does not contain it.

    ``material_c`` is the mean temperature of the axes. ``scales`` are the scales of the lengths
    that the tables correct, ``other`` the scales of the other lengths. ``air`` contains the assumed
    conditions of the air that no sensor measured. ``tool_um`` is the effect of angles on a tool tip
    100 mm from the point of the beam on the mirror.
    """

    assumed: Mapping[str, float]
    tables: Lengths | None
    material_c: float | None
    scales: Scales
    other: Scales
    tool_um: float | None
    air: Mapping[str, float]

    @property
    def beside(self) -> Lengths:
        """Return the kind of lengths that no table corrects: as measured, or at 20 C."""
        return "at_20_c" if self.tables == "as_measured" else "as_measured"


def basis_of(result: Result) -> Basis:
    """Return the basis of a result, with None and empty values for missing facts."""
    lengths, conditions = result.lengths, result.conditions
    warm = None if lengths is None else lengths.material_c
    return Basis(
        assumed={} if result.assumed is None else sizes_of(result.assumed),
        tables=None if lengths is None else lengths.tables,
        material_c=None if warm is None else sum(warm) / len(warm),
        scales=() if lengths is None else _scales(lengths, tables=True),
        other=() if lengths is None else _scales(lengths, tables=False),
        tool_um=None if result.tool is None else result.tool.up_to_um_per_100_mm,
        air={}
        if conditions is None or conditions.assumed is None
        else written(conditions.assumed),
    )


def sizes_of(assumed: Assumed) -> dict[str, float]:
    """Return the assumed sizes in a result by their names in `ASSUMED`."""
    return {name: size for name in ASSUMED if (size := getattr(assumed, name)) is not None}


def _scales(lengths: LengthsReport, *, tables: bool) -> Scales:
    entries = (
        lengths.at_20_c if (lengths.tables == "at_20_c") is tables else lengths.as_measured
    )
    return tuple(
        (axis, one.value, 2.0 * one.u)
        for axis, one in (entries or {}).items()
        if one.value is not None and one.u is not None
    )


def scales_in_words(scales: Scales) -> str:
    """Return scales as a text: ``X +3.2 ± 1.1, Y -0.4 ± 1.2 um/m``."""
    return ", ".join(
        f"{axis} {with_expanded(value, expanded, sign='+')}"
        for axis, value, expanded in scales
    )
