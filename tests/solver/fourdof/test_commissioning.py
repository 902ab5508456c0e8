"""Signs and lever from a wobbling beam; detector curves from a reference stage."""

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from stepdiag.base.errors import DataError
from stepdiag.solver.fourdof.commissioning import Standstill, fit_curve, lever_line, signs_and_lever
from stepdiag.solver.fourdof.detector import Curve, Detector, DetectorAxis, inverse_erf, spots
from testkit.exact.optics import RayHead

WOBBLE_URAD = 60 * np.sin(np.linspace(0, 9, 40))


def standstill(travel_mm, *, dead_mm=320.0, extra_mm=60.0, signs=(1, 1), noise_um=0.0, psd1_gain=1.0):
    rays = RayHead(beam=np.array([0.0, 0, 1]), lateral_x=np.array([1.0, 0, 0]), lateral_y=np.array([0.0, 1, 0]), extra_mm=extra_mm)
    shifts = np.array([rays.shifts_um(dead_mm + travel_mm, pointing_urad=(wobble, 0)) for wobble in WOBBLE_URAD])
    noise = np.random.default_rng(1).normal(0, noise_um, (len(shifts), 2)) if noise_um else np.zeros((len(shifts), 2))
    return Standstill(
        travel_mm=travel_mm,
        qd_um=shifts[:, 0] + noise[:, 0],
        psd1_urad=psd1_gain * signs[0] * shifts[:, 2] / 0.3,
        psd2_urad=signs[1] * shifts[:, 4] / 0.3 + noise[:, 1],
    )


@pytest.mark.parametrize("signs", [(1, 1), (1, -1), (-1, 1), (-1, -1)])
def test_signs_and_lever_from_two_distances(signs):
    """Lever = dead path 320 mm + travel + half of the 60 mm to the QD (theory.md 9)."""
    found = signs_and_lever([standstill(distance, signs=signs) for distance in (0.0, 1000.0)])
    assert (found.psd1_sign, found.psd2_sign) == signs
    assert found.lever_mm == pytest.approx([350.0, 1350.0], abs=1e-3)
    assert (found.dead_path_mm, found.lever_scale) == pytest.approx((350.0, 1.0), abs=1e-3)
    assert found.angle_gain == pytest.approx(1.0, abs=1e-6)


def test_noise_is_in_the_uncertainty():
    found = signs_and_lever([standstill(distance, noise_um=1.0) for distance in (0.0, 1000.0)])
    assert abs(found.dead_path_mm - 350.0) < 3 * found.u_dead_path_mm
    # half of 1 µm over the rms wobble and the root of the number of samples
    expected_mm = 1e3 * 0.5 / np.linalg.norm(WOBBLE_URAD - WOBBLE_URAD.mean())
    assert found.u_lever_mm == pytest.approx([expected_mm] * 2, rel=0.3)


def noisy(travel_mm, seed, noise_um=1.0):
    """Return a wobble that all three detectors see, the quadrant detector with noise of its own."""
    rng, pointing = np.random.default_rng(seed), WOBBLE_URAD
    shift = 2e-3 * (350.0 + travel_mm) * pointing + rng.normal(0, noise_um, len(pointing))
    return Standstill(travel_mm=travel_mm, qd_um=shift, psd1_urad=pointing, psd2_urad=-pointing)


def test_uncertainty_of_a_lever_is_that_of_a_regression():
    """Where both angle detectors see the same, the slope is the one of least squares: s / sqrt(sum of squares), s over n - 2."""
    one = noisy(500.0, 7)
    found = signs_and_lever([one])
    x, y = one.psd1_urad - one.psd1_urad.mean(), one.qd_um / 2 - one.qd_um.mean() / 2
    slope = x @ y / (x @ x)
    u = np.sqrt(np.sum((y - slope * x) ** 2) / (len(x) - 2) / (x @ x))
    assert found.lever_mm == pytest.approx([1e3 * slope])
    assert found.u_lever_mm == pytest.approx([1e3 * u])
    assert (found.psd1_sign, found.psd2_sign) == (1, 1)
    assert found.dead_path_mm == pytest.approx(1e3 * slope - 500.0)
    assert found.u_dead_path_mm == pytest.approx(1e3 * u)


def test_wobbles_at_one_distance_are_weighed_by_their_uncertainty():
    found = signs_and_lever([noisy(500.0, 7, noise_um=0.5), noisy(500.0, 8, noise_um=2.0)])
    weight = found.u_lever_mm**-2
    assert found.dead_path_mm == pytest.approx(np.sum(weight * (found.lever_mm - 500.0)) / np.sum(weight))
    assert found.u_dead_path_mm == pytest.approx(np.sum(weight) ** -0.5)
    assert (found.lever_scale, found.u_lever_scale) == (1.0, None)


