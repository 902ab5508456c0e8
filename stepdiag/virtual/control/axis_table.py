"""A compensation table for all controls: a curve over the position of one axis, by which this axis
or another axis is moved."""

from dataclasses import dataclass

import numpy as np

from stepdiag.virtual.physics.error_functions import Array


@dataclass(frozen=True, slots=True, kw_only=True)
class AxisTable:
    """The correction that the control adds to ``output_axis`` (0, 1, 2) at a position of
    ``input_axis``, constant beyond the ends.

    A positive ``correction_mm`` moves the axis in +, whatever the sign convention of the file.
    ``travel`` is +1 or -1 for a table that acts in one direction of the input axis, 0 for both
    directions. With ``stepped``, a value applies up to the next point, without interpolation. The
    value of this table is multiplied by that of the table ``factor``.
    """

    input_axis: int
    output_axis: int
    position_mm: tuple[float, ...]
    value_mm: tuple[float, ...]
    travel: int = 0
    stepped: bool = False
    factor: "AxisTable | None" = None

    def __post_init__(self) -> None:
        if len(self.position_mm) != len(self.value_mm) or not self.position_mm:
            raise ValueError(
                f"table: expected one value per position, found {len(self.value_mm)} for "
                f"{len(self.position_mm)}"
            )
        if np.any(np.diff(self.position_mm) <= 0.0):
            raise ValueError(f"table: expected ascending positions, found {self.position_mm}")

    def value_at(self, commanded_mm: Array) -> Array:
        """Return the table's value at commanded positions (N, 3), shape (N,), for either direction
        of travel."""
        position = commanded_mm[:, self.input_axis]
        nodes, values = np.array(self.position_mm), np.array(self.value_mm)
        value: Array
        if self.stepped:
            reached = np.searchsorted(nodes, position + 1e-9, side="right") - 1
            value = values[np.clip(reached, 0, len(nodes) - 1)]
        else:
            value = np.interp(position, nodes, values)
        return value if self.factor is None else value * self.factor.value_at(commanded_mm)

    def correction_mm(self, commanded_mm: Array, direction: Array) -> Array:
        """Return the corrections of the axes, shape (N, 3); for direction 0, the mean of both
        directions."""
        acting = (
            1.0
            if self.travel == 0
            else 0.5 * (1.0 + self.travel * direction[:, self.input_axis])
        )
        correction = np.zeros_like(commanded_mm)
        correction[:, self.output_axis] = acting * self.value_at(commanded_mm)
        return correction
