"""Rules that say something of a survey, asked with recorded numbers from both sides of their
limits."""

from dataclasses import replace

import numpy as np

from stepdiag.base.conditions.assumptions import Assumptions
from stepdiag.base.csv_table import read_table
from stepdiag.base.findings import Finding
from stepdiag.base.messages import shortened
from stepdiag.base.readings.readings import parse_readings, render_readings
from stepdiag.base.readings.rtl import render_rtl, with_runs
from stepdiag.base.readings.runs import Pace, Plan, Run
from stepdiag.base.result.json_tree import Node
from stepdiag.base.result.members import CoverageFactor, HeadStraightness, SetupReport
from stepdiag.base.result.result import Function, Scale, same_result
from stepdiag.base.result.rounding import same_but_for_rounding, steady
from stepdiag.base.result.typed import read, written
from stepdiag.base.result.waves import arch_um, hiding_functions, shown_finer_um
from stepdiag.base.volume import Volume
from stepdiag.solver.adjustment.diagnostics import (
    scatter_findings,
    setup_findings,
    setup_reports,
)
from stepdiag.solver.fourdof.detector import DetectorAxis
from stepdiag.solver.fourdof.head import Head
from stepdiag.solver.linear.families import class_factors, likely_factors, normal_points
from stepdiag.solver.methods.coverage import coverage_findings, t_factor
from stepdiag.solver.methods.estimate import estimate
from stepdiag.solver.methods.head_report import head_findings
from stepdiag.solver.methods.lengths import lengths_report, temperature_findings, tool_report
from stepdiag.solver.methods.registry import Options
from stepdiag.solver.methods.volumetric import between_um, coarse_findings
from stepdiag.solver.model.angles import parse_angles
from stepdiag.solver.model.layout import lay_out
from stepdiag.solver.model.noise import assumed_noise
from stepdiag.solver.planning.circumstances import Circumstances
from stepdiag.solver.uncertainty.monte_carlo import shortest_interval
from testkit.references import refused


def assumptions(given):
    """Return assumptions from their JSON: what is left out stays as usual, a list is a tuple."""
    return Assumptions(
        **{
            name: tuple(value) if isinstance(value, list) else value
            for name, value in given.items()
        }
    )


def limits(given):
    """Return for every survey the findings where one figure of a report, or of the scatter, is
    another."""
    return [_limits(one, given) for one in given["surveys"]]


def _of_head(facts):
    """Return what the head measured of a function, of which only the misclosure, and the
    difference, matter."""
    zero = dict.fromkeys(
        (
            "passes",
            "end_point_um",
            "least_squares_um",
            "minimum_zone_um",
            "u_um",
            "residual_um",
        ),
        0,
    )
    facts = {
        name: {"position_mm": [], **value} if name == "difference_um" else value
        for name, value in facts.items()
    }
    return read(Node({**zero, **facts}, "head", ""), HeadStraightness)


def _changed(report, change):
    """Return the report of a setup with some members changed to what their JSON says."""
    changed = read(Node(change, "change", ""), SetupReport)
    return replace(report, **{name: getattr(changed, name) for name in change})


def _limits(survey, given):
    readings, angles = ("\n".join(survey[name]) + "\n" for name in ("readings", "angles"))
    found = estimate(
        lay_out(parse_readings(readings)), "FXYZ", angles=parse_angles(angles)
    ).adjustment
    changed = [
        {**setup_reports(found), "npp": _changed(setup_reports(found)["npp"], one)}
        for one in given["reports"]
    ]
    return {
        "reports": [setup_findings(found, one) for one in changed],
        "scatter": [scatter_findings(_scattering(found, **one)) for one in given["scatter"]],
    }


def _scattering(found, *, misses_um, noise_um, freedom):
    """Return an adjustment with another scatter: all axes alike, the noise of the first setup
    another."""
    noise = found.scatter.noise_um.copy()
    noise[0] = noise_um
    sizes = {"misses_um": np.full(4, misses_um), "freedom_misses": np.full(4, freedom)}
    return replace(
        found,
        scatter=replace(
            found.scatter,
            noise_um=noise,
            freedom_noise=np.full(len(noise), 3.0 * freedom),
            **sizes,
        ),
    )


def noise(given):
    """Return factors of coverage, and the shortest intervals of samples."""
    samples = np.array(given["samples"])
    return {
        "t": [t_factor(freedom) for freedom in given["freedom"]],
        "coverage": [
            coverage_findings(read(Node(one, "coverage", ""), dict[str, CoverageFactor]))
            for one in given["coverage"]
        ],
        "assumed": [assumed_noise(names) for names in given["classes"]],
        "intervals": [shortest_interval(samples, share) for share in given["shares"]],
        "normal": [normal_points(count) for count in given["points"]],
        "likely": likely_factors(),
        "class": class_factors(),
    }


