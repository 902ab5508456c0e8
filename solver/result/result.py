"""The result of a survey and its JSON form (contract 4)."""

import json
import re
from collections.abc import Mapping
from dataclasses import dataclass, field
from importlib.metadata import version
from typing import Any

import numpy as np

from stepdiag.base.errors import UsageError
from stepdiag.base.findings import Finding
from stepdiag.base.kinematics import abbe_mask
from stepdiag.base.messages import message, message_of
from stepdiag.base.volume import AXES, MOST_INCREMENTS, Vector, Volume
from stepdiag.solver.result.json_tree import Node, load_json
from stepdiag.solver.result.posterior import POSTERIOR_DECIMALS, Posterior, parse_posterior
from stepdiag.solver.result.rounding import same_but_for_rounding, steady

FORMAT = "stepdiag-result"
FORMAT_VERSION = 2
READABLE_VERSIONS = (1, 2)
"""Version 1 states in ``u`` what the readings alone say, and nothing of how the errors go together."""

DISPLACEMENTS = tuple(f"E{component}{axis}" for axis in "XYZ" for component in "XYZ")
ROTATIONS = tuple(f"E{component}{axis}" for axis in "XYZ" for component in "ABC")
POSITIONING = ("EXX", "EYY", "EZZ")
SQUARENESS = ("C0Y", "B0Z", "A0Z")
AXIS_LETTERS = tuple(axis.upper() for axis in AXES)
_ENTRIES = (
    "format", "version", "software", "method", "volume", "chain",
    "errors", "expected", "reversal", "squareness", "scale", "setups", "findings", "posterior",
)  # fmt: skip
_NUMBERS = re.compile(r"\[\n\s+-?\d[-+.,\dEe\s]*\]")
"""A list of numbers: it stands in one line."""
DECIMALS = 6
"""Numbers are written to this many decimals: a picometre, a picoradian, a nanometre of position."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Function:
    """An error as a function of the position of the axis that moves, shapes (k,), linear between the positions.

    ``value`` and ``u`` (combined standard uncertainty) are None where the data do not identify the function; ``u_readings`` is the part
    of u that comes from the readings alone, None in results of version 1. ``slope_identified`` is False
    where only the shape is known: then the line through the end points is removed, which is not a statement about the slope.
    Straightness (unit um, names as EYX) always has its end-point line removed and says True: its slope is in the squareness.
    """

    position_mm: Vector
    value: Vector | None
    u: Vector | None
    unit: str
    slope_identified: bool = True
    u_readings: Vector | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class Quantity:
    """A number with its combined standard uncertainty; both None where the data do not identify it. ``u_readings`` as in `Function`."""

    value: float | None
    u: float | None
    unit: str = "urad"
    u_readings: float | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class Scale:
    """The slope of a positioning function's end-point line in um/m; ``value`` and ``u`` are None unless ``identified``."""

    value: float | None
    u: float | None
    identified: bool
    unit: str = "um/m"
    u_readings: float | None = None


