"""The law of controls with a kinematic chain: the effect of error functions of single axes, with
their angles and Abbe arms, on the tool."""

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from stepdiag.virtual.physics.error_functions import AXES, Array
from stepdiag.virtual.physics.kinematics import rotation_matrix, split_chain

Nodes = tuple[Array, Array]
"""An error function: positions in mm and values (mm or rad), linear between the positions and
constant beyond them."""
SQUARENESS_TURNS = {"C0Y": (1, 2), "B0Z": (2, 1), "A0Z": (2, 0)}
"""By squareness error: the axis that leans, and the axis about which it is turned."""


@dataclass(frozen=True, slots=True, kw_only=True)
class ChainTable:
    """Error functions by their ISO 230-1 names, and squarenesses in rad. The control moves the tool
    by the opposite of these errors.

    With ``carries``, an axis that is out of square also turns the axes and parts that it carries.
    With ``before_travel``, the angles of an axis never turn the travel of this axis. Without
    ``before_travel``, the angles of an axis that carries the work turn this travel. ``negated`` are
    output axes with reversed movement.
    """

    chain: str
    functions: Mapping[str, Nodes]
    squareness_rad: Mapping[str, float] = field(default_factory=dict)
    carries: bool = False
    before_travel: bool = False
    negated: str = ""

    def correction_mm(self, commanded_mm: Array, direction: Array) -> Array:  # noqa: ARG002 - these tables know no direction of travel
        """Return the corrections of the axes at commanded positions, shape (N, 3): Abbe arms begin
        at the zero of the axes."""
        work, tool = split_chain(self.chain)
        at = np.zeros_like(commanded_mm, dtype=np.float64)
        for axis in reversed(
            (*work, *tool)
        ):  # from the tool to the table: each axis moves the point that it carries
            travel = self._travel(axis, commanded_mm)
            inside = self.before_travel or axis in tool
            at = at if inside else at + travel
            at = np.einsum(
                "nij,nj->ni", rotation_matrix(self._values("ABC", axis, commanded_mm)), at
            )
            at = at + self._values("XYZ", axis, commanded_mm) + (travel if inside else 0.0)
            if self.carries:
                at = self._leaning(axis, at)
        sense = np.array([1.0 if letter in self.negated else -1.0 for letter in "XYZ"])
        moved: Array = (at - commanded_mm) * sense
        return moved

    def _travel(self, axis: int, commanded_mm: Array) -> Array:
        travel = np.zeros_like(commanded_mm, dtype=np.float64)
        travel[:, axis] = commanded_mm[:, axis]
        if not self.carries:
            travel = self._leaning(axis, travel)
        return travel

    def _leaning(self, axis: int, at: Array) -> Array:
        turn = np.zeros((len(at), 3))
        for name, value in self.squareness_rad.items():
            leaning, about = SQUARENESS_TURNS[name]
            if leaning == axis:
                turn[:, about] = value
        leaned: Array = np.einsum("nij,nj->ni", rotation_matrix(turn), at)
        return leaned

    def _values(self, words: str, axis: int, commanded_mm: Array) -> Array:
        columns = []
        for word in words:
            nodes = self.functions.get(f"E{word}{AXES[axis].upper()}")
            columns.append(
                np.zeros(len(commanded_mm))
                if nodes is None
                else np.interp(commanded_mm[:, axis], *nodes)
            )
        return np.stack(columns, axis=-1)
