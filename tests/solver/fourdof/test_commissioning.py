"""Detector curves from a reference stage."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from stepdiag.base.errors import DataError
from stepdiag.solver.fourdof.commissioning import fit_curve
from stepdiag.solver.fourdof.detector import Curve, Detector, DetectorAxis, inverse_erf, spots


@given(st.floats(-0.9999, 0.9999))
def test_inverse_error_function_inverts(value):
    assert math.erf(float(inverse_erf(value))) == pytest.approx(value, abs=1e-12)


def test_inverse_error_function_has_no_value_at_the_edge():
    assert np.isnan(inverse_erf([1.0, -1.0, 2.0])).all()


def gaussian_cell(shift_um, radius_um):
    """Return the reading of an ideal quadrant cell under a Gaussian spot (instruments.md section
    2)."""
    return np.array([math.erf(math.sqrt(2) * x / radius_um) for x in shift_um])


STRAIGHTNESS_UM = np.linspace(-650, 650, 27)


@pytest.mark.parametrize(("kind", "degree"), [("erf", 1), ("erf", 3), ("polynomial", 9)])
def test_quadrant_detector_is_straight_to_the_published_limit(kind, degree):
    """Feng 2008: +-1.5 µm over +-650 µm of straightness; the spot moves twice that. Reference noise
    0.3 µm, spot radius 2 mm."""
    shift = 2 * STRAIGHTNESS_UM
    noise = np.random.default_rng(3).normal(0, 0.3, len(shift))
    fit = fit_curve(gaussian_cell(shift + noise, 2000.0), shift, kind=kind, degree=degree)
    between = np.linspace(-1290, 1290, 401)
    error = fit.curve.shift_um(gaussian_cell(between, 2000.0)) - between
    assert np.abs(fit.residual_um / 2).max() < 1.5
    assert np.abs(error / 2).max() < 1.5


def test_straight_line_cannot_calibrate_a_quadrant_detector():
    """instruments.md section 2: a linear scale is wrong by tens of micrometres over the published
    range."""
    shift = 2 * STRAIGHTNESS_UM
    fit = fit_curve(gaussian_cell(shift, 2000.0), shift, kind="polynomial", degree=1)
    assert np.abs(fit.residual_um / 2).max() > 20.0


def test_angle_detector_is_straight_to_the_published_limit():
    """Feng 2008: +-1.5 arc-seconds over +-600; a lateral-effect detector with 0.5 % cubic
    distortion, f = 300 mm."""
    arcsec = np.linspace(-600, 600, 25)
    shift = 2 * 300e3 * np.tan(arcsec * np.pi / 648000)
    reading = shift / 5000 * (1 - 0.005 * (shift / 1745) ** 2)
    fit = fit_curve(reading, shift, degree=3)
    residual_arcsec = np.arctan(fit.residual_um / 600e3) / np.pi * 648000
    assert np.abs(residual_arcsec).max() < 1.5


def test_uncertainty_of_the_curve_holds_the_errors():
    """Over 200 calibrations with 0.5 µm of noise the curve's stated u covers its error in about two
    of three cases."""
    shift, rng = np.linspace(-500, 500, 15), np.random.default_rng(5)
    hits = [_covered(shift, shift + rng.normal(0, 0.5, 15)) for _ in range(200)]
    assert 0.6 < np.mean(hits) < 0.76


def _covered(shift, noisy):
    fit = fit_curve(shift / 1000, noisy, degree=3)
    return np.abs(fit.curve.shift_um(shift / 1000) - shift) < fit.u_um


def test_reference_uncertainty_is_never_lost():
    fit = fit_curve(
        np.linspace(-1, 1, 9) / 2, np.linspace(-500, 500, 9), degree=1, u_reference_um=0.4
    )
    assert fit.u_um == pytest.approx([0.4] * 9)
    assert fit.curve.u_um == pytest.approx(0.4)


def test_calibrated_curve_knows_where_it_ends():
    fit = fit_curve(np.linspace(-0.4, 0.4, 9), np.linspace(-500, 500, 9), degree=1)
    axis = DetectorAxis(curve=fit.curve)
    seen = spots(Detector(x=axis, y=axis), np.array([[0.3, 0.0], [0.5, 0.0]]), np.ones(2))
    assert seen.outside.tolist() == [False, True]


@pytest.mark.parametrize(
    ("reading", "shift", "options", "words"),
    [
        (np.linspace(-1, 1, 5), np.linspace(-1, 1, 5), {"degree": 5}, "at least 8 rows"),
        (
            np.linspace(-1, 1, 9),
            np.linspace(-1, 1, 9),
            {"degree": 1, "kind": "erf"},
            "found 7 such rows",
        ),
        (
            np.linspace(-1, 1, 9),
            np.linspace(-1, 1, 9) ** 2,
            {"degree": 2},
            "both rises and falls",
        ),
    ],
)
def test_calibration_run_that_decides_nothing_is_refused(reading, shift, options, words):
    with pytest.raises(DataError, match=words):
        fit_curve(reading, shift, **options)


def test_default_curve_is_a_plain_gain():
    assert Curve(coefficients_um=(0.0, 2000.0)).shift_um([0.5, -0.25]).tolist() == [
        1000.0,
        -500.0,
    ]