def software() -> dict[str, str]:
    """Return the name and version that results carry."""
    return {"name": "stepdiag", "version": version("stepdiag")}


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Result:
    """What a survey says about a machine.

    ``errors`` holds the mean of both directions by ISO 230-1 name (EXX .. EZZ in um; EAX .. ECZ in urad where known), ``expected`` the
    angular functions that were not measured, as the closure of the readings makes them likely: no measurement, but they belong
    to the displacement functions that were found beside them. ``posterior`` says how the machine may differ from all this. ``reversal`` the
    difference approach in + minus approach in - of the same functions, zero at the first position, where out-and-back data give it.
    ``setups`` says for each setup how it stood (mirror tilt, drift, repeatability). ``extra`` holds further top-level entries
    of the JSON (closure, fit, budget): plain numbers, strings, lists and dicts. ``source`` names the result in messages and is not written.
    """

    volume: Volume
    chain: str
    method: str
    errors: dict[str, Function]
    squareness: dict[str, Quantity]
    scale: dict[str, Scale]
    setups: dict[str, Any]
    findings: tuple[Finding, ...]
    reversal: dict[str, Function] = field(default_factory=dict)
    expected: dict[str, Function] = field(default_factory=dict)
    posterior: Posterior | None = None
    software: dict[str, str] = field(default_factory=software)
    extra: dict[str, Any] = field(default_factory=dict)
    source: str = "result"

    def to_json(self) -> str:
        """Return the JSON of contract 4: fixed key order, two-space indent, LF, rounded to `DECIMALS`; same bytes for the same result."""
        document = {
            "format": FORMAT,
            "version": FORMAT_VERSION,
            "software": self.software,
            "method": self.method,
            "volume": _volume_json(self.volume),
            "chain": self.chain,
            "errors": {name: _function_json(function) for name, function in self.errors.items()},
            "expected": {name: _function_json(function) for name, function in self.expected.items()},
            "reversal": {name: _function_json(function) for name, function in self.reversal.items()},
            "squareness": {name: _number_json(q) for name, q in self.squareness.items()},
            "scale": {name: {**_number_json(s), "identified": s.identified} for name, s in self.scale.items()},
            "setups": self.setups,
            "findings": [finding.as_json() for finding in self.findings],
            **self.extra,
            **({} if self.posterior is None else {"posterior": self.posterior.as_json()}),
        }
        text = json.dumps(_rounded(document), indent=2, ensure_ascii=False, allow_nan=False)
        return _NUMBERS.sub(lambda found: "[" + " ".join(found[0][1:-1].split()) + "]", text) + "\n"


def same_result(one: bytes, other: bytes) -> bool:
    """Tell whether two ``result.json`` say the same but for the tenth of a nanometre by which two processors may differ."""
    try:
        first, second = json.loads(one), json.loads(other)
        shape, other_shape = first.pop("posterior", None), second.pop("posterior", None)
    except (ValueError, AttributeError, TypeError, RecursionError):
        return False
    return same_but_for_rounding(first, second, DECIMALS) and same_but_for_rounding(shape, other_shape, POSTERIOR_DECIMALS)


def _volume_json(volume: Volume) -> dict[str, Any]:
    return {"origin_mm": list(volume.origin_mm), "size_mm": list(volume.size_mm), "increments": volume.increments}


def _number_json(number: Quantity | Scale) -> dict[str, Any]:
    return {"value": number.value, "u": number.u, "u_readings": number.u_readings, "unit": number.unit}


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
    """Return JSON types with every float rounded."""
    if type(value) is float:  # nearly all that there is
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


def parse_result(text: str, source: str = "result.json") -> Result:
    """Return the result written by ``Result.to_json``.

    Raises ``DataError`` that names the field for anything that is no result of this format and version. Top-level entries
    that a later program added are kept in ``extra``.
    """
    root = load_json(text, source)
    root.equals("format", FORMAT)
    version = root.child("version")
    if type(version.value) is not int or version.value not in READABLE_VERSIONS:
        version.refuse(f"{READABLE_VERSIONS[0]} or {READABLE_VERSIONS[1]}")
    return Result(
        volume=_volume(root.child("volume")),
        chain=_chain(root),
        method=root.text("method") if "method" in root.mapping() else "",
        errors=_functions(root.child("errors"), (*DISPLACEMENTS, *ROTATIONS), required=DISPLACEMENTS),
        reversal=_functions(root.child("reversal"), (*DISPLACEMENTS, *ROTATIONS)) if "reversal" in root.mapping() else {},
        expected=_functions(root.child("expected"), ROTATIONS) if "expected" in root.mapping() else {},
        posterior=parse_posterior(root.child("posterior")) if "posterior" in root.mapping() else None,
        squareness={name: _quantity(root.child("squareness").child(name)) for name in SQUARENESS},
        scale={name: _scale(root.child("scale").child(name)) for name in AXIS_LETTERS},
        setups=_setups(root.child("setups")),
        findings=tuple(_finding(item) for item in root.child("findings").items()),
        software=_software(root),
        extra={key: root.child(key).plain() for key in root.mapping() if key not in _ENTRIES},
        source=source,
    )


