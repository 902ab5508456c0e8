"""The verdict on every table of a set, and on every function without a table, with the sentences
for the explanations of `regression`.
"""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import replace

from stepdiag.base.errors import SafetyError, UsageError
from stepdiag.base.messages import Message, message
from stepdiag.base.result.result import Result
from stepdiag.base.volume import rms
from stepdiag.exporters.safety.standing import Standing, acts_with, unchanged
from stepdiag.exporters.safety.verdicts.case import TableCase, typical_u
from stepdiag.exporters.safety.verdicts.regression import SURE_UM, Explained, Fit, explain
from stepdiag.exporters.safety.verdicts.verdict import Code, Judgement
from stepdiag.exporters.safety.verdicts.wanted import Wanted, centred, is_known, mirrored
from stepdiag.exporters.tables.controller import Controller, plan_of
from stepdiag.exporters.tables.curves import FOLD_DEFAULT, FOLD_OTHER, FUNCTIONS, Curve
from stepdiag.exporters.tables.fit import fitted
from stepdiag.exporters.tables.profile import Profile
from stepdiag.exporters.tables.tables import Table


def judge(
    result: Result, tables: Sequence[Table], standing: Standing, profile: Profile
) -> tuple[Judgement, ...]:
    """Return a judgement for every table, in order, by the effect of all tables that are active in
    the control after loading, including old tables.

    Tables that act together (two directions, two kinds for a function) are judged by their sum. A
    table of a function that was not requested and stays as before is "kept".
    """
    after, before = standing.acting(result, profile)
    wanted = Wanted(result)

    def case_of(table: Table) -> TableCase:
        together, then = (
            [each for each in some if acts_with(each, table)] for some in (after, before)
        )
        return TableCase(table=table, together=together, before=then, volume=result.volume)

    turns = _turns(wanted, [case_of(table) for table in after if table.multiplier is None])
    judged = [
        _settled(case, standing, profile)
        or _compared(case, wanted, turns.get(case.table.name, 0.0))
        for case in map(case_of, tables)
    ]
    # Tables of zeros are normal for functions that were not requested.
    # A set with only tables of zeros removes every correction, as restore files do.
    asked = profile.machine.functions if any(table.value_um.any() for table in tables) else ()
    return tuple(
        replace(each, code="empty")
        if each.code == "missing" and each.function not in asked
        else each
        for each in judged
    )


def _compared(case: TableCase, wanted: Wanted, turn_um_mm: float) -> Judgement:
    name = case.table.name
    requests = wanted.as_slope(name) if case.is_slope else wanted.of(name)
    own = [case.unstepped(curve) for curve in requests]
    if not own:
        return _says(case, "unidentified", message("result-does-not-identify"))
    fits = _fits(case, own)
    found = explain(
        fits,
        _fits(case, own, turn_um_mm=turn_um_mm) if turn_um_mm else (),
        (
            (other, fit)
            for other in (mirrored(name), *FUNCTIONS)
            if "*" not in name and other != name
            for fit in _fits(case, wanted.of(other))
        ),
        ((shift, fit) for shift in case.shifts_mm() for fit in _fits(case, own, shift)),
    )
    words = _sentence(case, found, own[0])
    if found.other == mirrored(name):
        return _says(case, "input-output-swapped", words)
    elsewhere = found.other or found.shift_mm
    return _says(case, found.code, words, None if elsewhere else found.fit)


def _sentence(case: TableCase, found: Explained, asked: Curve) -> Message:
    fit, (first_mm, last_mm) = found.fit, case.table.position_mm[[0, -1]]
    low_mm, high_mm = case.travel_mm(case.table.input_axis)[[0, -1]]
    if found.code == "beside-volume" and fit is None:
        travel = {"low_mm": low_mm, "high_mm": high_mm}
        return message("to-mm-measured-travel", first_mm=first_mm, last_mm=last_mm, **travel)
    if fit is None:
        return message("nothing-like-what-result")
    size, turned = abs(fit.factor), fit.factor < 0.0
    sentences: dict[Code, Message] = {
        "right": message("what-result-asks-for"),
        "missing": message("no-correction-where-result", names_um=fit.size_um),
        "sign-turned": message("right-shape-with-opposite"),
        "scaled": message(
            "right-shape-times-as" if turned else "right-shape-other-size", factor=size
        ),
        "axes-swapped": message(
            "this-table-with-opposite" if turned else "this-table", name=found.other
        ),
        "beside-volume": message(
            "right-if-it-lay", shift_mm=found.shift_mm, first_mm=first_mm, last_mm=last_mm
        ),
        "unlike": message(
            "um-off-at-where",
            largest_um=fit.largest_um,
            where=f"{case.table.input_axis} {case.place_mm(asked, fit):g} mm",
        ),
    }
    return sentences[found.code]


