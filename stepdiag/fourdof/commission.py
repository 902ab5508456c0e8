"""Commissioning of the head on the machine, which is its stage: from the standstills of a run to
the calibration file."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import msgspec
import numpy as np

from stepdiag.base.errors import DataError
from stepdiag.base.messages import message
from stepdiag.base.names import AXES
from stepdiag.base.volume import Vector
from stepdiag.daq.survey.head_file import (
    CALIBRATED,
    CURVES,
    AxisTable,
    DetectorTable,
    HeadFile,
    LeverTable,
    LightTable,
    UncertaintyTable,
)
from stepdiag.daq.survey.models import HeadRun
from stepdiag.fourdof.calibrated import calibrated
from stepdiag.solver.fourdof.axes import unit
from stepdiag.solver.fourdof.commissioning import MAX_GAIN_ERROR
from stepdiag.solver.fourdof.detector import Detector, DetectorAxis, spots
from stepdiag.solver.fourdof.head import beam_angle_urad
from stepdiag.solver.fourdof.regression import (
    FIELDS,
    LEVER,
    PSD1,
    PSD2,
    QD,
    Commissioned,
    Stands,
    commissioned,
)

FARTHEST_MM = 0.35
"""A standstill farther than this distance in mm from the run's line is not a jog but only the
approach to a jog, which lets the axis reach every jog from the same side."""
LONG_S = 8.0
"""Shortest duration in s of a standstill in which a person wobbles the laser or the program waits:
the beam's direction changes, so each `ROW_S` is a row of the regression."""
ROW_S = 0.1
MOST_ROWS = 400
"""Largest number of rows from one long standstill: a gain is then known to a thousandth, and
further rows add nothing."""
DARK, LIT = 0.2, 0.8
"""Shares of the usual sum of a detector: below the first share the detector has no light, above the
second full light, between them the beam was being cut."""
LEAST_DARK = 20
LEAST_WITHIN = 0.003
"""Smallest relative tolerance within which two sums count as equal light. If three times the
variation of the sums in the run is larger, that value is used."""
MOST_APART = 0.02
"""Change of a sum's share by a jog above which the detector clips the spot."""
STUCK = 0.25
"""If more than this share of a sum's readings has exactly the highest value, the sum has reached
the limit of its electronics, because readings below the limit have noise. One end of the travel is
enough."""
NOMINAL = {
    "qd": AxisTable(kind="erf"),
    "psd1": AxisTable(low=-0.95, high=0.95),
    "psd2": AxisTable(low=-0.95, high=0.95),
}
"""Curves of the detectors before any calibration: a Gaussian spot on the QD, linear PSDs, gain
1000."""
REACH = 1.5
"""Extension of a QD curve beyond the readings of the run, as a factor: there the curve follows the
law of a Gaussian spot."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Standing:
    """The samples of a standstill at one commanded place: ``position_mm`` (3,), ``time_s`` (n,),
    ``channels`` (n, 9)."""

    position_mm: Vector
    time_s: Vector
    channels: Vector


@dataclass(frozen=True, slots=True, kw_only=True)
class HeadCommissioned:
    """The result of a commissioning: the calibration file, its values, and the numbers of
    standstills and of samples without light."""

    file: HeadFile
    found: Commissioned
    stands: int
    dark: int


def commission(
    standings: Sequence[Standing], file: HeadFile, run: HeadRun, axis: str, on: str
) -> HeadCommissioned:
    """Return the calibration file with all measurements of the run along ``axis`` (x, y, z);
    ``run`` is the mounting of the head, ``on`` the day.

    Raises DataError if the run does not determine a field of the file, if a detector clipped the
    spot, or if a curve of the file is wrong by more than 5 %.
    """
    if not standings:
        raise DataError(
            "commission",
            expected=message("stands-of-machine"),
            found=message("none"),
            remedy=message("fourdof-commission-program"),
        )
    every = np.concatenate([one.channels for one in standings])
    usual = np.median(every[:, 2::3], axis=0)
    dark = _dark(every, usual)
    centre = _centre_mm(standings)
    lit = [
        _lit(one, usual) for one in standings if _beside_mm(one, centre, axis) <= FARTHEST_MM
    ]
    rows, channels = _standstill_rows(
        [one for one in lit if len(one.time_s)], centre, run, axis
    )
    light = _light(every, channels, usual, dark)
    curves = {name: _base(file, name) for name in CURVES}
    noise = _noise([_seen(one.channels, file, curves, dark) for one in lit if _long(one)])
    found = commissioned(replace(rows, seen=_seen(channels, file, curves, dark), noise=noise))
    readings = np.abs(_readings(channels, dark)).max(axis=(0, 2))
    written = _written(file, found, curves, dark, light, readings, on)
    return HeadCommissioned(
        file=written, found=found, stands=len(lit), dark=int(_is_dark(every, usual).sum())
    )


def _is_dark(channels: Vector, usual: Vector) -> np.ndarray[tuple[int], np.dtype[np.bool_]]:
    dark: np.ndarray[tuple[int], np.dtype[np.bool_]] = np.all(
        channels[:, 2::3] < DARK * usual, axis=1
    )
    return dark


def _dark(channels: Vector, usual: Vector) -> Vector:
    """Return the values of the nine channels without light, shape (3, 3)."""
    dark = channels[_is_dark(channels, usual)]
    if len(dark) < LEAST_DARK:
        expected, found = message("dark-samples", count=LEAST_DARK), str(len(dark))
        raise DataError(
            "commission: dark",
            expected=expected,
            found=found,
            remedy=message("block-the-beam"),
        )
    return np.asarray(np.median(dark, axis=0).reshape(3, 3), dtype=np.float64)


def _lit(one: Standing, usual: Vector) -> Standing:
    lit = np.all(one.channels[:, 2::3] > LIT * usual, axis=1)
    return Standing(
        position_mm=one.position_mm, time_s=one.time_s[lit], channels=one.channels[lit]
    )


def _long(one: Standing) -> bool:
    return len(one.time_s) > 0 and float(np.ptp(one.time_s)) >= LONG_S


def _beside_mm(one: Standing, centre_mm: Vector, axis: str) -> float:
    return float(np.max(np.abs(np.delete(one.position_mm - centre_mm, AXES.index(axis)))))


def _centre_mm(standings: Sequence[Standing]) -> Vector:
    """Return the position of the longest standstill, shape (3,): the jogs are around this
    position."""
    places = np.concatenate(
        [np.repeat(one.position_mm[None, :], len(one.time_s), axis=0) for one in standings]
    )
    return np.asarray(np.median(places, axis=0), dtype=np.float64)


def _standstill_rows(
    lit: Sequence[Standing], centre_mm: Vector, run: HeadRun, axis: str
) -> tuple[Stands, Vector]:
    """Return the rows of standstills with light, and the means of their channels (N, 9). A
    standstill has one row; a long standstill at an end of the travel has many.

    In these rows, the readings ``seen`` and the noise are still empty.
    """
    along = AXES.index(axis)
    place = np.array([one.position_mm[along] for one in lit])
    near = place.min() if run.beam[0] == "+" else place.max()
    ends: dict[tuple[float, int], int] = {}
    rows = []
    for number, one in enumerate(lit):
        long = _long(one)
        end = ends.setdefault(
            (round(float(one.position_mm[along]), 2), number + 1 if long else 0), len(ends)
        )
        moved_um = 1e3 * _lateral(one.position_mm - centre_mm, run)
        distance_mm = run.distance_mm + abs(float(one.position_mm[along]) - near)
        rows += [
            (end, distance_mm, moved_um, float(samples), not long, channels)
            for channels, samples in _means(one, long=long)
        ]
    ended, distance, moved, samples, jogged, channels = map(np.array, zip(*rows, strict=True))
    none = np.zeros((0, 6))
    return Stands(
        end=ended,
        distance_mm=distance,
        moved_um=moved,
        samples=samples,
        jogged=jogged,
        seen=none,
        noise=none,
    ), channels


def _readings(channels: Vector, dark: Vector) -> Vector:
    """Return the normalised readings of the detectors, shape (N, 3, 2): the differences over the
    sums, less the dark values."""
    light = channels.reshape(-1, 3, 3) - dark
    readings: Vector = light[:, :, :2] / light[:, :, 2:]
    return readings


def _seen(
    channels: Vector, file: HeadFile, curves: dict[str, AxisTable], dark: Vector
) -> Vector:
    """Return the values of the channels (N, 9) by the curves of the detectors, without signs and
    rolls: QD in um, PSD1 and PSD2 in urad, shape (N, 6)."""
    bare = msgspec.structs.replace(
        file,
        **{
            name: DetectorTable(x=curves[f"{name}.x"], y=curves[f"{name}.y"])
            for name in NOMINAL
        },
    )
    head = calibrated(bare)
    readings = np.moveaxis(_readings(channels, dark), 1, 0)
    qd, psd1, psd2 = (
        spots(_plain(detector), one, np.ones(len(one))).shift_um
        for detector, one in zip((head.qd, head.psd1, head.psd2), readings, strict=True)
    )
    return np.hstack(
        [
            qd,
            beam_angle_urad(psd1, head.psd1_focal_length_mm),
            beam_angle_urad(psd2, head.psd2_focal_length_mm),
        ]
    )


def _noise(stands: Sequence[Vector]) -> Vector:
    """Return the noise of a sample from the fourth differences in long standstills, shape (6,): a
    wobble by hand is too slow to affect fourth differences.

    The squares of the binomials 1 4 6 4 1 add up to 70. Raises DataError without a long standstill,
    in which the laser is wobbled.
    """
    fourth = [np.diff(one, n=4, axis=0) for one in stands]
    if not fourth:
        raise DataError(
            "commission",
            expected=message("long-stand", seconds=LONG_S),
            found=message("none"),
            remedy=message("wobble-more"),
        )
    noise: Vector = np.sqrt(np.mean(np.concatenate(fourth) ** 2, axis=0) / 70.0)
    return noise


def _plain(detector: Detector) -> Detector:
    return Detector(
        x=DetectorAxis(curve=detector.x.curve), y=DetectorAxis(curve=detector.y.curve)
    )


def _lateral(moved_mm: Vector, run: HeadRun) -> Vector:
    side = 1.0 if run.target_on == "tool" else -1.0
    return side * np.array([unit(run.detector_x) @ moved_mm, unit(run.detector_y) @ moved_mm])


def _means(one: Standing, *, long: bool) -> list[tuple[Vector, int]]:
    if not long:
        return [(one.channels.mean(axis=0), len(one.time_s))]
    row_s = max(ROW_S, float(np.ptp(one.time_s)) / MOST_ROWS)
    place = np.floor((one.time_s - one.time_s[0]) / row_s).astype(np.int64)
    return [
        (one.channels[place == number].mean(axis=0), int(np.sum(place == number)))
        for number in np.unique(place)
    ]


def _light(every: Vector, rows: Vector, usual: Vector, dark: Vector) -> LightTable:
    for column, name in enumerate(NOMINAL):
        total = every[np.all(every[:, 2::3] > LIT * usual, axis=1), 3 * column + 2]
        highest = float(total.max())
        if np.mean(total == highest) >= STUCK:
            expected, found = message("sum-with-noise"), message("sum-stuck", value=highest)
            raise DataError(
                f"commission: {name}",
                expected=expected,
                found=found,
                remedy=message("reduce-gain"),
            )
    sums = rows[:, 2::3] - dark[:, 2]
    light = np.median(sums, axis=0)
    share = sums / light
    apart = np.abs(share / np.median(share, axis=1, keepdims=True) - 1.0)
    worst = int(np.argmax(apart.max(axis=0)))
    most = float(apart[:, worst].max())
    if most > MOST_APART:
        expected, found = (
            message("sums-together", percent=100 * MOST_APART),
            message("sum-apart", percent=100 * most),
        )
        raise DataError(
            f"commission: {list(NOMINAL)[worst]}",
            expected=expected,
            found=found,
            remedy=message("align-head-repeat"),
        )
    x, y, z = (float(value) for value in light)
    return LightTable(sums=(x, y, z), within=max(LEAST_WITHIN, 3.0 * most))


def _base(file: HeadFile, name: str) -> AxisTable:
    return file.curve(name) or NOMINAL[name.partition(".")[0]]


def _written(
    file: HeadFile,
    found: Commissioned,
    curves: dict[str, AxisTable],
    dark: Vector,
    light: LightTable,
    readings: Vector,
    on: str,
) -> HeadFile:
    changes: dict[str, object] = {}
    for number, (name, first) in enumerate((("qd", QD), ("psd1", PSD1), ("psd2", PSD2))):
        axes = {
            letter: _scaled(
                file,
                f"{name}.{letter}",
                curves,
                found,
                first + index,
                float(readings[number]),
            )
            for index, letter in enumerate(("x", "y"))
        }
        changes[name] = msgspec.structs.replace(
            file.detector(name),  # type: ignore[arg-type]
            **axes,
            sum_min=float(DARK * light.sums[number] + dark[number, 2]),
            rotation_mrad=float(found.value[first + 2]),
            dark=tuple(float(value) for value in dark[number]),
        )
    growth, leak1, leak2 = (float(found.value[first + 3]) for first in (QD, PSD1, PSD2))
    lever_mm, u_lever_mm = float(found.value[LEVER]), float(found.u[LEVER])
    fresh = msgspec.structs.replace(
        file,
        head=msgspec.structs.replace(file.head, version=2, date=on),
        **changes,
        lever=LeverTable(dead_path_mm=lever_mm, u_mm=u_lever_mm),
        light=light,
        crosstalk=msgspec.structs.replace(
            file.crosstalk,
            psd1_leak=(leak1, leak1),
            psd2_leak=(leak2, leak2),
            qd_gain_per_m=(growth, growth),
            qd_calibrated_at_mm=max(0.0, lever_mm + found.middle_mm),
        ),
    )
    return msgspec.structs.replace(
        fresh.with_measured("fourdof commission", on, *CALIBRATED),
        uncertainty=_uncertainty(found),
    )


def _scaled(
    file: HeadFile,
    name: str,
    curves: dict[str, AxisTable],
    found: Commissioned,
    index: int,
    most: float,
) -> AxisTable:
    """Return a detector's curve times its gain. Raises DataError for a calibrated curve that is
    wrong by more than 5 %."""
    table, gain = curves[name], float(found.value[index])
    known = file.curve(name) is not None
    off = abs(abs(gain) - 1.0)
    if known and off > MAX_GAIN_ERROR + 2.0 * float(found.u[index]):
        expected = message("gain-within", low=1.0 - MAX_GAIN_ERROR, high=1.0 + MAX_GAIN_ERROR)
        raise DataError(
            f"commission: {name}",
            expected=expected,
            found=f"{abs(gain):.3f}",
            remedy=message("check-gains"),
        )
    reach = min(0.98, REACH * most) if not known and name.startswith("qd") else None
    return msgspec.structs.replace(
        table,
        sign=1 if gain > 0.0 else -1,
        coefficients_um=tuple(abs(gain) * value for value in table.coefficients_um),
        low=table.low if reach is None else -reach,
        high=table.high if reach is None else reach,
        u_um=abs(gain) * table.u_um,
    )


def _uncertainty(found: Commissioned) -> UncertaintyTable:
    share = np.ones(len(FIELDS))
    gains = [first + index for first in (QD, PSD1, PSD2) for index in range(2)]
    share[gains] = 1.0 / np.abs(found.value[gains])
    u = found.u * share
    signs = np.ones(len(FIELDS))
    signs[gains] = np.sign(found.value[gains])
    correlation = np.clip(
        found.covariance / np.outer(found.u, found.u) * np.outer(signs, signs), -1.0, 1.0
    )
    lower = correlation[np.tril_indices(len(FIELDS), -1)]
    return UncertaintyTable(of=FIELDS, u=tuple(u.tolist()), correlation=tuple(lower.tolist()))
