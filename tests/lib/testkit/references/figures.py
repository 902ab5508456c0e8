"""The solver's functions of plain arrays, asked with recorded numbers: one call a room."""

import numpy as np

from stepdiag.base.conditions.air import (
    Air,
    AirUncertainty,
    Done,
    ciddor_index,
    displacement_mm,
    edlen_index,
    index_u,
    refractive_index,
    saturation_pressure_pa,
)
from stepdiag.base.conditions.expansion import expansion_um, reading_at_20_c_mm
from stepdiag.base.kinematics import abbe_mask, cross_matrix, parse_chain
from stepdiag.base.names import BODY_DIAGONALS, LINEAR_RUNS
from stepdiag.base.readings.runs import Plan, Run, run_stops_mm
from stepdiag.base.result.interval import Interval
from stepdiag.base.result.json_tree import Node
from stepdiag.base.result.typed import read_or_none, written
from stepdiag.base.setups import SETUP_NAMES, setup_of
from stepdiag.base.volume import (
    Volume,
    anywhere_mm,
    diagonal_direction,
    reads_like_metres,
)
from stepdiag.solver.fourdof.axes import Mount, axis_errors
from stepdiag.solver.fourdof.commissioning import fit_curve
from stepdiag.solver.fourdof.detector import Curve, Detector, DetectorAxis, inverse_erf, spots
from stepdiag.solver.fourdof.drift import slow_drift
from stepdiag.solver.fourdof.head import Crosstalk, Head, motion
from stepdiag.solver.fourdof.statistics import compare, stability
from stepdiag.solver.standards.iso230 import (
    COVERAGES,
    PositioningRuns,
    arrange_runs,
    diagonal_figures,
    positioning_figures,
    vdi_3441_figures,
)
from stepdiag.solver.standards.iso230_uncertainty import RunSources, expanded_um
from stepdiag.solver.standards.straightness import (
    reference_line,
    residuals_um,
    straightness_um,
)
from testkit.references import plain, refused

METHODS = ("end-point", "least-squares", "minimum-zone")


def arrays(given):
    """Return a mapping with its lists as arrays; "nan" is no number."""
    return {
        name: np.array(value, dtype=float) if isinstance(value, list) else value
        for name, value in given.items()
    }


def air(given):
    """Return what is said of every air, one by one: a sensor that cannot be right is refused."""
    return [refused(_of_air, one) for one in given["air"]]


def _of_air(one):
    of = Air(
        temperature_c=one["temperature_c"],
        pressure_hpa=one["pressure_hpa"],
        humidity_percent=one["humidity_percent"],
    )
    u = AirUncertainty(temperature_c=0.2, pressure_hpa=0.7, humidity_percent=4.0)
    index = edlen_index(of, one["wavelength_nm"])
    wave_nm = {
        name: one["wavelength_nm"] / refractive_index(of, one["wavelength_nm"], name)
        for name in ("edlen", "ciddor")
    }
    lengths = {
        str(done.value): 1e6
        * (
            displacement_mm(800.0, index, zero_index=1.00027, dead_path_mm=350.0, done=done)
            - 800.0
        )
        for done in (
            Done.NOTHING,
            Done.WAVELENGTH,
            Done.DEAD_PATH,
            Done.EXPANSION,
            Done.WAVELENGTH | Done.DEAD_PATH,
        )
    }
    return {
        "saturation_pa": saturation_pressure_pa(one["temperature_c"]),
        "edlen_1e9": 1e9 * (index - 1),
        "ciddor_1e9": [
            1e9 * (ciddor_index(of, one["wavelength_nm"], co2) - 1)
            for co2 in (350.0, 450.0, 600.0)
        ],
        "shorter_pm": {
            name: 1e3 * (one["wavelength_nm"] - each) for name, each in wave_nm.items()
        },
        "index_u_1e9": 1e9 * index_u(of, one["wavelength_nm"], u),
        "longer_nm": lengths,
    }


def expansion(given):
    """Return expansions and the readings at 20 C, with and without the instrument's own."""
    found = expansion_um(**arrays(given["moved"]))
    return {
        "expansion_um": found,
        "at_20_c": {
            str(done.value): reading_at_20_c_mm(given["reading_mm"], found, done)
            for done in (Done.NOTHING, Done.EXPANSION)
        },
    }


def positioning(given):
    """Return the figures of every table by every standard, with their uncertainty, and those of a
    diagonal test of all of them."""
    found = [refused(_of_runs, one) for one in given["tables"]]
    good = {
        f"table {k}": _runs(one)
        for k, one in enumerate(given["tables"])
        if "refusal" not in found[k]
    }
    return {
        "tables": found,
        "diagonals": plain(diagonal_figures(good)),
        "two": plain(diagonal_figures(dict([*good.items()][:2]))),
    }


def _runs(one):
    down = one.get("down_um")
    return PositioningRuns(
        target_mm=np.array(one["target_mm"]),
        up_um=np.array(one["up_um"]),
        down_um=None if down is None else np.array(down),
    )


def _of_runs(one):
    runs = _runs(one)
    by = {name: positioning_figures(runs, name) for name in COVERAGES}
    count = (
        runs.up_um.shape[1],
        runs.up_um.shape[1] if runs.down_um is None else runs.down_um.shape[1],
    )
    sources = RunSources(relative=1.3e-6, reading_um=0.21, environment_um=0.17)
    return {
        "figures": by,
        "numbers": by["iso-230-2"].numbers(),
        "expanded_um": expanded_um(
            by["iso-230-2"].numbers(), 870.0, count, len(runs.target_mm), sources
        ),
        "vdi": refused(vdi_3441_figures, runs),
    }


