"""The verdict on a table that multiplies another one: what grows with a lever, against the field of the result."""

import numpy as np

from stepdiag.base.messages import message
from stepdiag.base.names import AXES
from stepdiag.base.result.field import error_field_um
from stepdiag.base.result.result import Result
from stepdiag.base.volume import Vector, rms
from stepdiag.exporters.safety.verdicts.case import TableCase
from stepdiag.exporters.safety.verdicts.measures import ALIKE, NODES, SAME, SURE_UM, grid_mm, growing_um
from stepdiag.exporters.safety.verdicts.verdict import Judgement
from stepdiag.exporters.tables.tables import Table


def of_product(case: TableCase, result: Result) -> Judgement:
    """Return the judgement of a product table: it is compared with the part of the field that grows with the same lever."""
    multiplier = case.table.multiplier
    if multiplier is None or multiplier.axis == case.table.input_axis:
        return case.says("right", message("lever-along-axis-itself"))
    moving, by = (AXES.index(letter.lower()) for letter in (case.table.input_axis, multiplier.axis))
    moved = -growing_um(case.moved_field_um(), moving, by)
    asked = growing_um(_field_um(result, case.table), moving, by)
    size, wanted = rms(moved), rms(asked)
    if size < SURE_UM / 2:
        return case.says("empty", message("no-correction"))
    if wanted < SURE_UM / 2:
        return case.says("unlike", message("field-result-holds-nothing"))
    factor, alike = float(np.mean(moved * asked)) / wanted**2, float(np.mean(moved * asked)) / (size * wanted)
    if rms(moved - asked) <= max(SAME * wanted, SURE_UM / 2):
        return case.says("right", message("what-result-asks-for"), factor)
    if rms(moved + asked) <= SAME * wanted:
        return case.says("sign-turned", message("product-with-opposite-sign"), -1.0)
    if abs(alike) < ALIKE:
        return case.says("unlike", message("field-result-holds-nothing"))
    text = message("times-as-large-as", factor=abs(factor)) if factor < 0 else message("times-too-large", factor=abs(factor))
    return case.says("scaled", text, factor)


def _field_um(result: Result, table: Table) -> Vector:
    """Return the error of the output axis of a table on the grid of `grid_mm`."""
    axis = AXES.index(table.output_axis.lower())
    return np.asarray(error_field_um(result, grid_mm(result.volume))[:, axis].reshape(NODES, NODES, NODES))
