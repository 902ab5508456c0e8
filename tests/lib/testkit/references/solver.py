"""What the solver is asked of its reference data: each call takes the input of a case and returns
all that comes of it."""

import dataclasses
import json

import numpy as np

from stepdiag.base.readings.readings import make_readings, parse_readings, render_readings
from stepdiag.base.readings.rtl import parse_rtl, render_rtl, rtl_readings
from stepdiag.base.result.posterior import Posterior
from stepdiag.base.result.result import MEMBERS, Function, Result, parse_result
from stepdiag.base.result.typed import written
from stepdiag.solver.methods.solve import solve
from stepdiag.solver.model.angles import parse_angles, render_angles
from stepdiag.solver.model.lateral import MeasuredStraightness
from stepdiag.solver.model.layout import lay_out
from stepdiag.solver.model.straightness_file import parse_straightness, render_straightness
from testkit.references import figures, outlook, plain, refused, rules

WORDS = frozenset({"standard", "source_status", "U_status"})
"""Members of a result that hold sentences."""


def joined(lines):
    """Return the text of a list of lines."""
    return "\n".join(lines) + "\n"


def straightness_of(given):
    """Return the head's passes from their JSON."""
    return [
        MeasuredStraightness(
            name=one["name"],
            position_mm=np.array(one["position_mm"]),
            value_um=np.array(one["value_um"]),
            u_um=np.array(one["u_um"]),
            approach=one["approach"],
        )
        for one in given
    ]


def solved(given):
    """Return the result of a survey from its JSON."""
    return solve(
        parse_readings(joined(given["readings"])),
        chain=given.get("chain", "FXYZ"),
        method=given.get("method", "estimate"),
        angles=parse_angles(joined(given["angles"])) if "angles" in given else None,
        straightness=straightness_of(given.get("straightness", ())),
        assumed=rules.assumptions(given["assumed"]) if "assumed" in given else None,
        monte_carlo=given.get("monte_carlo", 0),
    )


def of_result(result: Result, brief=False):
    """Return all of a result but its version; of the posterior what does not hang on how its modes
    are turned.

    ``brief`` leaves out what most surveys say alike: the budget's shares, the standards' figures
    and what was assumed.
    """
    fields = {field.name: getattr(result, field.name) for field in dataclasses.fields(result)}
    del fields["software"]
    for part in ("errors", "expected", "reversal"):
        fields[part] = {
            name: _function(one, name, result) for name, one in fields[part].items()
        }
    extra = {
        name: written(value) for name in MEMBERS if (value := fields.pop(name)) is not None
    }
    if brief:
        extra = {
            name: value
            for name, value in extra.items()
            if name not in ("standards", "assumed")
        }
    if "budget" in extra:
        shares = _table(extra["budget"]["shares"])
        extra["budget"] = (
            {"combined": extra["budget"]["combined"]}
            if brief
            else extra["budget"] | {"shares": shares}
        )
    fields["setups"] = written(result.setups)
    return shorter(
        plain(
            fields
            | {
                "extra": without_words(extra),
                "posterior": result.posterior and of_posterior(result.posterior),
            }
        )
    )


def without_words(tree):
    """Return a tree without the sentences that a result carries for people: what was assumed stays
    by name."""
    if isinstance(tree, dict):
        return {
            name: sorted(item) if name == "assumptions" else without_words(item)
            for name, item in tree.items()
            if name not in WORDS
        }
    return [without_words(item) for item in tree] if isinstance(tree, list | tuple) else tree


def _function(function: Function, name, result: Result):
    """Return a function's columns, and its positions, unit and slope where they are not those of
    every function."""
    nodes, unit = (
        result.volume.nodes_mm("XYZ".index(name[2])),
        "um" if name[1] in "XYZ" else "urad",
    )
    same = len(nodes) == len(function.position_mm) and np.allclose(
        nodes, function.position_mm, rtol=0, atol=1e-9
    )
    usual = {"unit": unit, "slope_identified": True} | ({"position_mm": None} if same else {})
    told = {
        field.name: getattr(function, field.name) for field in dataclasses.fields(function)
    }
    return {
        key: value
        for key, value in told.items()
        if key not in usual or (usual[key] is not None and value != usual[key])
    }


def _of_survey(given, result: Result):
    further = {}
    if given.get("outlook"):
        text = result.to_json()
        further = (outlook.of_words if given["outlook"] == "words" else outlook.of_volume)(
            result
        ) | {"again": parse_result(text).to_json() == text}
    return of_result(result, given.get("brief", False)) | shorter(plain(further))


def _table(shares):
    """Return shares by name and source as one row of numbers a name: they are half of a result
    otherwise."""
    sources = list(dict.fromkeys(source for row in shares.values() for source in row))
    # the share of the unknown sizes is a root of what is left of a sum: what it is below a
    # micrometre in a thousand is rounding
    return {"sources": " | ".join(sources)} | {
        name: [np.round(row.get(source, 0.0), 6) for source in sources]
        for name, row in shares.items()
    }


def shorter(tree):
    """Return a tree with numbers of eight digits, a twentieth of the tolerance: a survey has
    many."""
    if isinstance(tree, dict):
        return {name: shorter(item) for name, item in tree.items()}
    if isinstance(tree, list):
        return [shorter(item) for item in tree]
    return float(f"{tree:.8g}") + 0.0 if isinstance(tree, float) else tree


