"""The result of a survey and its JSON form (contract 4)."""

import json
import re
from collections.abc import Mapping
from dataclasses import dataclass, field, fields, replace
from pathlib import Path
from typing import Any

import numpy as np

from stepdiag.base.errors import UsageError
from stepdiag.base.files import read_text
from stepdiag.base.findings import Finding
from stepdiag.base.kinematics import abbe_mask
from stepdiag.base.messages import message
from stepdiag.base.names import AXES
from stepdiag.base.result.finding import parse_finding
from stepdiag.base.result.interval import Predicted
from stepdiag.base.result.json_tree import Node, load_json
from stepdiag.base.result.members import (
    Assumed,
    Backlashes,
    Budget,
    Closure,
    Conditions,
    Conformity,
    CoverageFactor,
    Facts,
    Fit,
    HeadStraightness,
    Length,
    LengthsReport,
    MonteCarlo,
    SetupReport,
    Software,
    Source,
    StandardFigures,
    Tool,
    UnseenSlips,
    software,
)
from stepdiag.base.result.posterior import POSTERIOR_DECIMALS, Posterior, parse_posterior
from stepdiag.base.result.rounding import same_but_for_rounding, steady
from stepdiag.base.result.typed import read, read_or_none, written
from stepdiag.base.volume import MOST_INCREMENTS, POSITION_TOLERANCE_MM, Vector, Volume

FORMAT = "stepdiag-result"
FORMAT_VERSION = 3
READABLE_VERSIONS = (1, 2, 3)
"""Versions of the result's format that can be read. In version 1 ``u`` contains only the
contribution of the readings, and there is no posterior. In versions 1 and 2 unknown or damaged
members are ignored; in version 3 they are refused."""

