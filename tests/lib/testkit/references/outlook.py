"""What stands on a result: fields, predictions, stretches and notes; and surveys that were not
driven yet."""

import numpy as np

from stepdiag.base.conditions.assumptions import Assumptions
from stepdiag.base.names import BODY_DIAGONALS
from stepdiag.base.readings.runs import Plan, Run, run_minutes, run_stops_mm, setup_minutes
from stepdiag.base.result.basis import basis_of, scales_in_words
from stepdiag.base.result.field import (
    along_diagonal_um,
    bend_um,
    error_field_um,
    without_rigid_motion,
)
from stepdiag.base.result.prediction import predicted, predicted_with_u, squares_um2
from stepdiag.base.result.result import Result
from stepdiag.base.result.stretches import harmed
from stepdiag.base.result.typed import written
from stepdiag.base.volume import Volume, anywhere_mm
from stepdiag.solver.planning.circumstances import Circumstances
from stepdiag.solver.planning.planner import Forecast, forecast, plan
from testkit.references import plain, refused

EVERY = slice(None, None, 7)
SHARES = (0.0, 0.5, 1.0, -0.4)


def of_volume(result: Result):
    """Return what is told of a result's volume, before and after corrections by shares of its own
    field and by others."""
    points = anywhere_mm(result.volume)[EVERY]
    field = error_field_um(result, points)
    beside = 0.3 * np.sin(points / 17.0)
    along = (points - result.volume.origin_mm) / result.volume.size_mm
    wrong = 9.0 * np.sin(7.0 * along[:, [1, 2, 0]]) * (along[:, [1, 2, 0]] > 0.4)
    length = float(np.linalg.norm(result.volume.size_mm))
    return {
        "points_mm": [len(points), *points[::40].tolist()],
        "field_um": field[:12],
        "bend_um": bend_um(result, points)[:12],
        "free_um": without_rigid_motion(result.volume, points, field)[:12],
        "beyond_um": error_field_um(result, points[:6] + np.array([400.0, -400.0, 0.5])),
        "predicted": [written(predicted(result, points, -share * field)) for share in SHARES],
        "beside": written(predicted(result, points, -field, beside)),
        "with_u": predicted_with_u(result, result.posterior, points, -field),
        "squares_um2": [
            np.mean(each, axis=1)[::25]
            for each in squares_um2(result, points, -field, beside)
        ],
        "harmed": [
            [plain(one) | {"times": one.times} for one in harmed(result, points, change)]
            for change in (wrong, wrong - field, 2.5 * field)
        ],
        "harmed_beside": plain(harmed(result, points, -0.7 * field, beside)),
        "diagonals": {
            name: along_diagonal_um(result, name, np.array([0.0, 0.2, 0.5, 1.0]) * length)
            for name in BODY_DIAGONALS
        },
        "refused": [
            refused(lambda one: along_diagonal_um(result, one[0], np.array(one[1])), one)
            for one in (
                ["ppp", [0.0, length + 1.1]],
                ["ppp", [-1.1, 1.0]],
                ["xpp", [0.0]],
                ["npp", [-0.9, length + 0.9]],
            )
        ],
        **of_words(result),
    }


def of_words(result: Result):
    """Return what a result says of its basis."""
    basis = basis_of(result)
    unseen = [*(result.unseen_slip or ())]
    return {
        "basis": basis,
        "beside_lengths": basis.beside,
        "scales": [scales_in_words(one) for one in (basis.scales, basis.other)],
        "unseen": unseen,
        "places": [f"{each.setup}/{each.pass_number}/{each.stop}" for each in unseen],
    }


def _plan(given):
    volume = Volume(
        origin_mm=(10.0, -20.0, 0.0),
        size_mm=tuple(given["size_mm"]),
        increments=given["increments"],
    )
    runs = tuple(
        Run(
            **{
                name: tuple(value) if isinstance(value, list) else value
                for name, value in run.items()
            }
        )
        for run in given["runs"]
    )
    return Plan(volume=volume, runs=runs, axis_order=given.get("axis_order", "xyz"))


def _told(found: Forecast):
    ahead = found.ahead
    return {
        "minutes": found.minutes,
        "u": found.u,
        "volumetric_um": found.volumetric_um,
        "left_um": found.left_um,
        "hidden": found.hidden,
        "resolved": list(found.resolved),
        "angles": found.angles,
        "assumed": found.assumed.angle_urad,
        "unseen": ahead.unseen,
        "hides": str(ahead.hides()),
    }


def _forecast(given):
    about = Circumstances(
        assumed=Assumptions(**given.get("assumed", {})),
        chain=given.get("chain", "FXYZ"),
        **given.get("about", {}),
    )
    survey = _plan(given)
    told = _told(forecast(survey, about)) | {
        "runs_min": [
            [run_minutes(survey, run), setup_minutes(survey, run)] for run in survey.runs
        ],
        "stops_mm": [run_stops_mm(survey, run)[:5] for run in survey.runs],
    }
    if "asked" in given:
        advice = plan(survey, about, **given["asked"])
        told["front"] = [_chosen(one) for one in advice.front]
        told["best"] = advice.best and _chosen(advice.best)
    return told


def _chosen(found: Forecast):
    return [
        [[run.setup, run.repeats, run.return_pass] for run in found.plan.runs],
        found.minutes,
        found.left_um,
    ]


def forecasts(given):
    """Return forecasts of plans, or their refusals."""
    return [refused(_forecast, one) for one in given["plans"]]


CALLS = {"forecasts": forecasts}