def _volume(node: Node) -> Volume:
    origin, size = node.child("origin_mm"), node.child("size_mm")
    increments = node.child("increments")
    if len(origin.numbers()) != 3:
        origin.refuse(message("three-numbers"))
    if len(size.numbers()) != 3 or min(size.numbers()) < 0 or max(size.numbers()) == 0:
        size.refuse("three numbers, 0 for an axis without travel")
    if type(increments.value) is not int or not 1 <= increments.value <= MOST_INCREMENTS:
        increments.refuse(f"a whole number from 1 to {MOST_INCREMENTS}")
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


def _setups(node: Node) -> dict[str, Any]:
    """Return what each setup reports; other programs may report more, but every report has names."""
    return {name: {fact: node.child(name).child(fact).plain() for fact in node.child(name).mapping()} for name in node.mapping()}


def _software(root: Node) -> dict[str, str]:
    """Return name and version of the program that wrote the result, empty where it does not say."""
    if "software" not in root.mapping():
        return {"name": "", "version": ""}
    return {name: root.child("software").text(name) for name in ("name", "version")}


def _functions(node: Node, known: tuple[str, ...], required: tuple[str, ...] = ()) -> dict[str, Function]:
    for name in node.mapping():
        if name not in known:
            node.child(name).refuse("a function named " + ", ".join(known))
    for name in required:
        node.child(name)
    return {name: _function(node.child(name), "um" if name in DISPLACEMENTS else "urad") for name in node.mapping()}


def _function(node: Node, unit: str) -> Function:
    node.equals("unit", unit)
    position = node.child("position_mm").numbers()
    # an axis that did not travel stands at one position, and has no values
    least = 2 if node.child("value").value is not None else 1
    if len(position) < least or np.any(np.diff(position) <= 0):
        node.child("position_mm").refuse("at least two ascending positions")
    known: dict[str, Vector | None] = {}
    for name in ("value", "u", "u_readings"):
        column = node.child(name) if name in node.mapping() or name != "u_readings" else None
        known[name] = None if column is None or column.value is None else column.numbers()
        if column is not None and column.value is not None and len(column.value) != len(position):
            column.refuse(f"{len(position)} numbers, one a position")
    slope = node.child("slope_identified").truth() if "slope_identified" in node.mapping() else True
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
    return _optional(node.child("u_readings")) if "u_readings" in node.mapping() else None


def _quantity(node: Node) -> Quantity:
    node.equals("unit", "urad")
    return Quantity(value=_optional(node.child("value")), u=_optional(node.child("u")), u_readings=_readings_u(node))


def _scale(node: Node) -> Scale:
    node.equals("unit", "um/m")
    identified = node.child("identified").truth()
    value = _optional(node.child("value"))
    if identified != (value is not None):
        node.refuse("a value exactly where identified is true")
    return Scale(value=value, u=_optional(node.child("u")), identified=identified, u_readings=_readings_u(node))


def _finding(node: Node) -> Finding:
    severity = node.text("severity")
    if severity not in ("info", "warning", "error"):
        node.child("severity").refuse("info, warning or error")
    tree = node.mapping()
    return Finding(
        code=node.text("code"),
        severity=severity,  # type: ignore[arg-type]
        text=node.text("text"),
        message=message_of({"key": tree.get("key", tree["code"]), "arguments": tree.get("arguments")}),
        setup=node.text("setup") if "setup" in node.mapping() else "",
        pass_number=_whole_if_there(node, "pass"),
        stop=_whole_if_there(node, "stop"),
        size_um=node.child("size_um").number() if "size_um" in node.mapping() else None,
        among=node.child("among").texts() if "among" in node.mapping() else (),
    )


def _whole_if_there(node: Node, name: str) -> int | None:
    if name not in node.mapping():
        return None
    value = node.child(name).number()
    if not value.is_integer():
        node.child(name).refuse(message("whole"))
    return int(value)