def test_through_two_distances_the_line_is_exact_and_its_uncertainty_that_of_its_ends():
    found = signs_and_lever([noisy(0.0, 7), noisy(800.0, 8)])
    assert found.dead_path_mm == pytest.approx(found.lever_mm[0])
    assert found.u_dead_path_mm == pytest.approx(found.u_lever_mm[0])
    assert found.lever_scale == pytest.approx((found.lever_mm[1] - found.lever_mm[0]) / 800.0)
    assert found.u_lever_scale == pytest.approx(np.hypot(*found.u_lever_mm) / 800.0)


def test_how_far_the_beam_wobbles_does_not_matter_where_nothing_else_moves():
    """A thousandth of the wobble, without noise: the same lever."""
    one = noisy(500.0, 7, noise_um=0.0)
    small = {name: 1e-3 * getattr(one, name) for name in ("qd_um", "psd1_urad", "psd2_urad")}
    assert signs_and_lever([replace(one, **small)]).lever_mm == pytest.approx([850.0])


def test_three_samples_tell_a_sign_and_two_do_not():
    def first(count):
        one = noisy(0.0, 7, noise_um=0.0)
        return Standstill(travel_mm=0.0, **{name: getattr(one, name)[:count] for name in ("qd_um", "psd1_urad", "psd2_urad")})

    assert signs_and_lever([first(3)]).lever_mm == pytest.approx([350.0])
    with pytest.raises(DataError, match=r"over 3 samples or more, found 0\.00 over 2"):
        signs_and_lever([first(2)])


@pytest.mark.parametrize("gain", [0.96, 1.04, 0.94, 1.06])
def test_a_gain_is_refused_from_five_percent_on(gain):
    """What a detector reads too strongly makes the lever grow too little, and the other detector answer too little."""
    one, other = (noisy(travel, 7, noise_um=0.0) for travel in (0.0, 1000.0))
    wobbles = [replace(each, psd1_urad=gain * each.psd1_urad) for each in (one, other)]
    if abs(gain - 1) < 0.05:
        found = signs_and_lever(wobbles)
        assert (found.lever_scale, found.angle_gain) == pytest.approx((1 / gain, 1 / gain))
        return
    with pytest.raises(DataError, match=rf"gains from 0.95 to 1.05, found a lever that grows {1 / gain:.3f} mm per mm of distance"):
        signs_and_lever(wobbles)
    with pytest.raises(DataError, match=rf"found PSD2 answers {1 / gain:.3f} times as strongly as PSD1"):
        signs_and_lever(wobbles[:1])


def test_swapped_distances_are_refused_by_name():
    """A lever of -1 mm per mm was written, and no reader took the file."""
    near, far = noisy(0.0, 7, noise_um=0.0), noisy(1000.0, 7, noise_um=0.0)
    with pytest.raises(DataError, match=r"grows -1\.000 mm per mm of distance; .* are the distances swapped"):
        signs_and_lever([replace(near, travel_mm=1000.0), replace(far, travel_mm=0.0)])


def test_noise_of_the_drift_detector_does_not_shorten_the_lever():
    """A wobble of 42 urad rms and 10 urad of PSD1 noise: least squares would find a lever 5 % short, of every distance."""
    found = []
    for seed in range(40):
        one = standstill(1000.0)
        noise = np.random.default_rng(seed).normal(0, 10.0, len(one.psd1_urad))
        lever = signs_and_lever([Standstill(travel_mm=1000.0, qd_um=one.qd_um, psd1_urad=one.psd1_urad + noise, psd2_urad=one.psd2_urad)])
        found.append((lever.lever_mm[0], lever.u_lever_mm[0]))
    values, u = np.array(found).T
    assert np.mean(values) == pytest.approx(1350.0, rel=0.02)
    assert np.std(values) == pytest.approx(np.mean(u), rel=0.35)


def test_the_line_of_the_lever_says_how_far_it_can_be_trusted():
    """Two levers of u 3 and 4 mm at 0 and 1000 mm: dead path and scale as the two points have it, u as the law of propagation has it."""
    line = lever_line(np.array([0.0, 1000.0]), np.array([350.0, 1349.0]), np.array([3.0, 4.0]))
    assert (line.dead_path_mm, line.scale) == pytest.approx((350.0, 0.999))
    assert line.u_scale == pytest.approx(5e-3)
    for distance, u in ((0.0, 3.0), (1000.0, 4.0), (8000.0, np.hypot(7 * 3.0, 8 * 4.0))):
        assert line.u_at(distance) == pytest.approx(u)


def test_one_distance_assumes_that_the_lever_grows_with_the_travel():
    found = signs_and_lever([standstill(500.0)])
    assert (found.lever_scale, found.u_lever_scale) == (1.0, None)
    assert found.dead_path_mm == pytest.approx(350.0, abs=1e-3)


