"""The posterior: possible differences between the machine and a result, as independent deviations
with unit variance.

    machine = result + offset + sum_k z_k mode_k + rest * z,    all z normal(0, 1)

A mode is a deviation of the whole machine: functions and squarenesses that change together because
of a common cause. ``rest`` contains the small or isolated deviations, whose values vary
independently. The intervals of all volumetric values are computed from the posterior.

The last modes belong to causes of unknown size. Several sizes are equally likely. For each size,
the amount of such a mode is ``shift + scale z`` instead of z. The mean square of these amounts,
averaged over all sizes, is one.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from stepdiag.base.messages import message
from stepdiag.base.names import PRODUCTS
from stepdiag.base.result.json_tree import Node
from stepdiag.base.volume import Vector

NAMES = frozenset(
    (
        *(f"E{component}{axis}" for component in "XYZABC" for axis in "XYZ"),
        "C0Y",
        "B0Z",
        "A0Z",
        *PRODUCTS,
    )
)
"""Names of the quantities in the posterior: functions and squarenesses (ISO 230-1), and errors of
two axes.
"""
POSTERIOR_DECIMALS = 4
"""Number of decimals of the posterior in the result's file."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class UnknownSize:
    """Factors for the amounts of the last modes at each of the equally likely sizes: ``scale`` and
    ``shift``, shapes (sizes, modes)."""

    scale: Vector
    shift: Vector

    @classmethod
    def nothing(cls) -> "UnknownSize":
        """Return factors for a posterior in which no mode depends on an unknown size."""
        return cls(scale=np.ones((1, 0)), shift=np.zeros((1, 0)))


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Posterior:
    """Possible differences between the machine and a result. ``position_mm`` contains the nodes by
    axis letter, shapes (k,). ``offset`` (k,), ``modes`` (modes, k) and ``rest`` (k,) are in um or
    urad (k = 1), by function and by squareness; a quantity without uncertainty has no entry.
    ``between_um`` contains, by function, equally likely sizes, shapes (sizes,), of the distance of
    the function, halfway between two targets, from the straight line through its values at both
    targets. ``sized`` is the dependence of the
    last modes on an unknown size."""

    position_mm: Mapping[str, Vector]
    offset: Mapping[str, Vector]
    modes: Mapping[str, Vector]
    rest: Mapping[str, Vector]
    between_um: Mapping[str, Vector]
    sized: UnknownSize = field(default_factory=UnknownSize.nothing)

    def drawn(self, draws: int) -> Vector:
        """Return the amounts of the `deviations` for machines drawn from the posterior, shape
        (draws, deviations), equal in every call."""
        z = np.random.default_rng(0).standard_normal(
            (draws, self.count + sum(len(values) for values in self.rest.values()))
        )
        size = np.arange(draws) % len(self.sized.scale)
        mine = slice(self.count - self.sized.scale.shape[1], self.count)
        z[:, mine] = self.sized.shift[size] + self.sized.scale[size] * z[:, mine]
        return np.column_stack([np.ones(draws), z])

    @property
    def count(self) -> int:
        return max((len(values) for values in self.modes.values()), default=0)

    def deviations(self) -> dict[str, Vector]:
        """Return the possible deviations by quantity, shape (1 + modes + values of the rest, k):
        the offset, each mode, each value of the rest."""
        names = dict.fromkeys((*self.offset, *self.modes, *self.rest))
        modes = self.count
        total = 1 + modes + sum(len(values) for values in self.rest.values())
        found, start = {}, 1 + modes
        for name in names:
            size = next(
                np.atleast_2d(part[name]).shape[1]
                for part in (self.offset, self.modes, self.rest)
                if name in part
            )
            values = np.zeros((total, size))
            values[0] = self.offset.get(name, 0.0)
            values[1 : 1 + modes] = self.modes.get(name, 0.0)
            if name in self.rest:
                values[start : start + size] = np.diag(self.rest[name])
                start += size
            found[name] = values
        return found

    def as_json(self) -> dict[str, Any]:
        """Return the JSON form of the posterior. Numbers that are small relative to the largest
        number of their row have fewer digits."""
        return {
            "position_mm": dict(self.position_mm),
            "offset": {name: _short(values) for name, values in self.offset.items()},
            "modes": {
                name: [_short(mode) for mode in values] for name, values in self.modes.items()
            },
            "rest": {name: _short(values) for name, values in self.rest.items()},
            "between_um": {name: _short(sizes) for name, sizes in self.between_um.items()},
            "sized": {
                "scale": [_short(one) for one in self.sized.scale],
                "shift": [_short(one) for one in self.sized.shift],
            },
        }


def _short(values: Vector) -> list[float]:
    return [round(float(value), POSTERIOR_DECIMALS) + 0.0 for value in values]


def parse_posterior(root: Node) -> Posterior:
    """Return the posterior of a result. Raises ``DataError`` with the wrong field."""
    root.only(("position_mm", "offset", "modes", "rest", "between_um", "sized"))
    root.child("position_mm").only("XYZ")
    positions = {axis: root.child("position_mm").child(axis).numbers() for axis in "XYZ"}
    for part in ("offset", "modes", "rest", "between_um"):
        if unknown := sorted(root.child(part).mapping().keys() - NAMES):
            root.child(part).child(unknown[0]).refuse(", ".join(sorted(NAMES)))
    for axis, position in positions.items():
        if len(position) < 2 or np.any(np.diff(position) <= 0):
            root.child("position_mm").child(axis).refuse(message("two-ascending"))

    def size(name: str) -> int:
        return len(positions[name[2]]) if name[0] == "E" else 1

    def column(node: Node, name: str) -> Vector:
        values = node.numbers()
        if len(values) != size(name):
            node.refuse(f"{size(name)} numbers, one a position")
        return values

    def columns(part: str) -> dict[str, Vector]:
        return {
            name: column(root.child(part).child(name), name)
            for name in root.child(part).mapping()
        }

    modes = {
        name: np.array(
            [column(mode, name) for mode in root.child("modes").child(name).items()]
        ).reshape(-1, size(name))
        for name in root.child("modes").mapping()
    }
    if len({len(values) for values in modes.values()}) > 1:
        root.child("modes").refuse(message("equal-modes"))
    between = {
        name: _parse_between(root.child("between_um").child(name))
        for name in root.child("between_um").mapping()
    }
    count = max((len(values) for values in modes.values()), default=0)
    return Posterior(
        position_mm=positions,
        offset=columns("offset"),
        modes=modes,
        rest=columns("rest"),
        between_um=between,
        sized=_parse_sizes(root.child("sized"), count)
        if root.strict or "sized" in root.mapping()
        else UnknownSize.nothing(),
    )


def _parse_between(node: Node) -> Vector:
    if not node.strict and isinstance(node.value, int | float):
        return np.array([node.number()])
    sizes = node.numbers()
    if not len(sizes):
        node.refuse(message("one-size-at-least"))
    return sizes


def _parse_sizes(node: Node, most: int) -> UnknownSize:
    node.only(("scale", "shift"))
    scale, shift = (
        [one.numbers() for one in node.child(part).items()] for part in ("scale", "shift")
    )
    if (
        not scale
        or len(scale) != len(shift)
        or len({len(one) for one in (*scale, *shift)}) > 1
        or len(scale[0]) > most
    ):
        node.refuse(message("rows-of-scale"))
    return UnknownSize(scale=np.array(scale), shift=np.array(shift))
