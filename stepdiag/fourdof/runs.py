"""Straightness, pitch and yaw of the axes from the passes of a 4-DOF head, by ISO 230-1 name, with
their uncertainty."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import combinations, product
from typing import Literal, cast

import numpy as np

from stepdiag.base.errors import DataError
from stepdiag.base.findings import Finding, error, finding, warning
from stepdiag.base.messages import message
from stepdiag.base.names import AXES
from stepdiag.base.volume import POSITION_TOLERANCE_MM, Vector
from stepdiag.daq.capture.captured_stop import CapturedStop
from stepdiag.daq.passes.driven import Pass
from stepdiag.daq.survey.head_file import (
    HeadFile,
    LeverTable,
    parse_head_file,
    require_measured,
    require_owner,
)
from stepdiag.daq.survey.models import Head as HeadSection
from stepdiag.daq.survey.models import HeadRun, Survey
from stepdiag.fourdof.angular import Turns, turns_of
from stepdiag.fourdof.calibrated import calibrated
from stepdiag.solver.fourdof.axes import Mount, axis_errors, unit
from stepdiag.solver.fourdof.detector import Detector
from stepdiag.solver.fourdof.head import Head, Motion, motion
from stepdiag.solver.fourdof.variation import spread
from stepdiag.solver.model.angles import Angles, KnownAngle
from stepdiag.solver.model.lateral import MeasuredStraightness
from stepdiag.solver.standards.straightness import residuals_um

CHANNELS = 9
QD_ONLY = 3
SHIFT_SHARE = float(0.5 / np.sqrt(6.0))
"""Share of a beam's parallel shift in a pass that appears in the straightness (rms). A parallel
shift moves the spot by the same amount and the straightness by half of this amount. After removal
of the end-point line, the rms of a random shift over the pass (a Brownian bridge) is 1 /
sqrt(6)."""
QD, PSD1, PSD2 = (0, 1, 2), (3, 4, 5), (6, 7, 8)
APART = 3.29
"""Multiple of u above which the rms difference of two passes is more than chance (99.9 %). The
limit also holds if all errors within a pass are equal."""
WAVELENGTH_NM = 650.0
"""Wavelength of the head's red laser in nm, which only limits the curvature of the spot's
growth."""
LEAST_STOPS = 3
"""Least number of stops for a straightness: through two stops every guideway is a straight line."""


@dataclass(frozen=True, slots=True, kw_only=True)
class HeadMeasured:
    """The results of the head's passes: a straightness for each pass and lateral direction, and the
    angular functions over all passes of an axis.

    ``shared_um`` is, for each entry of ``straightness``, the uncertainty of the calibration, which
    is common to all passes.
    """

    straightness: tuple[MeasuredStraightness, ...] = ()
    shared_um: tuple[Vector, ...] = ()
    angles: Mapping[str, KnownAngle]
    findings: tuple[Finding, ...] = ()


@dataclass(frozen=True, slots=True, kw_only=True)
class _PassSeen:
    straightness: tuple[MeasuredStraightness, ...]
    shared_um: tuple[Vector, ...] = ()
    turns: Turns
    findings: tuple[Finding, ...]


def evaluate_head(
    survey: Survey, passes: Sequence[Pass], files: Mapping[str, bytes], level: Angles
) -> HeadMeasured:
    """Return the results of the 4-DOF head from its complete passes.

    ``files`` contains the calibration by its name in the survey, ``level`` the angular functions
    known from other instruments. The roll is needed, because it moves a cube that is off the axis.
    Raises DataError for a calibration of another head, and for a missing distance of the laser.
    """
    driven = [each for each in passes if each.whole and each.route.travel.is_fourdof]
    if not driven or survey.head is None:
        return HeadMeasured(angles={})
    if survey.head.angular:
        seen = [
            _PassSeen(straightness=(), turns=turns_of(survey.head, each), findings=())
            for each in driven
        ]
    else:
        calibration = _calibration(survey.head, files)
        seen = [_evaluate(survey, survey.head, calibration, each, level) for each in driven]
    angles, incomplete = _whole(_over_passes([each.turns for each in seen]), survey)
    return HeadMeasured(
        straightness=tuple(one for each in seen for one in each.straightness),
        shared_um=tuple(one for each in seen for one in each.shared_um),
        angles=angles,
        findings=(
            *(finding for each in seen for finding in each.findings),
            *incomplete,
            *_apart(driven, seen),
        ),
    )


def _whole(
    angles: dict[str, KnownAngle], survey: Survey
) -> tuple[dict[str, KnownAngle], tuple[Finding, ...]]:
    """Return the functions that cover the whole volume: a function on a part of the volume cannot
    correct a diagonal."""
    whole, findings = {}, []
    for name, known in angles.items():
        nodes = survey.volume.nodes_mm(AXES.index(name[2].lower()))
        if (
            known.position_mm[0] <= nodes[0] + POSITION_TOLERANCE_MM
            and known.position_mm[-1] >= nodes[-1] - POSITION_TOLERANCE_MM
        ):
            whole[name] = known
            continue
        first_mm, last_mm = known.position_mm[[0, -1]]
        partly = message(
            "fourdof-beam-blocked.partly",
            name=name,
            low=first_mm,
            high=last_mm,
            first=nodes[0],
            last_mm=nodes[-1],
        )
        findings.append(finding("warning", partly))
    return whole, tuple(findings)


def _calibration(section: HeadSection, files: Mapping[str, bytes]) -> HeadFile:
    data = files.get(section.calibration)
    if data is None:
        raise DataError(
            section.calibration or "head.calibration",
            expected=message("head-s-calibration-file"),
            found=message("nothing"),
        )
    file = parse_head_file(data, section.calibration)
    require_owner(file, section, section.calibration)
    require_measured(file, section.calibration)
    return file


def _evaluate(
    survey: Survey, section: HeadSection, file: HeadFile, each: Pass, level: Angles
) -> _PassSeen:
    place = message("setup-pass", setup=each.route.setup, number=each.number)
    name = str(place)
    axis = AXES.index(each.route.travel.axis)
    run = section.run_along(AXES[axis])
    stops = list(each.chosen().values())
    position = np.array([stop.position_mm[axis] for stop in stops])
    channels, u_channels = _channels(stops, name)
    distance = _distance_mm(section, run, stops, position, name)
    qd_only = len(stops[0].channels) == QD_ONLY
    head = (
        replace(calibrated(file), psd1=Detector(), psd2=Detector(), light=None)
        if qd_only
        else calibrated(file)
    )
    found = motion(
        channels,
        distance,
        head,
        _roll_urad(run, axis, level, position),
        time_s=None if qd_only else np.array([stop.time_s for stop in stops]),
        u_psd1_urad=_by_channel(channels, u_channels, distance, head, PSD1).drift_urad,
    )
    findings = tuple(
        finding(one.severity, message("in-run", run=place, what=one.words), code=one.code)
        for one in found.findings
    )
    count = int(np.count_nonzero(found.usable))
    if count < LEAST_STOPS:
        dark = error("fourdof-beam-blocked.dark", run=place, count=count, stops=len(stops))
        return _PassSeen(straightness=(), turns={}, findings=(*findings, dark))
    shift_um = survey.uncertainty.source_shift_um
    own = _noise(found, channels, u_channels, distance, head, shift_um)
    seen = _named(
        each,
        run,
        position,
        found,
        own,
        _calibration_noise(found, channels, distance, head, file),
    )
    if not qd_only:
        return replace(seen, findings=findings)
    return replace(
        seen,
        turns={},
        findings=(*findings, warning("fourdof-uncompensated.qd", run=place)),
    )


def _named(
    each: Pass, run: HeadRun, position: Vector, found: Motion, u: "_Noise", shared: "_Noise"
) -> _PassSeen:
    mount = Mount(
        axis=cast("Literal['x', 'y', 'z']", each.route.travel.axis),
        beam=run.beam,
        detector_x=run.detector_x,
        detector_y=run.detector_y,
        target_on=run.target_on,
    )
    kept = np.flatnonzero(found.usable)[np.argsort(position[found.usable])]
    errors = axis_errors(
        position[kept], found.straightness_um[kept], found.angle_urad[kept], mount
    )
    straightness = tuple(
        MeasuredStraightness(
            name=name,
            position_mm=errors.position_mm,
            value_um=value,
            u_um=np.hypot(u.straightness_um, shared.straightness_um)[kept, column],
            approach=1 if each.route.outward else -1,
        )
        for column, (name, value) in enumerate(errors.straightness_um.items())
    )
    turns = {
        name: (
            errors.position_mm,
            value,
            np.hypot(u.angle_urad[kept, column], u.angle_urad[kept[0], column]),
            shared.angle_urad[kept, column],
        )
        for column, (name, value) in enumerate(errors.rotation_urad.items())
    }
    shared_um = tuple(
        shared.straightness_um[kept, column] for column in range(len(straightness))
    )
    return _PassSeen(straightness=straightness, shared_um=shared_um, turns=turns, findings=())


def _channels(stops: Sequence[CapturedStop], name: str) -> tuple[Vector, Vector]:
    """Return the nine channels of every stop and their standard uncertainties. For a head with a QD
    only, the channels of the PSDs are those of constant, centred spots."""
    sizes = {len(stop.channels) for stop in stops}
    if not sizes <= {CHANNELS} and not sizes <= {QD_ONLY}:
        found = message("number-of-channels", names=list(map(str, sorted(sizes))))
        raise DataError(
            name,
            expected=message("nine-channels-head-three"),
            found=found,
            remedy=message("drive-once-more"),
        )
    mean, u = (
        np.array([stop.channels for stop in stops]),
        np.array([stop.u_channels for stop in stops]),
    )
    if sizes == {QD_ONLY}:
        still = np.tile([0.0, 0.0, 1.0, 0.0, 0.0, 1.0], (len(stops), 1))
        return np.hstack([mean, still]), np.hstack([u, np.zeros_like(still)])
    return mean, u


def _distance_mm(
    section: HeadSection,
    run: HeadRun,
    stops: Sequence[CapturedStop],
    position: Vector,
    name: str,
) -> Vector:
    away = position - position.min() if run.beam[0] == "+" else position.max() - position
    if section.distance == "commanded":
        commanded: Vector = run.distance_mm + away
        return commanded
    reading = np.array(
        [np.nan if stop.reading_mm is None else stop.reading_mm for stop in stops]
    )
    if not np.isfinite(reading).all():
        missing = stops[int(np.argmin(np.isfinite(reading)))].stop
        remedy = message("put-head-distance-commanded")
        raise DataError(
            message("stop-in-run", run=name, stop=missing),
            expected=message("reading-laser-for-distance"),
            found=message("none"),
            remedy=remedy,
        )
    measured: Vector = run.distance_mm + reading - reading[int(np.argmin(away))]
    return measured


def _roll_urad(run: HeadRun, axis: int, level: Angles, position: Vector) -> Vector:
    known = level.get(f"E{'ABC'[axis]}{'XYZ'[axis]}")
    if known is None:
        return np.zeros(len(position))
    sense = float(np.cross(unit(run.detector_x), unit(run.detector_y))[axis]) * (
        1.0 if run.target_on == "tool" else -1.0
    )
    roll: Vector = sense * np.interp(position, known.position_mm, known.value_urad)
    return roll


@dataclass(frozen=True, slots=True)
class _Noise:
    """Standard uncertainties of straightness and angle at every stop, shape (N, 2)."""

    straightness_um: Vector
    angle_urad: Vector
    drift_urad: Vector


def _noise(
    found: Motion,
    channels: Vector,
    u_channels: Vector,
    distance: Vector,
    head: Head,
    shift_um: float,
) -> _Noise:
    drift_um = 1e-3 * head.lever_mm(distance)[:, None] * found.u_drift_urad
    # the uncertainty of the drift includes the scatter of its detector
    scatter = _by_channel(channels, u_channels, distance, head, (*QD, *PSD2))
    return _Noise(
        straightness_um=np.sqrt(
            drift_um**2 + scatter.straightness_um**2 + (SHIFT_SHARE * shift_um) ** 2
        ),
        angle_urad=np.hypot(found.u_drift_urad / 2, scatter.angle_urad),
        drift_urad=found.u_drift_urad,
    )


def _calibration_noise(
    found: Motion, channels: Vector, distance: Vector, head: Head, file: HeadFile
) -> _Noise:
    """Return the uncertainty of the calibration, which is common to all passes: of straightness
    without its end-point line, and of angles relative to the first angle.

    A calibration file without a commissioning has no covariance; its only uncertainties are those
    of the curves and the lever.
    """
    if not file.uncertainty.of:
        lever_mm = (file.lever or LeverTable()).u_at(distance)[:, None]
        lever_um = lever_mm * 1e-3 * np.abs(found.drift_urad - found.drift_urad[:1])
        return _Noise(
            np.hypot(found.u_straightness_um, lever_um),
            np.sqrt(2.0) * found.u_angle_urad,
            np.zeros_like(found.drift_urad),
        )
    lit = np.flatnonzero(found.usable)
    first, last = lit[np.argmin(distance[lit])], lit[np.argmax(distance[lit])]
    share = ((distance - distance[first]) / ((distance[last] - distance[first]) or 1.0))[
        :, None
    ]

    def of(other: Head) -> Vector:
        seen = motion(channels, distance, other)
        straight, angle = seen.straightness_um, seen.angle_urad
        return np.hstack(
            [
                straight - (1.0 - share) * straight[first] - share * straight[last],
                angle - angle[first],
            ]
        )

    u = spread(of, head, file.uncertainty.of, file.uncertainty.covariance())
    own_um = np.hypot(_bent_growth_um(found, distance, head, share), found.u_straightness_um)
    straight_um, angle_urad = (
        np.hypot(u[:, :2], own_um),
        np.hypot(u[:, 2:], np.sqrt(2.0) * found.u_angle_urad),
    )
    return _Noise(straight_um, angle_urad, np.zeros_like(found.drift_urad))


def _bent_growth_um(found: Motion, distance: Vector, head: Head, share: Vector) -> Vector:
    """Return the standard uncertainty (k = 1) of the straightness in um, shape (N, 2), that comes
    from the assumed linear growth of the QD's gain between both ends.

    The radius of a beam grows with the square of the distance from its waist; a waist in the middle
    of the path gives the largest departure from the chord. The place of the waist is unknown, so
    all departures from zero to this largest departure are equally probable (GUM 4.3.7).
    """
    radius_mm = (
        1e-3 * np.sqrt(2.0) * abs(head.qd.x.curve.coefficients_um[1])
        if len(head.qd.x.curve.coefficients_um) > 1
        else np.inf
    )
    rayleigh_mm = np.pi * radius_mm**2 / (1e-6 * WAVELENGTH_NM)
    most = (2.0 * float(np.ptp(distance)) / rayleigh_mm) ** 2 / 8.0 / np.sqrt(3.0)
    bent_um: Vector = 4.0 * share * (1.0 - share) * most * np.abs(found.raw_straightness_um)
    return bent_um


def _by_channel(
    channels: Vector, u_channels: Vector, distance: Vector, head: Head, of: Sequence[int]
) -> _Noise:
    still = motion(channels, distance, head)
    total = [np.zeros_like(still.straightness_um) for _ in range(3)]
    for channel in of:
        if not u_channels[:, channel].any():
            continue
        moved = channels.copy()
        moved[:, channel] += u_channels[:, channel]
        other = motion(moved, distance, head)
        for part, (there, here) in enumerate(
            (
                (other.straightness_um, still.straightness_um),
                (other.angle_urad, still.angle_urad),
                (other.drift_urad, still.drift_urad),
            )
        ):
            total[part] = total[part] + (there - here) ** 2
    return _Noise(*map(np.sqrt, total))


def _over_passes(seen: Sequence[Turns]) -> dict[str, KnownAngle]:
    names = sorted(
        {name for turns in seen for name in turns}, key=lambda name: (name[2], name[1])
    )
    return {
        name: _mean_angle([turns[name] for turns in seen if name in turns]) for name in names
    }


def _mean_angle(passes: Sequence[tuple[Vector, Vector, Vector, Vector]]) -> KnownAngle:
    position, value, u = _mean(passes)
    return KnownAngle(position_mm=position, value_urad=value, u_urad=u)


def _mean(
    passes: Sequence[tuple[Vector, Vector, Vector, Vector]],
) -> tuple[Vector, Vector, Vector]:
    """Return the common positions of all passes, the mean of the passes there relative to the first
    position, and its uncertainty.

    The part of the uncertainty that differs from pass to pass decreases with the number of passes,
    but not below the differences of the passes, which include reversal. The common part does not
    decrease.
    """
    common = passes[0][0]
    for position, *_ in passes[1:]:
        common = np.intersect1d(common, position)
    values = np.array([value[np.isin(position, common)] for position, value, *_ in passes])
    values = values - values[:, :1]
    own, shared = (
        np.array([one[which][np.isin(one[0], common)] for one in passes]) for which in (2, 3)
    )
    u = np.sqrt(np.mean(own**2, axis=0) / len(passes))
    if len(passes) > 1:
        spread = float(np.sqrt(np.mean(np.var(values[:, 1:], axis=0, ddof=1)) / len(passes)))
        u = np.maximum(u, spread)
    return common, values.mean(axis=0), np.hypot(u, np.sqrt(np.mean(shared**2, axis=0)))


def merge_angles(
    level: Angles, head: Angles
) -> tuple[dict[str, KnownAngle], tuple[Finding, ...]]:
    """Return the angular functions of the head, and from the file those that the head does not
    measure (the rolls); also a finding for a function that both contain."""
    both = [name for name in head if name in level]
    findings = []
    if both:
        text = message("angles-twice", names=both)
        findings.append(finding("warning", text))
    return {**level, **head}, tuple(findings)


def over_passes(measured: HeadMeasured) -> tuple[MeasuredStraightness, ...]:
    """Return every straightness function as the mean of its passes without their end-point lines,
    at the positions common to all.

    The uncertainty is that of the mean (`_mean`). It includes the effect of both end points on
    every value between them.
    """
    names = dict.fromkeys(one.name for one in measured.straightness)
    both = list(zip(measured.straightness, measured.shared_um, strict=True))
    return tuple(
        _mean_straightness([(one, shared) for one, shared in both if one.name == name])
        for name in names
    )


def _apart(driven: Sequence[Pass], seen: Sequence[_PassSeen]) -> list[Finding]:
    worst: dict[str, tuple[float, Finding]] = {}
    for (before, one), (after, other) in combinations(zip(driven, seen, strict=True), 2):
        for mine, theirs in product(_own_lines(one), _own_lines(other)):
            if (mine[0].name, mine[0].approach) != (theirs[0].name, theirs[0].approach):
                continue
            at = np.intersect1d(mine[0].position_mm, theirs[0].position_mm)[1:-1]
            apart, variance = np.zeros_like(at), np.zeros_like(at)
            for sign, (straight, value, u) in ((1.0, mine), (-1.0, theirs)):
                there = np.isin(straight.position_mm, at)
                apart, variance = apart + sign * value[there], variance + u[there] ** 2
            times = float(np.sqrt(np.mean(apart**2) / np.mean(variance))) if len(at) else 0.0
            name = mine[0].name
            if times > APART and times > worst.get(name, (0.0, None))[0]:
                figures = {
                    "apart_um": float(np.max(np.abs(apart))),
                    "expanded_um": 2.0 * float(np.sqrt(np.mean(variance))),
                }
                words = message(
                    "straightness-misclosure.passes",
                    name=name,
                    first=before.number,
                    second=after.number,
                    **figures,
                )
                worst[name] = times, finding("warning", words)
    return [found for _, found in worst.values()]


def _own_lines(seen: _PassSeen) -> list[tuple[MeasuredStraightness, Vector, Vector]]:
    return [
        (one, *_own_line(one, shared))
        for one, shared in zip(seen.straightness, seen.shared_um, strict=True)
    ]


def _own_line(one: MeasuredStraightness, shared_um: Vector) -> tuple[Vector, Vector]:
    own_um = np.sqrt(np.maximum(one.u_um**2 - shared_um**2, 0.0))
    return residuals_um(one.position_mm, one.value_um), with_ends(one.position_mm, own_um)


def _mean_straightness(
    passes: Sequence[tuple[MeasuredStraightness, Vector]],
) -> MeasuredStraightness:
    position, value, u = _mean(
        [(one.position_mm, *_own_line(one, shared), shared) for one, shared in passes]
    )
    ways = {one.approach for one, _ in passes}
    return MeasuredStraightness(
        name=passes[0][0].name,
        position_mm=position,
        value_um=residuals_um(position, value),
        u_um=u,
        approach=ways.pop() if len(ways) == 1 else 0,
    )


def with_ends(position_mm: Vector, u_um: Vector) -> Vector:
    """Return the uncertainty of values after removal of the line through the first and the last
    value, shape (N,); both ends stay unchanged."""
    share = (position_mm - position_mm[0]) / ((position_mm[-1] - position_mm[0]) or 1.0)
    between = np.sqrt(u_um**2 + ((1.0 - share) * u_um[0]) ** 2 + (share * u_um[-1]) ** 2)
    ends = (share == 0.0) | (share == 1.0)
    return np.where(ends, u_um, between)


def mean_straightness(measured: HeadMeasured) -> dict[str, tuple[Vector, Vector]]:
    """Return the functions of `over_passes` by name: positions in mm and values in um."""
    return {one.name: (one.position_mm, one.value_um) for one in over_passes(measured)}
