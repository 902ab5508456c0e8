"""On what a result's U and tables rest, as it stands in the result: what was taken for granted, which lengths, which point of the tool."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Literal

from stepdiag.solver.result.result import AXIS_LETTERS, Result

ASSUMED = (
    "angles_urad", "drift_um", "wander_um", "repeatability_um", "setup_c", "growth_um_m", "index_ppm", "alignment_mrad", "between_um",
    "u_material_c", "u_expansion_um_m_c", "shape_um", "squareness_urad", "scale_um_m",
)  # fmt: skip
"""The sizes that a person meets, by their names in `Assumptions.as_json`."""

Lengths = Literal["as_measured", "at_20_c"]
Scales = tuple[tuple[str, float, float], ...]
"""Axis, value in um/m and expanded uncertainty (k = 2) of every scale that is known."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Basis:
    """``assumed`` holds the sizes by name, ``tables`` which lengths the tables correct, None where the result does not say.

    ``material_c`` is how warm the machine was, ``scales`` are those that the tables correct, ``other`` those at the other temperature.
    ``air`` holds the conditions of the air that nobody told and that were assumed, by name. ``tool_um`` is what angles may make of a tool
    tip 100 mm from where the beam met the mirror.
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
        """Return the lengths that no table corrects."""
        return "at_20_c" if self.tables == "as_measured" else "as_measured"


def basis_of(result: Result) -> Basis:
    """Return what a result says of its basis; whatever is missing, or is not as this program writes it, counts as not said."""
    lengths, tool = _part(result, "lengths"), _part(result, "tool")
    assumed = {name: value for name, raw in _part(result, "assumed").items() if name in ASSUMED and (value := _number(raw)) is not None}
    tables: Lengths | None = {"as_measured": "as_measured", "at_20_c": "at_20_c"}.get(  # type: ignore[assignment]
        str(lengths.get("tables"))
    )
    other = {"as_measured": "at_20_c", "at_20_c": "as_measured"}.get(str(tables), "")
    warm = lengths.get("material_c")
    temperatures = [value for one in warm if (value := _number(one)) is not None] if isinstance(warm, list) else []
    return Basis(
        assumed=assumed,
        tables=tables,
        material_c=sum(temperatures) / len(temperatures) if temperatures else None,
        scales=_scales(lengths.get(str(tables))),
        other=_scales(lengths.get(other)),
        tool_um=_number(tool.get("up_to_um_per_100_mm")),
        air={name: value for name, raw in _assumed_air(result).items() if (value := _number(raw)) is not None},
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class UnseenSlip:
    """A slip of the count as a result tells of it: sizes that are noticed in half of the surveys and in 95 % of them, and what the first
    makes of the volume (rms), in um; None where one of any size goes unnoticed.

    ``passes``: where a slip that is noticed in half of the surveys makes the volume worse by more than the noise of the readings allows
    for, ``readings_um`` (k = 1).
    """

    setup: str
    pass_number: int
    stop: int
    half_um: float | None
    nearly_um: float | None
    volume_um: float | None
    readings_um: float | None = None
    passes: tuple[str, ...] = ()

    @property
    def place(self) -> str:
        """Return where, as a person writes it: ``ppp/1/5`` is the way to stop 5 of pass 1 of ppp."""
        return f"{self.setup}/{self.pass_number}/{self.stop}"


def unseen_slips(result: Result) -> tuple[UnseenSlip, ...]:
    """Return what a result says of slips in diagonals and in runs along an axis; what is not as this program writes it is left out."""
    found = _part(result, "unseen_slip")
    return tuple(
        UnseenSlip(
            setup=setup,
            pass_number=number,
            stop=stop,
            half_um=_number(entry.get("half_um")),
            nearly_um=_number(entry.get("nearly_um")),
            volume_um=_number(entry.get("volume_um")),
            readings_um=_number(entry.get("readings_um")),
            passes=_names(entry.get("passes")),
        )
        for entry in (found.get(name) for name in ("diagonals", "runs"))
        if isinstance(entry, dict)
        and isinstance(setup := entry.get("setup"), str)
        and isinstance(number := entry.get("pass"), int)
        and isinstance(stop := entry.get("stop"), int)
    )


def _part(result: Result, name: str) -> Mapping[str, Any]:
    found = result.extra.get(name)
    return found if isinstance(found, dict) else {}


def _names(found: object) -> tuple[str, ...]:
    return tuple(name for name in found if isinstance(name, str)) if isinstance(found, list) else ()


def _assumed_air(result: Result) -> Mapping[str, Any]:
    found = _part(result, "conditions").get("assumed")
    return found if isinstance(found, dict) else {}


def _number(value: object) -> float | None:
    return float(value) if isinstance(value, int | float) and not isinstance(value, bool) else None


def _scales(found: object) -> Scales:
    entries = found if isinstance(found, dict) else {}
    known = []
    for axis in AXIS_LETTERS:
        entry = entries.get(axis)
        value, u = (_number(entry.get(name)) for name in ("value", "u")) if isinstance(entry, dict) else (None, None)
        if value is not None and u is not None:
            known.append((axis, value, 2.0 * u))
    return tuple(known)


def scales_in_words(scales: Scales) -> str:
    """Return scales as a person reads them: ``X +3.2 ± 1.1, Y -0.4 ± 1.2 um/m``."""
    return ", ".join(f"{axis} {value:+.1f} ± {expanded:.1f}" for axis, value, expanded in scales)
