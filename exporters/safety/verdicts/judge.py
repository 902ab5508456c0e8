"""Is a table the one that the result asks for? Each is compared with what it should be, and with what goes wrong in practice.

The comparison looks at the movement that the control's law makes of the table, with its mean taken off (an origin is nobody's error), and
at the curve that the export would write, as far as the table has points to hold it. What fits neither is tried turned in sign, as the
table of another axis or function, shifted, and scaled.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from stepdiag.base.messages import message
from stepdiag.base.result.result import Result
from stepdiag.base.volume import Volume
from stepdiag.exporters.safety.standing import Standing, unchanged
from stepdiag.exporters.safety.verdicts.case import TableCase
from stepdiag.exporters.safety.verdicts.curve import of_curve
from stepdiag.exporters.safety.verdicts.measures import POINTS
from stepdiag.exporters.safety.verdicts.product import of_product
from stepdiag.exporters.safety.verdicts.verdict import Judgement
from stepdiag.exporters.safety.verdicts.wanted import Wanted
from stepdiag.exporters.tables.profile import Profile
from stepdiag.exporters.tables.tables import Table


def judge(result: Result, tables: Sequence[Table], standing: Standing, profile: Profile) -> tuple[Judgement, ...]:
    """Return a judgement for every table, in their order: by what all that act in the control afterwards do, old tables among them.

    Tables that act together (two directions, two kinds for one function) are judged by their sum. One of a function that nobody asked for
    and that goes on as before is "kept".
    """
    after, before = standing.acting(result, profile)
    wanted = Wanted(result)
    turns = _turns(wanted, after, before, result.volume)
    judged = []
    for table in tables:
        fault = _measuring_system(table, profile) or _kept(table, standing, profile)
        if fault is None:
            acting = [[each for each in some if _acts_with(each, table)] for some in (after, before)]
            case = TableCase(table, acting[0], acting[1], result.volume, turns.get(table.name, 0.0))
            fault = _emptied(case)
        if fault is None:
            fault = of_product(case, result) if table.multiplier is not None else of_curve(case, wanted, result.volume)
        judged.append(fault)
    # a control has zeros for what nobody asked for, and zeros alone take every correction out, as restore files do
    asked = set(profile.machine.functions) if any(table.value_um.any() for table in tables) else set()
    return tuple(replace(each, code="empty") if each.code == "missing" and each.function not in asked else each for each in judged)


def _turns(wanted: Wanted, after: Sequence[Table], before: Sequence[Table], volume: Volume) -> dict[str, float]:
    """Return, for each two functions of one pair of axes that both have tables, the slopes in um/mm that are a turn of the workpiece.

    Old tables, levers and the choice of the function that holds a squareness move such a turn from one calibration into the next: it raises
    one function by as much as it lowers the other.
    """
    found: dict[str, float] = {}
    for one, other in (("EXY", "EYX"), ("EXZ", "EZX"), ("EYZ", "EZY")):
        slopes = []
        for name in (one, other):
            tables = [table for table in after if table.name == name and table.multiplier is None]
            curves = wanted.of(name)
            if tables and curves:
                acting = [[each for each in some if _acts_with(each, tables[0])] for some in (after, before)]
                first, last = curves[0].position_mm[[0, -1]]
                at = np.linspace(first, last, POINTS)
                off = TableCase(tables[0], acting[0], acting[1], volume).moved_um(at) + curves[0].at(at)
                slopes.append(float(np.polyfit(at, off, 1)[0]))
        if len(slopes) == 2:
            found |= {one: (slopes[0] - slopes[1]) / 2.0, other: (slopes[1] - slopes[0]) / 2.0}
    return found


def _acts_with(one: Table, other: Table) -> bool:
    """Return whether ``one`` counts for the judgement of ``other``: the same function, and of a curve what products do along its axis.

    Products of one function and lever count together, wherever they stand: a new one may do the work of an old one under other numbers.
    """
    if other.multiplier is not None:
        return one.multiplier is not None and one.name == other.name and one.multiplier.axis == other.multiplier.axis
    if one.multiplier is None:
        return one.name == other.name
    return one.output_axis == other.output_axis and other.input_axis in (one.input_axis, one.multiplier.axis)


def _measuring_system(table: Table, profile: Profile) -> Judgement | None:
    system, used = table.place.get("measuring system"), getattr(profile.options, "measuring_system", None)
    if profile.assumed or system is None or used is None or system == used:
        return None
    text = message("written-for-measuring-system", label=table.label, system=str(system), used=str(used))
    return Judgement(function=table.name, table=table, code="wrong-measuring-system", words=text)


def _kept(table: Table, standing: Standing, profile: Profile) -> Judgement | None:
    """Return a judgement where a function that nobody asked for moves the axis as it did before."""
    if table.name in profile.machine.functions or table.multiplier is not None:
        return None
    then, now = ([each for each in some if each.name == table.name] for some in (standing.before, standing.after))
    if not then or not now or not unchanged(now, then):
        return None
    return Judgement(function=table.name, table=table, code="kept", words=message("as-it-was-in", label=table.label))


def _emptied(case: TableCase) -> Judgement | None:
    """Return a judgement of zeros beside another table that does the work."""
    if case.table.value_um.any() or not any(each.value_um.any() for each in case.together):
        return None
    return case.says("empty", message("zeros-nothing-acts-from"))
