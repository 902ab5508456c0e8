"""Commissioning and tests of a 4-DOF head: curves, stability, comparison (theory.md 9, Feng 2008
section 3)."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal, get_args

import numpy as np

from stepdiag.base.csv_table import number_in, read_table
from stepdiag.base.errors import DataError, UsageError
from stepdiag.base.messages import message
from stepdiag.base.result.result import DISPLACEMENTS, ROTATIONS
from stepdiag.base.volume import Vector
from stepdiag.daq.survey.head_file import (
    AxisName,
    AxisTable,
    DetectorName,
    HeadFile,
    require_measured,
)
from stepdiag.fourdof.calibrated import calibrated
from stepdiag.fourdof.record import HeadRecord, require_angles
from stepdiag.solver.fourdof.commissioning import (
    CurveFit,
    fit_curve,
)
from stepdiag.solver.fourdof.detector import CurveKind
from stepdiag.solver.fourdof.head import URAD_PER_ARCSEC, motion
from stepdiag.solver.fourdof.statistics import (
    Arm,
    Comparison,
    Stability,
    abbe_arm,
    compare,
    stability,
)

LATERAL: tuple[AxisName, AxisName] = ("x", "y")
QD_TO_TARGET = 2.0
"""Ratio of the spot's movement to that of the target: a shift of the cube moves the spot by twice
the shift, a rotation of the mirror turns the beam by twice the angle (Feng 2.2, 2.3)."""
Unit = Literal["um", "arcsec"]


def stability_of(
    record: HeadRecord, file: HeadFile, distance_mm: float, interval_s: float
) -> dict[str, Stability]:
    """Return the stability of ``straightness x``, ``straightness y`` in um and ``angle x``, ``angle
    y`` in arc-seconds, over means of ``interval_s``."""
    require_angles(record, "stability")
    require_measured(file, "stability")
    means = record.averaged(interval_s)
    found = motion(means.channels, distance_mm, calibrated(file), time_s=means.time_s)
    if not found.usable.all():
        texts = "; ".join(str(finding.words) for finding in found.findings)
        raise DataError(
            "stability",
            expected=message("light-on-every-detector"),
            found=texts,
            remedy=message("align-head-repeat"),
        )
    results = {}
    for column, axis in enumerate(LATERAL):
        raw, left = found.raw_straightness_um[:, column], found.straightness_um[:, column]
        results[f"straightness {axis}"] = stability(raw, left, interval_s)
    for column, axis in enumerate(LATERAL):
        raw, left = (
            found.raw_angle_urad[:, column] / URAD_PER_ARCSEC,
            found.angle_urad[:, column] / URAD_PER_ARCSEC,
        )
        results[f"angle {axis}"] = stability(raw, left, interval_s)
    return results


@dataclass(frozen=True, slots=True, kw_only=True)
class StageRun:
    """A run on a stage: the normalised reading of one detector axis, and the reference in um (QD)
    or arc-seconds (PSD)."""

    reading: Vector
    reference: Vector
    unit: Unit


def parse_stage_run(text: str, source: str) -> StageRun:
    """Return a run on a stage from the CSV columns ``reading`` (difference / sum) and
    ``reference_um`` or ``reference_arcsec``."""
    table = read_table(text, source, ("reading",))
    unit = next((unit for unit in get_args(Unit) if f"reference_{unit}" in table[0][1]), None)
    if unit is None:
        raise DataError(
            f"{source}: header",
            expected=message("column-reference-um-reference"),
            found=",".join(table[0][1]),
        )
    rows = [
        (
            number_in(row, "reading", f"{source}: line {n}"),
            number_in(row, f"reference_{unit}", f"{source}: line {n}"),
        )
        for n, row in table
    ]
    reading, reference = np.array(rows).T
    return StageRun(reading=reading, reference=reference, unit=unit)


@dataclass(frozen=True, slots=True, kw_only=True)
class Calibrated:
    """The calibration of one detector axis: the run, the fit, and the residuals in the unit of the
    reference."""

    run: StageRun
    fit: CurveFit
    residual: Vector

    @property
    def limits(self) -> tuple[float, float]:
        return float(self.residual.min()), float(self.residual.max())


def calibrate_axis(
    run: StageRun, detector: DetectorName, file: HeadFile, *, degree: int, u_reference: float
) -> Calibrated:
    """Return the curve of one detector axis; ``u_reference`` is the reference's standard
    uncertainty in its unit.

    The spot on the QD moves twice as far as the stage, and the beam to PSD2 turns by twice the
    angle of the mirror; PSD1 measures the angle of the beam itself. For the QD the better of two
    curves is used: over the reading, or over its inverse error function (Gaussian spot).
    """
    if (detector == "qd") != (run.unit == "um"):
        expected = (
            message("reference-um-for-qd")
            if detector == "qd"
            else message("reference-arcsec-for-psd")
        )
        raise UsageError(
            f"calibrate: {detector}", expected=expected, found=f"reference_{run.unit}"
        )
    shift = _shift_um(run.reference, detector, file)
    per_unit = abs(float(_shift_um(np.array([1.0]), detector, file)[0]))
    kinds: tuple[CurveKind, ...] = (
        ("polynomial",)
        if detector != "qd" or np.abs(run.reading).max() >= 1
        else ("polynomial", "erf")
    )
    fits = [
        fit_curve(
            run.reading,
            shift,
            kind=kind,
            degree=degree,
            u_reference_um=u_reference * per_unit,
        )
        for kind in kinds
    ]
    best = min(fits, key=lambda fit: fit.curve.u_um)
    return Calibrated(run=run, fit=best, residual=best.residual_um / per_unit)


def _shift_um(reference: Vector, detector: DetectorName, file: HeadFile) -> Vector:
    if detector == "qd":
        doubled: Vector = QD_TO_TARGET * reference
        return doubled
    focal_mm, fold = (
        (file.head.psd1_focal_length_mm, 1.0)
        if detector == "psd1"
        else (file.head.psd2_focal_length_mm, QD_TO_TARGET)
    )
    turned: Vector = 1e3 * focal_mm * np.tan(fold * reference * URAD_PER_ARCSEC * 1e-6)
    return turned


def with_curve(
    file: HeadFile, detector: DetectorName, axis: AxisName, found: Calibrated
) -> HeadFile:
    """Return the calibration with a new curve for one detector axis; its sign stays."""
    curve = found.fit.curve
    table = file.curve(f"{detector}.{axis}") or AxisTable()
    fresh = AxisTable(
        sign=table.sign,
        kind=curve.kind,
        coefficients_um=curve.coefficients_um,
        low=curve.low,
        high=curve.high,
        u_um=curve.u_um,
    )
    return file.with_axis(detector, axis, fresh)


Curves = Mapping[str, tuple[Vector, Vector]]
"""Functions by ISO 230-1 name: positions in mm and values (um, arc-seconds)."""


def parse_curves(text: str, source: str) -> Curves:
    """Return the functions of a CSV: ``position_mm`` and columns such as ``EYX_um``,
    ``EBX_arcsec``, ``EBX_urad``; fields may be empty."""
    table = read_table(text, source, ("position_mm",))
    curves = {}
    for column in table[0][1]:
        name, _, unit = column.partition("_")
        if name not in (*DISPLACEMENTS, *ROTATIONS):
            continue
        if unit not in ({"um"} if name in DISPLACEMENTS else {"arcsec", "urad"}):
            raise DataError(
                f"{source}: header",
                expected=f"{name}_um" if name in DISPLACEMENTS else f"{name}_arcsec",
                found=column,
            )
        where = [(f"{source}: line {line}", fields) for line, fields in table]
        rows = np.array(
            [
                (number_in(f, "position_mm", at), number_in(f, column, at, optional=True))
                for at, f in where
            ]
        )
        known = rows[np.isfinite(rows[:, 1])]
        curves[name] = (
            known[:, 0],
            known[:, 1] / (URAD_PER_ARCSEC if unit == "urad" else 1.0),
        )
    if not curves:
        raise DataError(
            f"{source}: header",
            expected=message("columns-such-eyx-um"),
            found=",".join(table[0][1]),
        )
    return curves


def compare_curves(measured: Curves, reference: Curves) -> dict[str, Comparison]:
    """Return measured minus reference for every common function, straightness without its
    least-squares line.

    Raises DataError without a common function.
    """
    common = [name for name in measured if name in reference]
    if not common:
        raise DataError(
            "compare",
            expected=message("function-in-both", names=list(measured)),
            found=message("only-these", names=list(reference)),
        )
    return {
        name: compare(
            *measured[name],
            *reference[name],
            line="least-squares" if name in DISPLACEMENTS else None,
        )
        for name in common
    }


def arms_of(measured: Curves, found: Mapping[str, Comparison]) -> dict[str, Arm]:
    """Return, by axis (X, Y, Z), the arm between the two heads if the measured rotations determine
    it (Feng 2008, 3.3)."""
    arms = {}
    for axis in "XYZ":
        straight = {
            name: one
            for name, one in found.items()
            if name in DISPLACEMENTS and name[2] == axis
        }
        turning = {
            name: curve
            for name, curve in measured.items()
            if name in ROTATIONS and name[2] == axis
        }
        places = [one.position_mm for one in straight.values()]
        if (
            not straight
            or not turning
            or any(not np.array_equal(places[0], each) for each in places)
        ):
            continue
        at = {
            name: URAD_PER_ARCSEC * np.interp(places[0], *curve)
            for name, curve in turning.items()
        }
        arm = abbe_arm(places[0], {name: one.residual for name, one in straight.items()}, at)
        if arm is not None:
            arms[axis] = arm
    return arms