def _function(one, unit="um"):
    value, u = one["value"], one["u_readings"]
    at = np.array(one["position_mm"])
    return Function(
        position_mm=at,
        value=None if value is None else np.array(value),
        u=np.full(len(at), 0.3),
        unit=unit,
        u_readings=None if u is None else np.full(len(at), u),
    )


def curves(given):
    """Return how far functions leave the curve through their values, and what is said of that."""
    machines = [
        {name: _function(one) for name, one in machine.items()}
        for machine in given["machines"]
    ]
    return {
        "arch_um": [
            [arch_um(np.array(value), noise_um) for noise_um in given["noise_um"]]
            for value in given["curves"]
        ],
        "between_um": [
            between_um(one, assumptions(given["assumed"][place % len(given["assumed"])]))
            for place, one in enumerate(machines)
        ],
        "shown_um": [shown_finer_um(machine) for machine in machines],
        "hiding": [hiding_functions(machine) for machine in machines],
        "findings": [coarse_findings(machine) for machine in machines],
    }


def warmth(given):
    """Return what is said of temperatures, lengths and the tool under every assumption."""
    told = []
    for assumed in map(assumptions, given["assumed"]):
        scales = [
            {
                axis: Scale(identified=one["value"] is not None, **one)
                for axis, one in some.items()
            }
            for some in given["scales"]
        ]
        functions = [
            {name: _angle(*columns) for name, columns in some.items()}
            for some in given["found"]
        ]
        told.append(
            {
                "findings": [
                    temperature_findings(np.array(some, dtype=float), assumed)
                    for some in given["temperature_c"]
                ],
                "lengths": [
                    written(lengths_report(some, assumed, known=known))
                    for some in scales
                    for known in (True, False)
                ],
                "tool": [
                    written(tool_report(some, other, assumed))
                    for some, other in (
                        (functions[0], functions[1]),
                        (functions[1], functions[2]),
                        (functions[2], {}),
                    )
                ],
                "u_grown_um_m": assumed.u_grown_um_m(),
                "json": written(assumed.stated()),
            }
        )
    return told


def _angle(value, u):
    known = None if value is None else np.array(value)
    return Function(
        position_mm=np.array([0.0, 1.0]),
        value=known,
        u=None if u is None else np.array(u),
        unit="urad",
    )


def _table(rows):
    return parse_readings(
        "\n".join(["setup,pass,stop,x_mm,y_mm,z_mm,reading_mm,u_um", *rows]) + "\n"
    )


def _added(given, runs):
    """Return readings with runs added, as they are written."""
    parts = [
        (
            setup,
            [
                (number, stop, tuple(position), reading)
                for number, stop, position, reading in rows
            ],
        )
        for setup, rows in runs
    ]
    return render_readings(with_runs(_table(given["box"]), parts, "x.rtl")).splitlines()


def _written(given, rows):
    return render_rtl(
        _table([*given["box"], *rows]), "linear-x", {"Name": " a  b "}
    ).splitlines()


def defaults():
    """Return what holds where nobody says anything else."""
    curve = DetectorAxis()
    return {
        "assumptions": Assumptions(),
        "pace": Pace(),
        "head": Head(
            psd1_focal_length_mm=300.0, psd2_focal_length_mm=300.0, dead_path_mm=30.0
        ),
        "axis": [curve, curve.curve.shift_um(0.5)],
        "circumstances": {
            name: getattr(Circumstances(), name)
            for name in ("chain", "head_u_urad", "shift_mm")
        },
        "setup": Run(setup="ppp"),
        "options": {
            name: getattr(Options(chain="FXYZ"), name) for name in ("straightness", "trials")
        },
    }


def words(given):
    """Return numbers, texts and remarks as they are written."""
    volume = Volume(origin_mm=(0.0, 0.0, 0.0), size_mm=(1.0, 1.0, 1.0), increments=1)
    plans = [
        Plan(volume=volume, runs=()).with_runs(*(Run(setup=name) for name in names))
        for names in given["runs"]
    ]
    return {
        "steady": [steady(*one) for one in given["steady"]],
        "same": [same_but_for_rounding(*one) for one in given["same"]],
        "results": [
            same_result(one.encode(), other.encode()) for one, other in given["results"]
        ],
        "defaults": defaults(),
        "added": [refused(lambda runs: _added(given, runs), one) for one in given["added"]],
        "written": [
            refused(lambda one: _written(given, one), one) for one in given["written"]
        ],
        "tables": [
            refused(lambda one: read_table(one[0], "t.csv", ("a",), most_rows=one[1]), one)
            for one in given["tables"]
        ],
        "long": [shortened(*one) for one in given["long"]],
        "findings": [
            Finding(
                **{
                    name: tuple(value) if isinstance(value, list) else value
                    for name, value in one.items()
                }
            ).as_json()
            for one in given["findings"]
        ],
        "runs": [[run.setup for run in plan.runs] for plan in plans],
        "head": [
            head_findings({name: _of_head(facts) for name, facts in one.items()})
            for one in given["head"]
        ],
    }


CALLS = {function.__name__: function for function in (limits, noise, curves, warmth, words)}
