"""SINUMERIK products: a CEC table multiplied by another CEC table corrects the effect of an angle
with its lever.

Function manual K3 (6FC5397-1BP40-3BA1): the product is added to the total compensation value of the
output axis (p. 245). ``$AN_CEC_MULT_BY_TABLE[t]`` contains the NUMBER, index + 1, of the table that
multiplies table t (p. 249). The manual does not state whether two linked tables also act by
themselves. In the example of p. 252, X1 moves only by the product of a tilt along X1 and a straight
line along Z1. So stepdiag assumes that two linked tables apply only their product. As a precaution,
the values of both tables are about 0.1 mm, although an error and a factor of one would give the
same product. If a control adds the tables themselves, the axis moves by only about 0.1 mm in the
sign test, and the sign test reports this movement.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import combinations

import numpy as np

from stepdiag.base.errors import DataError
from stepdiag.base.messages import message
from stepdiag.exporters.siemens import cec
from stepdiag.exporters.siemens.cec import TIMES
from stepdiag.exporters.tables.curves import Curve
from stepdiag.exporters.tables.fit import Product
from stepdiag.exporters.tables.profile import Profile
from stepdiag.exporters.tables.sampling import quantised
from stepdiag.exporters.tables.tables import Law, Multiplier, Table

KIND = "cec-product"
LEVER_MM = 0.1
"""Largest value of the multiplying table in mm. The values of the multiplied table are the movement
divided by this value in mm.
"""
_MOST = 12
"""Largest number of products that the selection compares: more than the useful angles of a machine
with three axes.
"""


def product_table(
    product: Product,
    profile: Profile,
    law: Law,
    decimals: int,
    place: Mapping[str, int | str],
) -> Table:
    """Return the table of a product on the grids of its two axes, in the resolution that both
    tables allow.
    """
    grid, by = profile.grid_mm(product.input_axis), profile.grid_mm(product.by_axis)[[0, -1]]
    lever = (by - product.middle_mm) / product.half_mm
    largest = float(np.max(np.abs(lever)))
    quantum_um = 1000.0 * 10.0**-decimals * LEVER_MM
    along = np.interp(grid, product.position_mm, product.value_um) * largest
    step = 10.0**-decimals / LEVER_MM
    return Table(
        kind=KIND,
        input_axis=product.input_axis,
        output_axis=product.output_axis,
        position_mm=grid,
        value_um=quantised(-law.factor * along, quantum_um),
        quantum_um=quantum_um,
        law=law,
        reference_mm=profile.axis(product.input_axis).reference_mm,
        place=place,
        multiplier=Multiplier(
            axis=product.by_axis, position_mm=by, value=quantised(lever / largest, step)
        ),
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class Budget:
    """The selected curves and products for the tables of a control, and the names of the omitted
    parts.
    """

    curves: tuple[str, ...]
    products: tuple[Product, ...]
    left_out: tuple[str, ...]


def chosen(
    curves: Sequence[Curve],
    tables_of: Mapping[str, int],
    products: Sequence[Product],
    tables: int | None,
) -> Budget:
    """Return the curves and products with the largest effect within ``tables`` CEC tables (None:
    without a limit).

    ``tables_of`` contains the number of CEC tables of each curve. A product needs one table, and a
    second table for its lever. Products of the same lever and output axis share the second table.
    The parts are orthogonal, so the squares of the omitted parts add up: the selection with the
    smallest sum of squares is used.
    """
    given = [product for product in products[:_MOST] if product.rms_um > 0.0]
    worth = {curve.name: _rms_um(curve) for curve in curves if tables_of[curve.name]}
    best: tuple[float, tuple[str, ...], tuple[Product, ...]] | None = None
    for count in range(len(given) + 1):
        for some in combinations(given, count):
            room = None if tables is None else tables - taken_by(some)
            kept = _most_valuable(worth, tables_of, room)
            if kept is not None:
                held = sum(worth[name] ** 2 for name in kept) + sum(
                    product.rms_um**2 for product in some
                )
                if best is None or held > best[0] + 1e-12:
                    best = held, kept, some
    if best is None:
        return Budget(curves=(), products=(), left_out=tuple(worth))
    _, kept, some = best
    left = [name for name in worth if name not in kept] + [
        product.name for product in given if product not in some
    ]
    return Budget(curves=kept, products=tuple(some), left_out=tuple(left))


def taken_by(products: Sequence[Product]) -> int:
    return len(products) + len(
        {(product.by_axis, product.output_axis) for product in products}
    )


def _most_valuable(
    worth: Mapping[str, float], tables_of: Mapping[str, int], room: int | None
) -> tuple[str, ...] | None:
    """Return the names of the curves that fit into ``room`` tables, by largest effect per table;
    None if ``room`` is negative.
    """
    if room is None:
        return tuple(worth)
    if room < 0:
        return None
    kept: list[str] = []
    for name in sorted(worth, key=lambda name: -(worth[name] ** 2) / tables_of[name]):
        if tables_of[name] <= room:
            kept.append(name)
            room -= tables_of[name]
    return tuple(name for name in worth if name in kept)


def _rms_um(curve: Curve) -> float:
    """Return the rms error over the volume that omission of a curve would leave: the standard
    deviation of the curve along its axis, in um.
    """
    at = np.linspace(curve.position_mm[0], curve.position_mm[-1], 201)
    return float(np.std(curve.at(at)))


def numbered(tables: Sequence[Table]) -> list[Table]:
    """Return the tables as the control numbers them. A product becomes two tables; the multiplied
    table contains the number of the multiplying table.

    A product whose multiplier is zero throughout, as in restore files, has no multiplying table.
    """
    found: list[Table] = []
    levers: dict[int, Table] = {}
    for table in tables:
        if table.multiplier is None:
            found.append(table)
            continue
        times = int(table.place[TIMES])
        linked = times if table.multiplier.value.any() else -1
        found.append(
            replace(
                table,
                value_um=table.value_um / LEVER_MM,
                multiplier=None,
                place={"table": table.place["table"], TIMES: linked},
            )
        )
        levers.setdefault(times, _lever(table, table.multiplier, times))
    return [*found, *levers.values()]


def _lever(table: Table, multiplier: Multiplier, number: int) -> Table:
    return replace(
        table,
        input_axis=multiplier.axis,
        position_mm=multiplier.position_mm,
        value_um=multiplier.value * LEVER_MM * 1000.0,
        direction=0,
        multiplier=None,
        place={"table": number},
    )


def joined(tables: Sequence[Table], where: str) -> tuple[Table, ...]:
    """Return the tables with every multiplied and multiplying table joined into a product.

    Raises ``DataError`` if the multiplying table is missing, is itself multiplied, has a direction,
    or moves another axis.
    """
    by_number = {
        int(table.place["table"]): table for table in tables if table.kind == cec.KIND
    }
    linked = {
        number: int(table.place[TIMES])
        for number, table in by_number.items()
        if TIMES in table.place
    }
    for number, times in linked.items():
        other = by_number.get(times)
        if (
            other is None
            or times in linked
            or other.output_axis != by_number[number].output_axis
            or other.direction
        ):
            raise DataError(
                f"{where}: table [{number}]",
                expected=message("plain-table"),
                found=f"$AN_CEC_MULT_BY_TABLE {times + 1}",
            )
    return tuple(_linked_tables(tables, by_number, linked))


def _linked_tables(
    tables: Sequence[Table], by_number: Mapping[int, Table], linked: Mapping[int, int]
) -> Iterator[Table]:
    for table in tables:
        number = int(table.place["table"]) if table.kind == cec.KIND else -1
        if number in linked:
            lever = by_number[linked[number]]
            largest_mm = float(np.max(np.abs(lever.value_um))) / 1000.0
            yield replace(
                table,
                kind=KIND,
                value_um=table.value_um * largest_mm,
                quantum_um=table.quantum_um * largest_mm or table.quantum_um,
                multiplier=Multiplier(
                    axis=lever.input_axis,
                    position_mm=lever.position_mm,
                    value=lever.value_um / 1000.0 / largest_mm
                    if largest_mm
                    else np.zeros(lever.value_um.shape),
                ),
            )
        elif number not in linked.values():
            yield table
