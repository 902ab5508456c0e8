"""The verdict on a function that has no table: would this control hold one, and does the result ask for it?"""

from collections.abc import Iterator, Mapping, Sequence

from stepdiag.base.errors import SafetyError, UsageError
from stepdiag.base.messages import message
from stepdiag.base.result.result import Result
from stepdiag.base.volume import rms
from stepdiag.exporters.safety.verdicts.curve import typical_u
from stepdiag.exporters.safety.verdicts.measures import SURE_UM, centred
from stepdiag.exporters.safety.verdicts.verdict import Judgement
from stepdiag.exporters.safety.verdicts.wanted import is_known
from stepdiag.exporters.tables.controller import Controller, Multiplying
from stepdiag.exporters.tables.curves import FOLD_DEFAULT, SQUARENESS_SLOPE, Curve
from stepdiag.exporters.tables.fit import fitted
from stepdiag.exporters.tables.profile import Profile
from stepdiag.exporters.tables.tables import Table


def judge_missing(result: Result, controller: Controller, new: Sequence[Table], profile: Profile) -> Iterator[Judgement]:
    """Yield a judgement for each function of the profile that the result asks for, that this control holds, and that ``new`` lacks.

    Files that correct nothing lack nothing: they take old tables out. Without a profile the files may hold each squareness in either of
    its two functions; the distribution counts that lacks least.
    """
    if not any(table.value_um.any() for table in new):
        return
    held = {table.name for table in new}
    folds = (FOLD_DEFAULT, _other_fold()) if profile.assumed else (profile.machine.squareness_into,)
    lacking = [[curve for curve in _asked(result, controller, profile, fold) if curve.name not in held] for fold in folds]
    for curve in min(lacking, key=len):
        size_um = rms(centred(curve.mean_um))
        text = (
            message("no-table-for-it", name=curve.name, size_um=size_um)
            if profile.assumed
            else message("no-table-though-asked", name=curve.name, size_um=size_um)
        )
        yield Judgement(function=curve.name, table=None, code="missing", words=text)


def _other_fold() -> Mapping[str, str]:
    return {name: next(one for one in slopes if one != FOLD_DEFAULT[name]) for name, slopes in SQUARENESS_SLOPE.items()}


def _asked(result: Result, controller: Controller, profile: Profile, fold: Mapping[str, str]) -> Iterator[Curve]:
    """Yield the curves of a profile that the result knows, that are more than rounding, and that the control has tables for."""
    known = [name for name in profile.machine.functions if is_known(result, name, fold)]
    fit = fitted(result, known, fold, profile.zone)
    try:
        if isinstance(controller, Multiplying):
            plan = controller.plan_products(fit.curves, fit.products, profile)
        else:
            plan = controller.plan(fit.curves, profile)
    except (SafetyError, UsageError):  # a profile whose tables cannot be made does not show what the control holds
        return
    planned = {table.name: table for table in plan.tables}
    for curve in fit.curves:
        table = planned.get(curve.name)
        if table is not None and rms(centred(curve.mean_um)) >= max(SURE_UM, table.quantum_um, 2.0 * typical_u(curve)):
            yield curve
