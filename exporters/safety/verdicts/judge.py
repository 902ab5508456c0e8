"""The verdict on every table of a set, and on every function without a table: the words for the
explanations of `regression`.
"""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import replace

from stepdiag.base.errors import SafetyError, UsageError
from stepdiag.base.messages import Message, message
from stepdiag.base.result.result import Result
from stepdiag.base.volume import rms
from stepdiag.exporters.safety.standing import Standing, acts_with, unchanged
from stepdiag.exporters.safety.verdicts.case import TableCase, centred, typical_u
from stepdiag.exporters.safety.verdicts.regression import SURE_UM, Explained, Fit, explain
from stepdiag.exporters.safety.verdicts.verdict import Code, Judgement
from stepdiag.exporters.safety.verdicts.wanted import Wanted, is_known
from stepdiag.exporters.tables.controller import Controller, Multiplying
from stepdiag.exporters.tables.curves import FOLD_DEFAULT, FOLD_OTHER, FUNCTIONS, Curve
from stepdiag.exporters.tables.fit import fitted
from stepdiag.exporters.tables.profile import Profile
from stepdiag.exporters.tables.tables import Table


def judge(
    result: Result, tables: Sequence[Table], standing: Standing, profile: Profile
) -> tuple[Judgement, ...]:
    """Return a judgement for every table, in their order: by the effect of all active tables in the
    control afterwards, old tables among them.

    Tables that act together (two directions, two kinds for a function) are judged by their sum. A
    table of a function outside the request that stays as before is "kept".
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
        or (
            _of_curve(case, wanted, turns.get(case.table.name, 0.0))
            if case.table.multiplier is None
            else _of_product(case, result)
        )
        for case in map(case_of, tables)
    ]
    # a control has zeros for functions outside the request, and zeros alone remove every
    # correction, as restore files do
    asked = profile.machine.functions if any(table.value_um.any() for table in tables) else ()
    return tuple(
        replace(each, code="empty")
        if each.code == "missing" and each.function not in asked
        else each
        for each in judged
    )


def _of_curve(case: TableCase, wanted: Wanted, turn_um_mm: float) -> Judgement:
    name = case.table.name
    own = [
        case.unstepped(curve)
        for curve in (wanted.as_slope(name) if case.is_slope else wanted.of(name))
    ]
    if not own:
        return _says(case, "unidentified", message("result-does-not-identify"))
    fits, mirrored = _fits(case, own), f"E{name[2]}{name[1]}"
    names = (mirrored, *(each for each in FUNCTIONS if each not in (name, mirrored)))
    found = explain(
        fits,
        _fits(case, own, turn_um_mm=turn_um_mm) if turn_um_mm else (),
        (
            (other, fit)
            for other in names
            if other != name
            for fit in _fits(case, wanted.of(other))
        ),
        ((shift, fit) for shift in case.shifts_mm() for fit in _fits(case, own, shift)),
    )
    first, last = case.table.position_mm[[0, -1]]
    if not fits and found.code == "unlike":
        low, high = case.travel_mm(case.table.input_axis)[[0, -1]]
        words = message(
            "to-mm-measured-travel", first_mm=first, last_mm=last, low_mm=low, high_mm=high
        )
        return _says(case, "beside-volume", words)
    if found.code == "axes-swapped" and found.fit is not None:
        turned = found.fit.left(-1.0) < found.fit.left()
        words = (
            message("this-table-with-opposite", name=found.other)
            if turned
            else message("this-table", name=found.other)
        )
        return _says(
            case, "input-output-swapped" if found.other == mirrored else found.code, words
        )
    if found.code == "beside-volume":
        words = message(
            "right-if-it-lay", shift_mm=found.shift_mm, first_mm=first, last_mm=last
        )
        return _says(case, found.code, words)
    if found.code == "unlike" and found.fit is not None:
        where = f"{case.table.input_axis} {case.place_mm(own[0], found.fit):g} mm"
        words = message("um-off-at-where", largest_um=found.fit.largest_um, where=where)
        return _says(case, found.code, words, found.fit)
    return _plainly(case, found)


def _of_product(case: TableCase, result: Result) -> Judgement:
    fit = case.fit_product(result)
    if fit is None:
        return _says(case, "right", message("lever-along-axis-itself"))
    if fit.moved_um < fit.sure_um:
        return _says(case, "empty", message("no-correction"))
    return _plainly(case, explain([fit]))


def _plainly(case: TableCase, found: Explained) -> Judgement:
    """Return the judgement of a verdict shown by a single regression on the table's own request."""
    code, fit = found.code, found.fit
    if fit is None:
        return _says(case, code, message("nothing-like-what-result"))
    if code == "right":
        return _says(case, code, message("what-result-asks-for"), fit)
    if code == "missing":
        return _says(case, code, message("no-correction-where-result", names_um=fit.size_um))
    if code == "sign-turned":
        return _says(case, code, message("right-shape-with-opposite"), factor=-1.0)
    factor = abs(fit.factor)
    words = (
        message("right-shape-times-as", factor=factor)
        if fit.factor < 0
        else message("right-shape-other-size", factor=factor)
    )
    return _says(case, code, words, factor=fit.factor)


