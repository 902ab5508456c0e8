"""The state of every setup and the agreement of the readings."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from stepdiag.base.findings import Finding, error, finding, warning
from stepdiag.base.messages import Place, message
from stepdiag.base.names import BODY_DIAGONALS
from stepdiag.base.result.members import Closure, Drift, SetupReport, triple
from stepdiag.base.setups import Setup
from stepdiag.base.volume import Vector
from stepdiag.solver.adjustment.adjustment import Adjustment
from stepdiag.solver.adjustment.evidence import HIDDEN, response_of
from stepdiag.solver.adjustment.explanations import along_the_way_m
from stepdiag.solver.adjustment.scatter import FIRST, Scatter, separated
from stepdiag.solver.linear.rows import Rows
from stepdiag.solver.model.effects import BESIDE, GROWTH, TURNING, growth_waves
from stepdiag.solver.model.layout import Layout
from stepdiag.solver.model.noise import LEAST_FREEDOM
from stepdiag.solver.model.vector import closure_um, diagonal_data

TILT_LIMIT_MRAD = 2.0
"""Mirror tilt above which the mirror must be realigned: the beam leaves the detector, and
second-order terms are micrometres."""
DRIFT_LIMIT_UM = 2.0
"""Drift of an out-and-back pair above which it is reported; the drift of a warm machine is
smaller."""
IN_TIME = ("drift", "wander", "wandering pass")
"""Random effects that change a count during a pass."""
NOISE_LIMIT_UM = 1.0
"""Standard uncertainty of a reading above which it is reported."""
FAR_NOISE = 10.0
"""Multiple of `NOISE_LIMIT_UM` above which an export is refused."""
REPEATS_UM = 5.0
"""Largest possible repeatability: three times that of a worn machine. A larger value means that
a mirror or a beam has moved."""
TOO_LOW = 2.0
"""Ratio of the scatter to the stated uncertainty above which the stated uncertainty is too
small. An excess of 20 % can be chance."""
GREW_UM_M, GREW_SURE = 5.0, 3.0
"""Growth in um/m and in standard uncertainties above which it is reported: half a kelvin of
steel."""
MISCLOSED, MISCLOSED_FAR = 2.0, 3.5
"""Number of standard uncertainties of a scale misclosure above which it is reported (2.0), and
above which an export is refused (3.5). Of 200 good surveys of ordinary machines two were
reported and none was refused."""


def travel_report(layout: Layout, setup: Setup) -> SetupReport:
    return SetupReport(
        kind=setup.kind,
        passes=tuple(key.number for key in layout.passes if key.setup == setup.name),
        stops=int(np.count_nonzero(layout.setup_index == layout.setups.index(setup))),
    )


def setup_reports(found: Adjustment) -> dict[str, SetupReport]:
    """Return for each setup: kind, passes, stops, mirror tilt (mrad), drift, repeatability and
    residuals (um)."""
    layout, repaired_um = found.layout, found.repaired_um
    place = layout.target_index
    reports: dict[str, SetupReport] = {}
    for index, setup in enumerate(layout.setups):
        used = (layout.setup_index == index) & np.isfinite(found.u_um)
        tilt = found.tilt_mrad[index] if setup.kind in ("step", "face") else None
        reports[setup.name] = replace(
            travel_report(layout, setup),
            tilt_mrad=None if tilt is None else float(np.linalg.norm(tilt)),
            tilt_xyz_mrad=None if tilt is None else triple(tilt),
            drift=_drifts(found, setup.name),
            repeatability_um=_repeatability_um(layout, place, repaired_um, setup.name),
            residual_um=float(np.sqrt(np.mean(found.residual_um[used] ** 2)))
            if used.any()
            else None,
            noise_um=float(np.sqrt(np.mean(found.u_um[used] ** 2))) if used.any() else None,
            redundancy=float(np.sum(found.fit.redundancy[: len(layout)][used])),
        )
    return reports


def _drifts(found: Adjustment, setup: str) -> tuple[Drift, ...]:
    """Return the drift of the count in every out-and-back pair where the readings identify the
    linear drift. The drift is the linear drift plus the random effects in `IN_TIME`."""
    columns, fit = found.design.columns, found.fit
    drifts: list[Drift] = []
    for index, (name, pair, timed) in enumerate(found.design.drift_pairs):
        column = columns.drift + index
        alone = Rows(np.array([[column]]), np.ones((1, 1)), columns.count)
        if name != setup or not fit.inverse.sees(alone)[0]:
            continue
        mine = [
            place
            for place, key in enumerate(found.layout.passes)
            if key.setup == setup and (key.number + 1) // 2 == pair
        ]
        rows = np.flatnonzero(np.isin(found.layout.pass_index, mine))
        span = float(np.max(found.layout.clock[rows]))
        unit = np.zeros(columns.count)
        unit[column] = 1.0
        beside = _in_time(found, rows)
        total_um = span * float(fit.unknowns[column]) + float(beside @ fit.amount)
        open_um = fit.root @ (beside - span * fit.causes.taken[column])
        u_um = float(
            np.sqrt(span**2 * max(fit.inverse.solve(unit)[column], 0.0) + open_um @ open_um)
        )
        unit_of_rate: Literal["um/h", "um/stop"] = "um/h" if timed else "um/stop"
        drifts.append(
            Drift(
                pair=pair,
                rate=total_um / span,
                unit=unit_of_rate,
                total_um=total_um,
                u_um=u_um,
            )
        )
    return tuple(drifts)


def _in_time(found: Adjustment, rows: NDArray[np.int64]) -> Vector:
    kinds = np.repeat(
        [effect.name in IN_TIME for effect in found.effects],
        [effect.count for effect in found.effects],
    )
    added = np.zeros(len(kinds))
    for number in np.unique(found.layout.offset_index[rows]):
        of_count = rows[found.layout.offset_index[rows] == number]
        added += found.fit.causes.pattern[
            of_count[-1]
        ]  # the effects in `IN_TIME` are zero at the first reading
    return np.where(kinds, added, 0.0)


def _repeatability_um(
    layout: Layout, place: NDArray[np.int64], deviation_um: Vector, setup: str
) -> float | None:
    """Return the standard deviation of repeated readings at one target in passes of the same
    direction, or None without repetitions. Targets are compared by their numbers ``place`` (m,),
    because the order of the axes may differ between passes."""
    squares, freedom = 0.0, 0
    for outward in (True, False):
        mine = [
            index
            for index, key in enumerate(layout.passes)
            if key.setup == setup and key.outward == outward
        ]
        rows = [
            np.flatnonzero((layout.pass_index == index) & np.isfinite(deviation_um))
            for index in mine
            if not _interrupted(layout, index)
        ]
        if len(rows) < 2:
            continue
        every = list(set.intersection(*(set(place[one].tolist()) for one in rows)))
        table = np.array([_at_places(deviation_um[one], place[one], every) for one in rows])
        table = table - table.mean(axis=1, keepdims=True)
        squares += float(np.sum((table - table.mean(axis=0)) ** 2))
        freedom += (table.shape[0] - 1) * (table.shape[1] - 1)
    return float(np.sqrt(squares / freedom)) if freedom else None


def _at_places(value_um: Vector, place: NDArray[np.int64], wanted: Sequence[int]) -> Vector:
    order = np.argsort(place, kind="stable")
    found: Vector = value_um[order[np.searchsorted(place[order], wanted)]]
    return found


def _interrupted(layout: Layout, index: int) -> bool:
    return bool(np.ptp(layout.zero_index[layout.pass_index == index]))


def closure_report(layout: Layout) -> Closure | None:
    """Return the closure by axis (um, at each node), or None unless all four diagonals have the
    same stops."""
    names = {setup.name for setup in layout.setups}
    stops = 3 * layout.volume.increments + 1
    counts = np.bincount(layout.pass_index, minlength=len(layout.passes))
    ours = [index for index, key in enumerate(layout.passes) if key.setup in BODY_DIAGONALS]
    same = all(counts[index] == stops and not _interrupted(layout, index) for index in ours)
    if not same or not names.issuperset(BODY_DIAGONALS):
        return None
    return Closure.of(closure_um(diagonal_data(layout)))


def scale_misclosure(found: Adjustment) -> tuple[float, float] | None:
    """Return the scale misclosure: the length of a body diagonal by the diagonals minus its length
    by the linear runs, in um, with its standard uncertainty (theory 6.4). Return None if the
    readings do not compare diagonals and runs.

    The uncertainty includes these effects:

    - angles of at least their assumed size, because the closure does not show slopes of pitch and
      yaw;
    - growth of its estimated size;
    - drift and scales of setups of a plausible size (`solver.adjustment.adjustment.PLAUSIBLE`),
      because free sizes would absorb the misclosure;
    - products of two axes of their estimated size, if they are the named cause.
    """
    layout = found.layout
    machine = (BESIDE,) if found.explained.machine_named else ()
    fit = found.plausible(*TURNING, GROWTH, *machine)
    used = np.flatnonzero(np.isfinite(found.u_um))
    linear = np.array([setup.kind == "linear" for setup in layout.setups])[
        layout.setup_index[used]
    ]
    if not linear.any() or linear.all():
        return None
    hypothesis = response_of(
        fit, used, np.where(linear, 0.0, along_the_way_m(layout)[used])[:, None]
    )
    seen = float(hypothesis.seen.item())
    if seen <= HIDDEN * hypothesis.whole.item():
        return None
    length_m = 1e-3 * float(np.linalg.norm(layout.volume.size_mm))
    return hypothesis.shown.item() / seen * length_m, float(1.0 / np.sqrt(seen)) * length_m


def scale_findings(found: Adjustment) -> list[Finding]:
    """Return the finding on diagonals and linear runs with different scales.

    Four diagonals compare one length (theory 3, E5), so the readings do not show which setup is
    wrong. The finding lists every candidate with its size. If the misclosure is large, an export is
    refused.
    """
    both = scale_misclosure(found)
    if both is None or abs(both[0]) <= MISCLOSED * both[1]:
        return []
    layout = found.layout
    diagonals = [setup.name for setup in layout.setups if setup.kind != "linear"]
    linear = [setup.name for setup in layout.setups if setup.kind == "linear"]
    um_m = both[0] / (1e-3 * float(np.linalg.norm(layout.volume.size_mm)))
    far = abs(both[0]) > MISCLOSED_FAR * both[1]
    words = message(
        "contradiction-ambiguous.length-far" if far else "contradiction-ambiguous.length",
        apart_um=both[0],
        expanded_um=2 * both[1],
        diagonals=diagonals,
        diagonals_um_m=um_m * len(diagonals),
        linear=linear,
        linear_um_m=-um_m,
    )
    return [finding("error" if far else "warning", words)]


def setup_findings(found: Adjustment, reports: Mapping[str, SetupReport]) -> list[Finding]:
    """Return the findings about setups and residuals."""
    per_setup = [one for name, report in reports.items() for one in _of_setup(name, report)]
    beyond = (*scatter_findings(found), *growth_findings(found), *scale_findings(found))
    return [*per_setup, *_poor(reports), *beyond, *_no_machines(reports, found.scatter)]


def scatter_findings(found: Adjustment) -> list[Finding]:
    """Return the findings about a measured repeatability, and about setups whose stated noise is
    too small."""
    scatter, findings = found.scatter, []
    if np.sum(scatter.freedom_misses[:FIRST]) >= LEAST_FREEDOM:
        seen = np.flatnonzero(scatter.freedom_misses[:FIRST] > 0)
        axes = [
            message(
                "axis-repeats-to", axis="XYZ"[axis], repeatability_um=scatter.misses_um[axis]
            )
            for axis in seen
        ]
        assumed_um = found.assumed.repeatability_um
        words = message(
            "repeatability-found",
            repeatability_um=scatter.repeatability_um,
            axes=axes,
            assumed_um=assumed_um,
        )
        findings.append(finding("info", words))
    rms_um = np.array([_stated_um(found, index) for index in range(len(found.layout.setups))])
    # if the readings of a setup do not separate noise from positioning deviations of the moves, the
    # assumed repeatability explains part of the scatter
    beside_um = np.where(separated(found.layout), 0.0, found.assumed.repeatability_um)
    low = (np.hypot(rms_um, scatter.noise_um) > TOO_LOW * np.hypot(rms_um, beside_um)) & (
        scatter.freedom_noise >= LEAST_FREEDOM
    )
    if np.any(low):
        names = [
            setup.name for setup, one in zip(found.layout.setups, low, strict=True) if one
        ]
        scatter_um = float(np.max(np.hypot(rms_um, scatter.noise_um)[low]))
        words = message(
            "stated-u-low",
            setups=names,
            stated_um=float(np.max(rms_um[low])),
            scatter_um=scatter_um,
        )
        findings.append(finding("warning", words))
    return findings


def _stated_um(found: Adjustment, index: int) -> float:
    stated = found.layout.u_um[found.layout.setup_index == index]
    return float(np.sqrt(np.mean(stated**2))) if np.all(np.isfinite(stated)) else np.inf


def growth_findings(found: Adjustment) -> list[Finding]:
    """Return the finding on axes whose length grew during the survey by more than `GREW_UM_M`
    and `GREW_SURE`."""
    if GROWTH not in {effect.name for effect in found.effects} or not found.explained.grows:
        return []
    place = found.first_cause(GROWTH)
    turn = growth_waves(found.layout)[
        [int(np.argmax(found.layout.hours)), int(np.argmin(found.layout.hours))]
    ]
    weight = np.zeros((3, len(found.fit.amount)))
    for axis in range(3):
        weight[axis, place + axis * turn.shape[1] + np.arange(turn.shape[1])] = (
            found.assumed.growth_um_m * (turn[0] - turn[1])
        )
    grew = weight @ found.fit.amount
    u = np.sqrt(np.diag(weight @ found.fit.amount_covariance @ weight.T))
    if not np.any(np.abs(grew) > np.maximum(GREW_UM_M, GREW_SURE * u)):
        return []
    x, y, z = grew.tolist()
    words = message(
        "drift-large.growth", x_um_m=x, y_um_m=y, z_um_m=z, expanded_um_m=2 * float(np.max(u))
    )
    return [finding("warning", words, size_um=float(grew[np.argmax(np.abs(grew))]))]


def _of_setup(name: str, report: SetupReport) -> list[Finding]:
    findings: list[Finding] = []
    tilt = report.tilt_mrad or 0.0
    if tilt > TILT_LIMIT_MRAD:
        findings.append(
            warning(
                "mirror-misaligned", setup=name, tilt_mrad=tilt, limit_mrad=TILT_LIMIT_MRAD
            )
        )
    drifts = [
        drift
        for drift in report.drift
        if abs(drift.total_um) > max(DRIFT_LIMIT_UM, 3 * drift.u_um)
    ]
    messages = [
        message("drift-large", setup=name, drift_um=drift.total_um, pair=drift.pair)
        for drift in drifts
    ]
    return [*findings, *(finding("warning", words) for words in messages)]


def _poor(reports: Mapping[str, SetupReport]) -> list[Finding]:
    messages = []
    if noisy := _above(reports, "noise_um"):
        messages.append(
            message(
                "noise-high",
                setups=list(noisy),
                u_um=max(noisy.values()),
                limit_um=NOISE_LIMIT_UM,
            )
        )
    if poor := _above(reports, "repeatability_um"):
        messages.append(
            message(
                "noise-high.repeatability",
                setups=list(poor),
                u_um=max(poor.values()),
                limit_um=NOISE_LIMIT_UM,
            )
        )
    return [finding("warning", words) for words in messages]


def _no_machines(reports: Mapping[str, SetupReport], scatter: Scatter) -> list[Finding]:
    repeats_um, times = scatter.repeatability_um, FAR_NOISE
    found = (
        [error("noise-high.machine", repeatability_um=repeats_um)]
        if repeats_um > REPEATS_UM
        else []
    )
    for name, um in _above(reports, "noise_um", times).items():
        found.append(
            finding(
                "error",
                message("noise-high.reading", setup=name, u_um=um, times=times),
                Place(setup=name),
            )
        )
    for name, um in _above(reports, "repeatability_um", times).items():
        found.append(
            finding(
                "error",
                message("noise-high.stop", setup=name, u_um=um, times=times),
                Place(setup=name),
            )
        )
    return found


def _above(
    reports: Mapping[str, SetupReport],
    figure: Literal["noise_um", "repeatability_um"],
    times: float = 1.0,
) -> dict[str, float]:
    sizes_um = {name: getattr(report, figure) or 0.0 for name, report in reports.items()}
    return {name: size for name, size in sizes_um.items() if size > times * NOISE_LIMIT_UM}