def arranged(given):
    """Return rows as tables of runs, with one zero for all passes and with one a pass."""
    return [
        refused(lambda each, common=common: arrange_runs(**each, common_zero=common), one)
        for one in given["rows"]
        for common in (True, False)
    ]


def lines(given):
    """Return lines, residuals and range by every method, or the refusal."""
    return [
        refused(
            lambda each, method=method: {
                "line": reference_line(**each, method=method),
                "residuals_um": residuals_um(**each, method=method),
                "range_um": straightness_um(**each, method=method),
            },
            arrays(one),
        )
        for one in given["runs"]
        for method in METHODS
    ]


def head(given):
    """Return the motion that a head shows, with and without times, and the errors of the axis for
    every mount."""
    about = given["head"]
    detectors = {
        name: Detector(
            x=_axis(one["x"]),
            y=_axis(one["y"]),
            sum_min=0.5,
            sum_max=9.0,
            rotation_mrad=one["rotation_mrad"],
        )
        for name, one in about["detectors"].items()
    }
    of = Head(
        **detectors,
        **about["lengths"],
        crosstalk=Crosstalk(
            **{
                k: tuple(v) if isinstance(v, list) else v
                for k, v in about["crosstalk"].items()
            }
        ),
    )
    channels, travel = np.array(given["channels"], dtype=float), np.array(given["travel_mm"])
    still = motion(channels, travel, of, np.array(given["roll_urad"]))
    timed = motion(
        channels,
        travel,
        of,
        time_s=np.array(given["time_s"]),
        u_psd1_urad=np.array(given["u_psd1_urad"]),
    )
    edges = np.array(given["edges"])
    seen = {
        name: spots(detector, edges[:, :2], edges[:, 2])
        for name, detector in detectors.items()
    }
    return {
        "spots": seen,
        "still": still,
        "timed": timed,
        "quiet": motion(channels, travel, of, 7.0, time_s=np.array(given["time_s"])),
    }


def _axis(given):
    curve = given["curve"]
    return DetectorAxis(
        sign=given["sign"],
        curve=Curve(**{**curve, "coefficients_um": tuple(curve["coefficients_um"])}),
    )


def mounts(given):
    """Return the errors of an axis for every mount, or its refusal."""
    return [refused(lambda mount: _of_mount(mount, given), one) for one in given["mounts"]]


def _of_mount(mount, given):
    seen = {
        name: np.array(given[name])
        for name in ("position_mm", "straightness_um", "angle_urad")
    }
    return {"errors": axis_errors(**seen, mount=Mount(**mount["mount"]), line=mount["line"])}


def commissioning(given):
    """Return curves, or their refusals."""
    return {
        "curves": [refused(lambda each: fit_curve(**each), one) for one in given["curves"]],
        "erf": inverse_erf(np.array(given["erf"])),
    }


def drifts(given):
    """Return drifts freed of their noise."""
    return [plain(slow_drift(**arrays(one))) for one in given["runs"]]


def statistics(given):
    """Return stability figures and comparisons, or their refusals."""
    return {
        "stability": [
            refused(lambda one: stability(**arrays(one)), each) for each in given["series"]
        ],
        "comparisons": [
            refused(lambda one: compare(**one), each) for each in given["comparisons"]
        ],
    }


def intervals(given):
    """Return how every figure is written."""
    found = [read_or_none(Node(one, "figure", ""), Interval) for one in given["figures"]]
    return [
        one
        and {
            "shown": one.shown(),
            "best": one.best(),
            "words": str(one.words()),
            "bound": str(one.bound()),
            "is": written(one),
        }
        for one in found
    ] + [plain(str(Interval(value_um=value).words())) for value in (0.0, 9.94, 9.96)]


def geometry(given):
    """Return what names of setups and chains mean, and where the stops of a volume are."""
    volume = Volume(
        origin_mm=tuple(given["origin_mm"]),
        size_mm=tuple(given["size_mm"]),
        increments=given["increments"],
    )
    return {
        "setups": [
            refused(
                lambda name: {"setup": setup_of(name), "order": setup_of(name).order}, name
            )
            for name in given["setups"]
        ],
        "names": list(SETUP_NAMES),
        "chains": [
            refused(lambda text: {"chain": parse_chain(text), "mask": abbe_mask(text)}, text)
            for text in given["chains"]
        ],
        "cross": cross_matrix(np.array([[1.0, 2.0, 4.0]])),
        "nodes": {
            f"{name} {order}": _nodes(volume, _stops_mm(volume, name, order))
            for name in BODY_DIAGONALS
            for order in ("xyz", "zxy")
        },
        "stops_mm": {name: _stops_mm(volume, name) for name in BODY_DIAGONALS},
        "linear_mm": {name: _stops_mm(volume, name) for name in LINEAR_RUNS},
        "directions": {name: diagonal_direction(volume, name) for name in BODY_DIAGONALS},
        "step_mm": volume.step_mm,
        "anywhere_mm": anywhere_mm(volume)[::97],
        "metres": [reads_like_metres(size) for size in given["sizes"]],
    }


def _stops_mm(volume, setup, order="xyz"):
    run = Run(setup=setup)
    return run_stops_mm(Plan(volume=volume, runs=(run,), axis_order=order), run)


def _nodes(volume, stops_mm):
    steps = (stops_mm - np.array(volume.origin_mm)) / np.array(volume.step_mm)
    return np.rint(steps).astype(np.int64)


CALLS = {
    function.__name__: function
    for function in (
        air,
        expansion,
        positioning,
        arranged,
        lines,
        head,
        mounts,
        commissioning,
        drifts,
        statistics,
        intervals,
        geometry,
    )
}
