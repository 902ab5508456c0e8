"""Propagation of the uncertainty of a head's calibration to straightness and angle."""

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from stepdiag.solver.fourdof.detector import Detector, DetectorAxis
from stepdiag.solver.fourdof.head import Crosstalk, Head

Vector = NDArray[np.float64]


def varied(head: Head, fields: Sequence[str], change: Vector) -> Head:
    """Return the head with changed `regression.FIELDS`: the change is relative for gains, in
    mrad for rolls, in urad per um for leaks, in mm for the lever."""
    by = dict(zip(fields, change.tolist(), strict=True))
    return replace(
        head,
        qd=_detector(head.qd, "qd", by),
        psd1=_detector(head.psd1, "psd1", by),
        psd2=_detector(head.psd2, "psd2", by),
        dead_path_mm=head.dead_path_mm + by.get("lever", 0.0),
        crosstalk=_crosstalk(head.crosstalk, by),
    )


def spread(
    of: Callable[[Head], Vector], head: Head, fields: Sequence[str], covariance: Vector
) -> Vector:
    """Return the standard uncertainty by the calibration of the quantity ``of(head)``, in the shape
    of this quantity.

    The quantity is computed after a change of one standard deviation along each main axis of the
    covariance's ellipsoid (JCGM 100, 5.2.2).
    """
    here = of(head)
    scale = np.sqrt(np.maximum(np.diag(covariance), 1e-300))
    size, axes = np.linalg.eigh(covariance / np.outer(scale, scale))
    total = np.zeros_like(here)
    for value, axis in zip(size, axes.T, strict=True):
        total = (
            total
            + (of(varied(head, fields, np.sqrt(max(value, 0.0)) * axis * scale)) - here) ** 2
        )
    u: Vector = np.sqrt(total)
    return u


def _detector(detector: Detector, name: str, by: dict[str, float]) -> Detector:
    return replace(
        detector,
        x=_axis(detector.x, by.get(f"{name}.x", 0.0)),
        y=_axis(detector.y, by.get(f"{name}.y", 0.0)),
        rotation_mrad=detector.rotation_mrad + by.get(f"{name}.rotation_mrad", 0.0),
    )


def _axis(axis: DetectorAxis, share: float) -> DetectorAxis:
    coefficients = tuple((1.0 + share) * value for value in axis.curve.coefficients_um)
    return replace(axis, curve=replace(axis.curve, coefficients_um=coefficients))


def _crosstalk(crosstalk: Crosstalk, by: dict[str, float]) -> Crosstalk:
    def changed(name: str, pair: tuple[float, float]) -> tuple[float, float]:
        change = by.get(f"crosstalk.{name}", 0.0)
        return pair[0] + change, pair[1] + change

    return replace(
        crosstalk,
        psd1_leak=changed("psd1_leak", crosstalk.psd1_leak),
        psd2_leak=changed("psd2_leak", crosstalk.psd2_leak),
        qd_gain_per_m=changed("qd_gain_per_m", crosstalk.qd_gain_per_m),
    )