def _says(case: TableCase, code: Code, words: Message, fit: Fit | None = None) -> Judgement:
    return Judgement(
        function=case.table.name,
        table=case.table,
        code=code,
        words=message("of-table", label=case.table.label, what=words),
        factor=None if fit is None else fit.factor,
        rms_um=None if fit is None else fit.rest_um,
        largest_um=None if fit is None else fit.largest_um,
    )


def _fits(
    case: TableCase, curves: Iterable[Curve], shift_mm: float = 0.0, turn_um_mm: float = 0.0
) -> list[Fit]:
    return [
        fit for curve in curves if (fit := case.fit(curve, shift_mm, turn_um_mm)) is not None
    ]


def _turns(wanted: Wanted, cases: Sequence[TableCase]) -> dict[str, float]:
    """Return, for each pair of axes with tables for both straightness functions, the slopes in
    um/mm that together only rotate the workpiece.

    This rotation is arbitrary: it depends on the calibration, the old tables, the levers, and the
    choice of the function that contains a squareness. The rotation raises the slope of one function
    by as much as it lowers the slope of the other function.
    """
    left = {
        case.table.name: case.slope_left_um_mm(curves[0])
        for case in cases
        if (curves := wanted.of(case.table.name))
    }
    return {
        name: (left[name] - left[mirrored(name)]) / 2.0
        for name in left
        if mirrored(name) in left
    }


def _settled(case: TableCase, standing: Standing, profile: Profile) -> Judgement | None:
    """Return the judgement of a table that needs no comparison: a table for another measuring
    system, an unchanged table of a function that was not requested, or zeros beside a table with
    the correction.
    """
    table = case.table
    system = table.place.get("measuring system")
    used = getattr(profile.options, "measuring_system", None)
    if not profile.assumed and None not in (system, used) and system != used:
        words = message("written-for-measuring-system", system=str(system), used=str(used))
        return _says(case, "wrong-measuring-system", words)
    then, now = (
        [each for each in some if each.name == table.name]
        for some in (standing.before, standing.after)
    )
    outside = table.name not in profile.machine.functions and table.multiplier is None
    if outside and then and now and unchanged(now, then):
        return _says(case, "kept", message("as-it-was-in"))
    if not table.value_um.any() and any(each.value_um.any() for each in case.together):
        return _says(case, "empty", message("zeros-nothing-acts-from"))
    return None


def judge_missing(
    result: Result, controller: Controller, new: Sequence[Table], profile: Profile
) -> Iterator[Judgement]:
    """Yield a judgement for each function that the result and the profile request, that this
    control can correct, and that is missing in ``new``.

    Files without any correction give no judgement, because they only remove old tables. Without a
    profile, the files may contain each squareness in either of its two functions. The assignment
    with the fewest missing functions is used.
    """
    if not any(table.value_um.any() for table in new):
        return
    folds = (
        (FOLD_DEFAULT, FOLD_OTHER) if profile.assumed else (profile.machine.squareness_into,)
    )
    lacking = (_lacking(result, controller, new, profile, fold) for fold in folds)
    for name, size_um in min(lacking, key=len).items():
        words = (
            message("no-table-for-it", name=name, size_um=size_um)
            if profile.assumed
            else message("no-table-though-asked", name=name, size_um=size_um)
        )
        yield Judgement(function=name, table=None, code="missing", words=words)


def _lacking(
    result: Result,
    controller: Controller,
    new: Sequence[Table],
    profile: Profile,
    fold: Mapping[str, str],
) -> dict[str, float]:
    known = [name for name in profile.machine.functions if is_known(result, name, fold)]
    fit = fitted(result, known, fold, profile.zone)
    try:
        planned = plan_of(controller, fit.curves, fit.products, profile).tables
    except (SafetyError, UsageError):
        # If the tables of the profile cannot be made, the contents of the control are
        # unknown.
        return {}
    held = {table.name for table in new}
    quantum_um = {table.name: table.quantum_um for table in planned if table.name not in held}
    return {
        curve.name: size_um
        for curve in fit.curves
        if curve.name in quantum_um
        and (size_um := rms(centred(curve.mean_um)))
        >= max(SURE_UM, quantum_um[curve.name], 2.0 * typical_u(curve))
    }
