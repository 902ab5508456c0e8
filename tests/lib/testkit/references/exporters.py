"""What the exporters are asked of their reference data: an input names a call's cases, which stand
as code in `testkit.recorded`."""

from collections.abc import Callable, Mapping
from typing import Any

from testkit.recorded import (
    asked,
    checked,
    computed,
    damaged,
    exchanged,
    exported,
    judged,
    kept,
    limited,
    programmed,
    served,
    tried,
    weighed,
)
from testkit.recorded.plain import shortened

Cases = Mapping[str, Callable[[], Any]]
OTHERS = "others"
GROUPS: Mapping[str, tuple[Callable[[], Cases], tuple[str, ...]]] = {
    "exported": (
        exported.cases,
        (
            "siemens-loaded",
            "siemens",
            "fanuc",
            "heidenhain",
            "linuxcnc",
            "beckhoff",
            "mitsubishi",
            "fagor",
            "neutral",
        ),
    ),
    "damaged": (
        damaged.cases,
        ("siemens", "fanuc", "heidenhain", "linuxcnc", "beckhoff", "mitsubishi"),
    ),
    "judged": (
        judged.cases,
        (
            "all",
            "EXX",
            "EZY",
            "EXZ",
            "products",
            "lattice",
            "beckhoff",
            "heidenhain",
            "linuxcnc",
        ),
    ),
    "checked": (checked.cases, ("standing", "remarks", "kinds-of-laws")),
    "tried": (tried.cases, ("bump", "verdict")),
    "programmed": (
        programmed.cases,
        ("fanuc", "heidenhain", "linuxcnc", "siemens", "profiles"),
    ),
    "computed": (computed.cases, ("fits", "columns")),
    "exchanged": (exchanged.cases, ("etalon",)),
    "limited": (limited.cases, ("options", "limits")),
    "kept": (kept.cases, ()),
    "weighed": (weighed.cases, ("sizes", "mixtures")),
    "served": (served.cases, ()),
    "asked": (asked.cases, ("common", "section")),
}
"""By call: its cases, and the beginnings of the names of those that stand in a file of their own;
the first that fits counts."""


def group_of(call: str, name: str) -> str:
    """Return the group of a case."""
    return next(
        (group for group in GROUPS[call][1] if name == group or name.startswith(f"{group}-")),
        OTHERS,
    )


def made(call: str, group: str) -> dict[str, Any]:
    """Return what comes of every case of a group."""
    cases = GROUPS[call][0]()
    return shortened(
        {name: act() for name, act in cases.items() if group_of(call, name) == group}
    )


CALLS = {call: lambda given, call=call: made(call, given["group"]) for call in GROUPS}