def of_posterior(posterior: Posterior):
    """Return offset, rest, sizes and the covariance of the machine: its diagonal, and its product
    with a fixed vector."""
    weight = iter(np.cos(np.arange(10_000.0)))
    modes = {name: np.asarray(values) for name, values in posterior.modes.items()}
    along = sum(
        values @ np.array([next(weight) for _ in range(values.shape[1])])
        for values in modes.values()
    )
    return {
        "position_mm": posterior.position_mm,
        "offset": posterior.offset,
        "rest_variance": {
            name: values**2 for name, values in posterior.rest.items()
        },  # a root of what is left would be of rounding alone
        "between_um": {
            name: [np.sum(sizes**2), sizes @ np.cos(np.arange(len(sizes)))]
            for name, sizes in posterior.between_um.items()
        },
        "count": posterior.count,
        "scale": np.sum(posterior.sized.scale**2, axis=0),
        "sized": posterior.sized.scale.shape,
        "variance": {name: np.sum(values**2, axis=0) for name, values in modes.items()},
        "covariance": {name: values.T @ along for name, values in modes.items()},
    }


def _straightness(lines):
    found = parse_straightness(joined(lines))
    return {"found": found, "again": render_straightness(found).splitlines()}


def _rtl(given, change):
    """Return what a file says in which lines were changed by number: None leaves one out, a list
    puts several there."""
    lines = []
    for number, line in enumerate(given["base"]):
        new = change.get(str(number), line)
        lines += new if isinstance(new, list) else [] if new is None else [new]
    file = parse_rtl(joined(lines), "file.rtl")
    rows, setup = rtl_readings(file, "", (0.0, 20.0, 30.0), "file.rtl")
    readings = make_readings(
        setup=[setup] * len(rows),
        pass_number=[row[0] for row in rows],
        stop=[row[1] for row in rows],
        position_mm=[row[2] for row in rows],
        reading_mm=[row[3] for row in rows],
    )
    told = {
        "targets_mm": file.targets_mm,
        "deviations_um": file.deviations_um,
        "both_ways": file.both_ways,
        "axis": file.axis,
    }
    return told | {
        "rows": [str(row) for row in rows],
        "again": "|".join(
            render_rtl(readings, setup, {"Machine": "mill  1"}).splitlines()[7:]
        ),
    }


def _changed_result(given):
    """Return what is read of a result and of each change of it: a path (a name of its own at the
    end) and what stands there."""
    text = joined(given["result"])
    told = [_as_read(json.loads(text), change) for change in given["changes"]]
    now = parse_result(text).to_json()
    return {
        "changes": told,
        "again": parse_result(now).to_json() == now,
        "words": outlook.of_words(parse_result(text)),
    }


def _as_read(document, change):
    path, *value = change
    *above, name = path.split(".")
    part = document
    for step in above:
        part = part[step]
    part.pop(name, None)
    if value:
        part[name] = value[0]
    return refused(
        lambda text: _what_changed(parse_result(text, "r.json"), path), json.dumps(document)
    )


def _what_changed(result: Result, path):
    """Return what stands in a result at the path that was changed, as it is written again."""
    part = json.loads(result.to_json())
    for step in path.split("."):
        part = part.get(step, "(nothing)") if isinstance(part, dict) else "(nothing)"
    return part


def _changed_survey(given, change):
    """Return what comes of a survey of which some rows, or what is told beside them, are others;
    where only rows are, of its layout."""
    base = given[change.get("of", "base")]
    told = {
        name: value
        for name, value in change.items()
        if name not in ("of", "rows", "at_20_c", "zero", "solve")
    }
    rows = change.get("rows", {})
    lines = [rows.get(str(number), line) for number, line in enumerate(base["readings"])]
    lines = [line for line in lines if line is not None]
    if "at_20_c" in change:
        lines = [
            f"{line},{'at_20_c' if not number else int(number in change['at_20_c'])}"
            for number, line in enumerate(lines)
        ]
    if not (told or "at_20_c" in change or "solve" in change):
        layout = lay_out(parse_readings(joined(lines)))
        return {
            "volume": layout.volume,
            "readings": len(layout),
            "sum_um": np.sum(layout.deviation_um),
            "findings": layout.findings,
        }
    if "zero" in change:
        lines = [
            f"{line},{'zero' if not number else 1 + int(number in change['zero'])}"
            for number, line in enumerate(lines)
        ]
    result = solved({**base, **told, "readings": lines})
    return {
        "codes": " ".join(one.code for one in result.findings),
        "fit": written(result.fit),
    }


CALLS = {
    **figures.CALLS,
    "rtl": lambda given: [
        refused(lambda change: _rtl(given, change), one) for one in given["changes"]
    ],
    **outlook.CALLS,
    **rules.CALLS,
    "solve": lambda given: _of_survey(given, solved(given)),
    "refused-surveys": lambda given: [
        refused(lambda change: _changed_survey(given, change), one)
        for one in given["changes"]
    ],
    "readings": lambda given: [
        refused(
            lambda lines: render_readings(parse_readings(joined(lines))).splitlines(), one
        )
        for one in given["texts"]
    ],
    "angles": lambda given: [
        refused(lambda lines: render_angles(parse_angles(joined(lines))).splitlines(), one)
        for one in given["texts"]
    ],
    "straightness": lambda given: [refused(_straightness, one) for one in given["texts"]],
    "results": _changed_result,
}