def test_a_gain_that_noise_may_have_made_is_not_refused():
    """PSD2 with noise of a tenth of the wobble, 40 times: no refusal, though the gain is off by up to 7 per cent."""
    for seed in range(40):
        one = standstill(1000.0)
        noise = np.random.default_rng(seed).normal(0, 10.0, len(one.psd1_urad))
        signs_and_lever([replace(one, psd2_urad=one.psd2_urad + noise)])


def test_still_beam_tells_no_sign():
    quiet = Standstill(travel_mm=0.0, qd_um=np.array([0.0, 1, -1, 0]), psd1_urad=np.array([1.0, 0, 0, -1]), psd2_urad=np.zeros(4))
    with pytest.raises(DataError, match="wobble"):
        signs_and_lever([quiet])


def test_distances_that_contradict_each_other_are_refused():
    with pytest.raises(DataError, match="one sign at every distance"):
        signs_and_lever([standstill(0.0), standstill(1000.0, signs=(-1, 1))])


@given(st.floats(-0.9999, 0.9999))
def test_inverse_error_function_inverts(value):
    assert math.erf(float(inverse_erf(value))) == pytest.approx(value, abs=1e-12)


def test_inverse_error_function_has_no_value_at_the_edge():
    assert np.isnan(inverse_erf([1.0, -1.0, 2.0])).all()


def gaussian_cell(shift_um, radius_um):
    """Return the reading of an ideal quadrant cell under a Gaussian spot (instruments.md section 2)."""
    return np.array([math.erf(math.sqrt(2) * x / radius_um) for x in shift_um])


STRAIGHTNESS_UM = np.linspace(-650, 650, 27)


@pytest.mark.parametrize(("kind", "degree"), [("erf", 1), ("erf", 3), ("polynomial", 9)])
def test_quadrant_detector_is_straight_to_the_published_limit(kind, degree):
    """Feng 2008: +-1.5 µm over +-650 µm of straightness; the spot moves twice that. Reference noise 0.3 µm, spot radius 2 mm."""
    shift = 2 * STRAIGHTNESS_UM
    noise = np.random.default_rng(3).normal(0, 0.3, len(shift))
    fit = fit_curve(gaussian_cell(shift + noise, 2000.0), shift, kind=kind, degree=degree)
    between = np.linspace(-1290, 1290, 401)
    error = fit.curve.shift_um(gaussian_cell(between, 2000.0)) - between
    assert np.abs(fit.residual_um / 2).max() < 1.5
    assert np.abs(error / 2).max() < 1.5


def test_straight_line_cannot_calibrate_a_quadrant_detector():
    """instruments.md section 2: a linear scale is wrong by tens of micrometres over the published range."""
    shift = 2 * STRAIGHTNESS_UM
    fit = fit_curve(gaussian_cell(shift, 2000.0), shift, kind="polynomial", degree=1)
    assert np.abs(fit.residual_um / 2).max() > 20.0


def test_angle_detector_is_straight_to_the_published_limit():
    """Feng 2008: +-1.5 arc-seconds over +-600; a lateral-effect detector with 0.5 % cubic distortion, f = 300 mm."""
    arcsec = np.linspace(-600, 600, 25)
    shift = 2 * 300e3 * np.tan(arcsec * np.pi / 648000)
    reading = shift / 5000 * (1 - 0.005 * (shift / 1745) ** 2)
    fit = fit_curve(reading, shift, degree=3)
    residual_arcsec = np.arctan(fit.residual_um / 600e3) / np.pi * 648000
    assert np.abs(residual_arcsec).max() < 1.5


def test_uncertainty_of_the_curve_holds_the_errors():
    """Over 200 calibrations with 0.5 µm of noise the curve's stated u covers its error in about two of three cases."""
    shift, rng = np.linspace(-500, 500, 15), np.random.default_rng(5)
    hits = [_covered(shift, shift + rng.normal(0, 0.5, 15)) for _ in range(200)]
    assert 0.6 < np.mean(hits) < 0.76


def _covered(shift, noisy):
    fit = fit_curve(shift / 1000, noisy, degree=3)
    return np.abs(fit.curve.shift_um(shift / 1000) - shift) < fit.u_um


def test_reference_uncertainty_is_never_lost():
    fit = fit_curve(np.linspace(-1, 1, 9) / 2, np.linspace(-500, 500, 9), degree=1, u_reference_um=0.4)
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
        (np.linspace(-1, 1, 9), np.linspace(-1, 1, 9), {"degree": 1, "kind": "erf"}, "found 7 such rows"),
        (np.linspace(-1, 1, 9), np.linspace(-1, 1, 9) ** 2, {"degree": 2}, "turns back"),
    ],
)
def test_calibration_run_that_decides_nothing_is_refused(reading, shift, options, words):
    with pytest.raises(DataError, match=words):
        fit_curve(reading, shift, **options)


def test_default_curve_is_a_plain_gain():
    assert Curve(coefficients_um=(0.0, 2000.0)).shift_um([0.5, -0.25]).tolist() == [1000.0, -500.0]