DISPLACEMENTS = tuple(f"E{component}{axis}" for axis in "XYZ" for component in "XYZ")
ROTATIONS = tuple(f"E{component}{axis}" for axis in "XYZ" for component in "ABC")
POSITIONING = ("EXX", "EYY", "EZZ")
SQUARENESS = ("C0Y", "B0Z", "A0Z")
AXIS_LETTERS = tuple(axis.upper() for axis in AXES)
_MOST_PASSES = 1000
"""Largest number of passes of a setup in a result of the closed forms, which contains no list of
the passes."""
_NUMBERS = re.compile(r"\[\n\s+-?\d[-+.,\dEe\s]*\]")
_NUMBER = ("value", "u", "u_readings")
DECIMALS = 6
"""Number of decimals of values in the result's file: 1 pm, 1 prad, 1 nm of position."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Function:
    """An error as a function of the position of the moving axis, shapes (k,), linear between the
    positions.

    ``value`` and ``u`` (combined standard uncertainty) are None if the data do not identify the
    function. ``u_readings`` is the contribution of the readings to u, None in results of version 1.
    If ``slope_identified`` is False, only the shape of the function is known and its end-point line
    is removed. A straightness (names as EYX) always has its end-point line removed and
    ``slope_identified`` True, because its slope is the squareness.
    """

    position_mm: Vector
    value: Vector | None
    u: Vector | None
    unit: str
    slope_identified: bool = True
    u_readings: Vector | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class Quantity:
    """A squareness or a scale with its combined standard uncertainty; both are None if the data do
    not identify it. ``u_readings`` as in `Function`."""

    value: float | None
    u: float | None
    unit: str = "urad"
    u_readings: float | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class Scale:
    """Slope of the end-point line of a positioning function in um/m; ``value`` and ``u`` are None
    unless ``identified``."""

    value: float | None
    u: float | None
    identified: bool
    unit: str = "um/m"
    u_readings: float | None = None


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Result:
    """The measured state of a machine.

    ``errors`` contains the mean of both directions by ISO 230-1 name (EXX .. EZZ in um; EAX .. ECZ
    in urad where known). ``expected`` contains the likely values of the unmeasured angular
    functions, from the closure of the readings. The displacement functions are estimated with these
    values. ``posterior`` contains the possible differences between machine and result. ``reversal``
    contains the difference approach in + minus approach in - of the functions in ``errors``, zero
    at the first position, if out-and-back data exist. ``setups`` contains mirror tilt, drift and
    repeatability of each setup. The members from ``survey`` on are optional, and None if missing.
    ``source`` is the name of the result in messages and is not written.
    """

    volume: Volume
    chain: str
    method: str
    errors: dict[str, Function]
    squareness: dict[str, Quantity]
    scale: dict[str, Scale]
    setups: dict[str, SetupReport]
    findings: tuple[Finding, ...]
    reversal: dict[str, Function] = field(default_factory=dict)
    expected: dict[str, Function] = field(default_factory=dict)
    posterior: Posterior | None = None
    software: Software = field(default_factory=software)
    survey: Facts | None = None
    conditions: Conditions | None = None
    history: tuple[Finding, ...] | None = None
    """Findings about past events of the recording that have no effect now."""
    volumetric_u_um: float | None = None
    """Root mean square over the volume of the standard uncertainty of the error vector."""
    predicted: Predicted | None = None
    """Predicted error of the volume before and after an ideal compensation."""
    fit: Fit | None = None
    scale_sum_um: Length | None = None
    scale_misclosure_um: Length | None = None
    """Length of a body diagonal by the diagonals minus its length by the linear runs, in um."""
    backlash: Backlashes | None = None
    unseen_slip: UnseenSlips | None = None
    closure_um: Closure | None = None
    assumed: Assumed | None = None
    lengths: LengthsReport | None = None
    tool: Tool | None = None
    head_straightness: dict[str, HeadStraightness] | None = None
    budget: Budget | None = None
    coverage: dict[str, CoverageFactor] | None = None
    """Coverage factors for 95 % by function or number, for factors that differ from about 2."""
    standards: dict[str, tuple[StandardFigures, ...]] | None = None
    monte_carlo: MonteCarlo | None = None
    sources: tuple[Source, ...] | None = None
    tolerance: dict[str, float] | None = None
    """Largest permitted magnitudes by quantity (`base.conformity`)."""
    conformity: Conformity | None = None
    source: str = "result"

    def knows(self, name: str) -> bool:
        """Return whether the survey identifies a function or a squareness with this ISO 230-1
        name."""
        found = self.errors.get(name) or self.squareness.get(name)
        return found is not None and found.value is not None

    def at(self, x_mm: float, y_mm: float, z_mm: float) -> tuple[Vector, Vector | None]:
        """Return the error vector at a point of the machine and its expanded uncertainty U (k = 2),
        shapes (3,) in um.

        The error is relative to the low corner of the volume (`base.result.prediction.errors_at`).
        U is None for a result without a posterior. Raises UsageError for a point outside the
        measured volume.
        """
        from stepdiag.base.result.prediction import errors_at

        point = np.array([[x_mm, y_mm, z_mm]], dtype=np.float64)
        low = np.asarray(self.volume.origin_mm)
        high = low + np.asarray(self.volume.size_mm)
        if not (
            (point >= low - POSITION_TOLERANCE_MM) & (point <= high + POSITION_TOLERANCE_MM)
        ).all():
            volume = f"{low.tolist()} to {high.tolist()}"
            raise UsageError(
                "at",
                expected=message("targets-within-mm", volume=volume),
                found=str(point[0].tolist()),
            )
        found_at = errors_at(self, point)
        return found_at.error_um[0], None if found_at.u_um is None else 2.0 * found_at.u_um[0]

    def _repr_html_(self) -> str:
        numbers = [
            (name, one.value, one.u, one.unit)
            for part in (self.squareness, self.scale)
            for name, one in part.items()
        ]
        cells = [
            (
                name,
                "" if v is None else f"{v:.2f}",
                "" if u is None else f"± {2 * u:.2f}",
                unit.replace("u", "µ", 1),
            )
            for name, v, u, unit in numbers
        ]
        for when, figures in (
            () if self.predicted is None else self.predicted.without_rigid_motion.items()
        ):
            cells.append(
                (
                    f"volumetric rms, {when}",
                    figures.rms_um.best(),
                    " to ".join(figures.rms_um.shown()),
                    "µm",
                )
            )
        body = "".join(
            "<tr>" + "".join(f"<td>{cell}</td>" for cell in row) + "</tr>" for row in cells
        )
        head = "<tr><th></th><th>value</th><th>U (k = 2)</th><th>unit</th></tr>"
        return f"<table>{head}{body}</table>"

    def to_json(self) -> str:
        """Return the JSON of contract 4, rounded to `DECIMALS`. The same result gives the same
        bytes."""
        document = {
            "format": FORMAT,
            "version": FORMAT_VERSION,
            "software": written(self.software),
            "method": self.method,
            "volume": _volume_json(self.volume),
            "chain": self.chain,
            "errors": {
                name: _function_json(function) for name, function in self.errors.items()
            },
            "expected": {
                name: _function_json(function) for name, function in self.expected.items()
            },
            "reversal": {
                name: _function_json(function) for name, function in self.reversal.items()
            },
            "squareness": {name: _number_json(q) for name, q in self.squareness.items()},
            "scale": {
                name: {**_number_json(s), "identified": s.identified}
                for name, s in self.scale.items()
            },
            "setups": written(self.setups),
            "findings": written(self.findings),
            **{
                name: written(value)
                for name in MEMBERS
                if (value := getattr(self, name)) is not None
            },
            **({} if self.posterior is None else {"posterior": self.posterior.as_json()}),
        }
        text = json.dumps(_rounded(document), indent=2, ensure_ascii=False, allow_nan=False)
        return (
            _NUMBERS.sub(lambda found: "[" + " ".join(found[0][1:-1].split()) + "]", text)
            + "\n"
        )


_FIELDS = fields(Result)
MEMBERS = {
    each.name: each.type
    for each in _FIELDS[[each.name for each in _FIELDS].index("survey") : -1]
}
"""The optional members of a result and their types."""
_ENTRIES = (
    "format",
    "version",
    "software",
    "method",
    "volume",
    "chain",
    "errors",
    "expected",
    "reversal",
    "squareness",
    "scale",
    "setups",
    "findings",
    "posterior",
)
"""Names of the members that every result contains."""


def same_result(one: bytes, other: bytes) -> bool:
    """Return whether two ``result.json`` are equal within the 0.1 nm by which two processors can
    differ."""
    try:
        first, second = json.loads(one), json.loads(other)
        shape, other_shape = first.pop("posterior", None), second.pop("posterior", None)
    except (ValueError, AttributeError, TypeError, RecursionError):
        return False
    return same_but_for_rounding(first, second, DECIMALS) and same_but_for_rounding(
        shape, other_shape, POSTERIOR_DECIMALS
    )


def _volume_json(volume: Volume) -> dict[str, Any]:
    return {
        "origin_mm": list(volume.origin_mm),
        "size_mm": list(volume.size_mm),
        "increments": volume.increments,
    }


def _number_json(number: Quantity | Scale) -> dict[str, Any]:
    return {
        "value": number.value,
        "u": number.u,
        "u_readings": number.u_readings,
        "unit": number.unit,
    }


def _function_json(function: Function) -> dict[str, Any]:
    return {
        "position_mm": function.position_mm,
        "value": function.value,
        "u": function.u,
        "u_readings": function.u_readings,
        "unit": function.unit,
        "slope_identified": function.slope_identified,
    }


def _rounded(value: Any) -> Any:
    if type(value) is float:  # nearly all values are floats
        return steady(value, DECIMALS)
    if isinstance(value, Mapping):
        return {str(key): _rounded(item) for key, item in value.items()}
    if isinstance(value, np.ndarray):
        return _rounded(value.tolist())
    if isinstance(value, list | tuple):
        return [_rounded(item) for item in value]
    if isinstance(value, np.generic):
        return _rounded(value.item())
    if isinstance(value, float):
        return steady(value, DECIMALS)
    return value


def result_in(path: Path, source: str = "") -> Result:
    """Return the result in a file. ``source`` is the name of the result in messages, by default the
    file name.

    Raises UsageError or DataError for a file that is missing, altered or not a result.
    """
    return parse_result(read_text(path), source or path.name)


def parse_result(text: str, source: str = "result.json") -> Result:
    """Return the result written by ``Result.to_json``.

    Raises ``DataError`` with the wrong field for a result of another format or version. In versions
    1 and 2, unknown or damaged members are ignored.
    """
    root = load_json(text, source)
    root.equals("format", FORMAT)
    version = root.child("version")
    if type(version.value) is not int or version.value not in READABLE_VERSIONS:
        version.refuse("1, 2 or 3")
    root = (
        replace(root, strict=True)
        if version.value == FORMAT_VERSION
        else replace(root, value=_as_now(root.mapping()))
    )
    root.only([*_ENTRIES, *MEMBERS])
    here = root.mapping()
    return Result(
        volume=_volume(root.child("volume")),
        chain=_chain(root),
        method=root.text("method") if "method" in here else "",
        errors=_functions(
            root.child("errors"), (*DISPLACEMENTS, *ROTATIONS), required=DISPLACEMENTS
        ),
        reversal=_functions(root.child("reversal"), (*DISPLACEMENTS, *ROTATIONS))
        if "reversal" in here
        else {},
        expected=_functions(root.child("expected"), ROTATIONS) if "expected" in here else {},
        posterior=parse_posterior(root.child("posterior")) if "posterior" in here else None,
        squareness={
            name: _quantity(_named(root, "squareness", SQUARENESS).child(name))
            for name in SQUARENESS
        },
        scale={
            name: _scale(_named(root, "scale", AXIS_LETTERS).child(name))
            for name in AXIS_LETTERS
        },
        setups=read(root.child("setups"), dict[str, SetupReport]),
        findings=tuple(parse_finding(item) for item in root.child("findings").items()),
        software=read(root.child("software"), Software) if "software" in here else Software(),
        source=source,
        **{
            name: read_or_none(root.child(name), kind)
            for name, kind in MEMBERS.items()
            if name in here
        },
    )


def _as_now(document: dict[str, Any]) -> dict[str, Any]:
    """Return a document of version 1 or 2 in the form of version 3. Results of the closed forms
    contain numbers of passes, and a sum of scales without u."""
    setups, total = document.get("setups"), document.get("scale_sum_um")
    if isinstance(setups, dict):
        setups = {name: _with_passes(report) for name, report in setups.items()}
    changed = {
        "setups": setups,
        "scale_sum_um": {"value": total, "u": None} if isinstance(total, float) else total,
    }
    return {name: changed.get(name, value) for name, value in document.items()}


def _with_passes(report: Any) -> Any:
    count = report.get("passes") if isinstance(report, dict) else None
    return (
        {**report, "passes": list(range(1, count + 1))}
        if type(count) is int and count <= _MOST_PASSES
        else report
    )


def _named(root: Node, name: str, known: tuple[str, ...]) -> Node:
    part = root.child(name)
    part.only(known)
    return part


def _volume(node: Node) -> Volume:
    node.only(("origin_mm", "size_mm", "increments"))
    origin, size = node.child("origin_mm"), node.child("size_mm")
    increments = node.child("increments")
    if len(origin.numbers()) != 3:
        origin.refuse(message("three-numbers"))
    if len(size.numbers()) != 3 or min(size.numbers()) < 0 or max(size.numbers()) == 0:
        size.refuse(message("three-sizes"))
    if type(increments.value) is not int or not 1 <= increments.value <= MOST_INCREMENTS:
        increments.refuse(message("whole-number-from-one", most=MOST_INCREMENTS))
    x, y, z = origin.numbers().tolist()
    a, b, c = size.numbers().tolist()
    return Volume(origin_mm=(x, y, z), size_mm=(a, b, c), increments=increments.value)


def _chain(root: Node) -> str:
    chain = root.text("chain")
    try:
        abbe_mask(chain)
    except UsageError as error:
        root.child("chain").refuse(error.expected)
    return chain


def _functions(
    node: Node, known: tuple[str, ...], required: tuple[str, ...] = ()
) -> dict[str, Function]:
    for name in node.mapping():
        if name not in known:
            node.child(name).refuse(message("function-named", names=list(known)))
    for name in required:
        node.child(name)
    return {
        name: _function(node.child(name), "um" if name in DISPLACEMENTS else "urad")
        for name in node.mapping()
    }


def _function(node: Node, unit: str) -> Function:
    node.equals("unit", unit)
    node.only(("position_mm", *_NUMBER, "unit", "slope_identified"))
    position = node.child("position_mm").numbers()
    # an axis that did not travel stands at a single position, and has no values
    least = 2 if node.child("value").value is not None else 1
    if len(position) < least or np.any(np.diff(position) <= 0):
        node.child("position_mm").refuse(message("two-ascending"))
    known: dict[str, Vector | None] = {}
    for name in _NUMBER:
        column = (
            node.child(name)
            if node.strict or name in node.mapping() or name != "u_readings"
            else None
        )
        known[name] = None if column is None or column.value is None else column.numbers()
        if (
            column is not None
            and column.value is not None
            and len(column.value) != len(position)
        ):
            column.refuse(f"{len(position)} numbers, one a position")
    slope = (
        node.child("slope_identified").truth()
        if node.strict or "slope_identified" in node.mapping()
        else True
    )
    return Function(
        position_mm=position,
        value=known["value"],
        u=known["u"],
        unit=unit,
        slope_identified=slope,
        u_readings=known["u_readings"],
    )


def _optional(node: Node) -> float | None:
    return None if node.value is None else node.number()


def _readings_u(node: Node) -> float | None:
    return (
        _optional(node.child("u_readings"))
        if node.strict or "u_readings" in node.mapping()
        else None
    )


def _quantity(node: Node) -> Quantity:
    node.equals("unit", "urad")
    node.only((*_NUMBER, "unit"))
    return Quantity(
        value=_optional(node.child("value")),
        u=_optional(node.child("u")),
        u_readings=_readings_u(node),
    )


def _scale(node: Node) -> Scale:
    node.equals("unit", "um/m")
    node.only((*_NUMBER, "unit", "identified"))
    identified = node.child("identified").truth()
    value = _optional(node.child("value"))
    if identified != (value is not None):
        node.refuse(message("value-where-identified"))
    return Scale(
        value=value,
        u=_optional(node.child("u")),
        identified=identified,
        u_readings=_readings_u(node),
    )
