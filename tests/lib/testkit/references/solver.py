"""What the solver is asked of its reference data: each call takes the input of a case and returns all that comes of it."""

import dataclasses

import numpy as np

from stepdiag.solver.methods.solve import solve
from stepdiag.solver.model.angles import parse_angles, render_angles
from stepdiag.solver.model.assumptions import Assumptions
from stepdiag.solver.model.lateral import MeasuredStraightness
from stepdiag.solver.model.straightness_file import parse_straightness
from stepdiag.solver.readings.readings import make_readings, parse_readings, render_readings
from stepdiag.solver.readings.rtl import parse_rtl, render_rtl, rtl_readings
from stepdiag.solver.result.json_tree import load_json
from stepdiag.solver.result.posterior import Posterior
from stepdiag.solver.result.result import Result, parse_result
from testkit.references import figures, refused


def joined(lines):
    """Return the text of a list of lines."""
    return "\n".join(lines) + "\n"


def assumptions(given):
    """Return assumptions from their JSON: what is left out stays as usual, a list is a tuple."""
    return Assumptions(**{name: tuple(value) if isinstance(value, list) else value for name, value in given.items()})


def straightness_of(given):
    """Return the head's passes from their JSON."""
    return [
        MeasuredStraightness(
            name=one["name"], position_mm=np.array(one["position_mm"]), value_um=np.array(one["value_um"]), u_um=np.array(one["u_um"]),
            approach=one["approach"],
        )
        for one in given
    ]  # fmt: skip


def solved(given):
    """Return the result of a survey from its JSON."""
    return solve(
        parse_readings(joined(given["readings"])),
        chain=given.get("chain", "FXYZ"),
        method=given.get("method", "estimate"),
        angles=parse_angles(joined(given["angles"])) if "angles" in given else None,
        straightness=straightness_of(given.get("straightness", ())),
        assumed=assumptions(given["assumed"]) if "assumed" in given else None,
        monte_carlo=given.get("monte_carlo", 0),
    )


def of_result(result: Result):
    """Return all of a result but its version; of the posterior what does not hang on how its modes are turned."""
    fields = {field.name: getattr(result, field.name) for field in dataclasses.fields(result)}
    del fields["software"]
    return fields | {"posterior": result.posterior and of_posterior(result.posterior)}


def of_posterior(posterior: Posterior):
    """Return offset, rest, sizes and the covariance of the machine: its diagonal, and its product with a fixed vector."""
    weight = iter(np.cos(np.arange(10_000.0)))
    modes = {name: np.asarray(values) for name, values in posterior.modes.items()}
    along = sum(values @ np.array([next(weight) for _ in range(values.shape[1])]) for values in modes.values())
    return {
        "position_mm": posterior.position_mm,
        "offset": posterior.offset,
        "rest_variance": {name: values**2 for name, values in posterior.rest.items()},  # a root of what is left would be of rounding alone
        "between_um": posterior.between_um,
        "count": posterior.count,
        "scale": np.sum(posterior.sized.scale**2, axis=0),
        "sized": posterior.sized.scale.shape,
        "variance": {name: np.sum(values**2, axis=0) for name, values in modes.items()},
        "covariance": {name: values.T @ along for name, values in modes.items()},
    }


def _tree(lines):
    return load_json(joined(lines), "tree.json").plain()


def _rtl(lines):
    file = parse_rtl(joined(lines), "file.rtl")
    rows, setup = rtl_readings(file, "", (0.0, 20.0, 30.0), "file.rtl")
    readings = make_readings(
        setup=[setup] * len(rows), pass_number=[row[0] for row in rows], stop=[row[1] for row in rows],
        position_mm=[row[2] for row in rows], reading_mm=[row[3] for row in rows],
    )  # fmt: skip
    return {"file": file, "axis": file.axis, "rows": rows, "again": render_rtl(readings, setup, {"Machine": "mill  1"}).splitlines()}


CALLS = {
    **figures.CALLS,
    "rtl": lambda given: [refused(_rtl, one) for one in given["texts"]],
    "solve": lambda given: of_result(solved(given)),
    "refused-surveys": lambda given: [refused(solved, one) for one in given["surveys"]],
    "readings": lambda given: [
        refused(lambda lines: render_readings(parse_readings(joined(lines))).splitlines(), one) for one in given["texts"]
    ],
    "angles": lambda given: [refused(lambda lines: render_angles(parse_angles(joined(lines))).splitlines(), one) for one in given["texts"]],
    "straightness": lambda given: [refused(lambda lines: parse_straightness(joined(lines)), one) for one in given["texts"]],
    "trees": lambda given: [refused(_tree, one) for one in given["texts"]],
    "results": lambda given: [refused(lambda lines: parse_result(joined(lines)).to_json().splitlines(), one) for one in given["texts"]],
}