def _says(
    case: TableCase,
    code: Code,
    words: Message,
    fit: Fit | None = None,
    factor: float | None = None,
) -> Judgement:
    """Return a judgement with the figures of a regression."""
    return Judgement(
        function=case.table.name,
        table=case.table,
        code=code,
        words=message("of-table", label=case.table.label, what=words),
        factor=factor if fit is None else fit.factor,
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
    """Return, for each two functions of a pair of axes with tables for both, the slopes in um/mm
    that are a turn of the workpiece.

    Old tables, levers and the choice of the function that holds a squareness move such a turn from
    calibration to calibration: the turn raises a function by as much as it lowers the other.
    """
    left = {
        case.table.name: case.slope_left_um_mm(curves[0])
        for case in cases
        if (curves := wanted.of(case.table.name))
    }
    pairs = [(name, f"E{name[2]}{name[1]}") for name in left if name[1] != name[2]]
    return {one: (left[one] - left[other]) / 2.0 for one, other in pairs if other in left}


def _settled(case: TableCase, standing: Standing, profile: Profile) -> Judgement | None:
    """Return the judgement of a table that needs no comparison: for another measuring system, of a
    function outside the request that moves the axis as before, or of zeros beside a table that
    makes the correction.
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
    """Yield a judgement for each function of the profile requested by the result, possible on this
    control, and missing in ``new``.

    Files without any correction lack no function: they remove old tables. Without a profile the
    files may hold each squareness in either of its two functions; the distribution with the fewest
    missing functions is used.
    """
    if not any(table.value_um.any() for table in new):
        return
    held = {table.name for table in new}
    folds = (
        (FOLD_DEFAULT, FOLD_OTHER) if profile.assumed else (profile.machine.squareness_into,)
    )
    lacking = (
        [
            curve
            for curve in _asked(result, controller, profile, fold)
            if curve.name not in held
        ]
        for fold in folds
    )
    for curve in min(lacking, key=len):
        name, size_um = curve.name, rms(centred(curve.mean_um))
        words = (
            message("no-table-for-it", name=name, size_um=size_um)
            if profile.assumed
            else message("no-table-though-asked", name=name, size_um=size_um)
        )
        yield Judgement(function=name, table=None, code="missing", words=words)


def _asked(
    result: Result, controller: Controller, profile: Profile, fold: Mapping[str, str]
) -> Iterator[Curve]:
    """Yield the curves of a profile that the result contains, that exceed rounding, and that have
    tables on the control.
    """
    known = [name for name in profile.machine.functions if is_known(result, name, fold)]
    fit = fitted(result, known, fold, profile.zone)
    try:
        if isinstance(controller, Multiplying):
            plan = controller.plan_products(fit.curves, fit.products, profile)
        else:
            plan = controller.plan(fit.curves, profile)
    except (SafetyError, UsageError):
        # a profile whose tables cannot be made does not show the contents of the control
        return
    planned = {table.name: table for table in plan.tables}
    for curve in fit.curves:
        table = planned.get(curve.name)
        if table is not None and rms(centred(curve.mean_um)) >= max(
            SURE_UM, table.quantum_um, 2.0 * typical_u(curve)
        ):
            yield curve
