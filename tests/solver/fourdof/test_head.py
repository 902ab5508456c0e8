"""The head's equations against exact ray tracing; what blocked and blinded detectors do."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from stepdiag.solver.fourdof.detector import Curve, Detector, DetectorAxis
from stepdiag.solver.fourdof.head import (
    URAD_PER_ARCSEC,
    Crosstalk,
    Head,
    beam_angle_urad,
    motion,
)
from testkit.exact.optics import RayHead, channels_of

LINEAR = DetectorAxis(curve=Curve(coefficients_um=(0.0, 5000.0)))
DETECTOR = Detector(x=LINEAR, y=LINEAR, sum_min=0.5, sum_max=9.0)
FOCAL = {"psd1_focal_length_mm": 300.0, "psd2_focal_length_mm": 300.0}
Z_BEAM = {
    "beam": np.array([0.0, 0, 1]),
    "lateral_x": np.array([1.0, 0, 0]),
    "lateral_y": np.array([0.0, 1, 0]),
}


def head(**changes):
    return Head(
        **{
            "qd": DETECTOR,
            "psd1": DETECTOR,
            "psd2": DETECTOR,
            "dead_path_mm": 300.0,
            **FOCAL,
            **changes,
        }
    )


def test_angle_of_the_beam_by_equation_1():
    """Feng Eq. 1: tan(alpha) = dx / f; 30 arc-seconds at f = 300 mm are 43.63 µm (theory.md 9: 1
    arc-second = 4.8481 urad)."""
    assert pytest.approx(4.848136811095, abs=1e-9) == URAD_PER_ARCSEC
    assert beam_angle_urad(43.633, 300.0) / URAD_PER_ARCSEC == pytest.approx(30.0, abs=1e-3)


def test_equations_2_to_5_by_hand():
    """Lever 1000 mm, drift seen 10 urad, QD 30 µm, PSD2 50 urad: 30/2 - 10 = 5 µm and (50 + 10)/2 =
    30 urad."""
    shifts = [30.0, 0.0, 3.0, 0.0, 15.0, 0.0]
    found = motion(channels_of(shifts), [700.0], head())
    assert found.straightness_um[0] == pytest.approx([5.0, 0.0], abs=1e-6)
    assert found.angle_urad[0] == pytest.approx([30.0, 0.0], abs=1e-6)
    assert found.raw_straightness_um[0, 0] == pytest.approx(15.0)
    assert found.raw_angle_urad[0, 0] == pytest.approx(25.0)
    assert found.drift_urad[0, 0] == pytest.approx(10.0)


small = st.floats(-50, 50)


@given(small, small, small, small, small, small, st.floats(0, 3000), st.floats(0, 400))
def test_drift_of_the_source_vanishes_from_all_four(
    x_um, y_um, a_urad, b_urad, drift_x, drift_y, travel_mm, extra_mm
):
    """Exact rays: 50 urad of pointing at 3 m would be 170 µm of straightness; second order leaves
    nanometres."""
    rays = RayHead(**Z_BEAM, extra_mm=extra_mm)
    shifts = rays.shifts_um(
        300.0 + travel_mm,
        shift_mm=(1e-3 * x_um, 1e-3 * y_um, 0),
        turn_urad=(a_urad, b_urad, 0),
        pointing_urad=(drift_x, drift_y),
    )
    found = motion(channels_of(shifts), [travel_mm], head(extra_path_mm=extra_mm))
    assert found.straightness_um[0] == pytest.approx([x_um, y_um], abs=2e-3)
    # a mirror that turns by w deflects the beam b by 2 b x w: here (-w_y, +w_x)
    assert found.angle_urad[0] == pytest.approx([-b_urad, a_urad], abs=2e-3)
    assert found.drift_urad[0] == pytest.approx([-drift_x, -drift_y], abs=1e-3)


def test_lever_is_the_whole_way_and_not_the_travel():
    """theory.md 9: leaving out a dead path of 0.3 m at 10 arc-seconds of drift costs 14.5 um."""
    shifts = RayHead(**Z_BEAM).shifts_um(300.0, pointing_urad=(10 * URAD_PER_ARCSEC, 0))
    wrong = motion(channels_of(shifts), [0.0], head(dead_path_mm=0.0)).straightness_um[0, 0]
    assert abs(wrong) == pytest.approx(14.5, abs=0.1)
    assert motion(channels_of(shifts), [0.0], head()).straightness_um[0, 0] == pytest.approx(
        0.0, abs=1e-6
    )


@given(st.tuples(*[st.sampled_from([1, -1])] * 6))
def test_fold_mirrors_are_undone_by_six_signs(signs):
    shifts = RayHead(**Z_BEAM).shifts_um(
        800.0, shift_mm=(0.01, -0.02, 0), turn_urad=(5, 7, 0), pointing_urad=(30, -20)
    )
    axes = [DetectorAxis(sign=sign, curve=LINEAR.curve) for sign in signs]
    folded = {
        name: Detector(x=axes[2 * i], y=axes[2 * i + 1])
        for i, name in enumerate(("qd", "psd1", "psd2"))
    }
    found = motion(channels_of(shifts * np.array(signs)), [500.0], head(**folded))
    assert found.straightness_um[0] == pytest.approx([10.0, -20.0], abs=1e-3)
    assert found.angle_urad[0] == pytest.approx([-7.0, 5.0], abs=1e-3)


def test_power_of_the_laser_is_no_shift():
    shifts = RayHead(**Z_BEAM).shifts_um(500.0, shift_mm=(0.1, 0.05, 0))
    bright, dim = (
        motion(channels_of(shifts, power=power), [200.0], head()) for power in (6.0, 0.6)
    )
    assert bright.straightness_um == pytest.approx(dim.straightness_um)


def test_cube_off_the_reference_point_is_corrected():
    """theory.md 9: 30 mm of lateral offset and 10 urad of roll are 0.3 µm; 40 mm along the beam and
    50 urad of pitch 2 um."""
    vertex = np.array([20.0, 30.0, -40.0])
    shifts = RayHead(**Z_BEAM, vertex_mm=vertex).shifts_um(500.0, turn_urad=(50.0, 0, 10.0))
    plain = motion(channels_of(shifts), [160.0], head()).straightness_um[0]
    assert plain == pytest.approx([-0.3, 0.2 + 2.0], abs=1e-3)
    # the head counts the offset along the beam as positive towards itself: 40 mm here
    known = head(crosstalk=Crosstalk(vertex_mm=(20.0, 30.0, 40.0)))
    assert motion(channels_of(shifts), [160.0], known, roll_urad=[10.0]).straightness_um[
        0
    ] == pytest.approx([0, 0], abs=1e-3)


def test_detector_that_is_rolled_is_turned_back():
    angle = 0.1
    shifts = RayHead(**Z_BEAM).shifts_um(500.0, shift_mm=(0.1, 0.05, 0))
    rolled = shifts.copy()
    rolled[:2] = [
        np.cos(angle) * shifts[0] + np.sin(angle) * shifts[1],
        -np.sin(angle) * shifts[0] + np.cos(angle) * shifts[1],
    ]
    turned = Detector(x=LINEAR, y=LINEAR, rotation_mrad=100.0)
    assert motion(channels_of(rolled), [200.0], head(qd=turned)).straightness_um[
        0
    ] == pytest.approx([100.0, 50.0])


def test_gain_that_grows_with_the_distance_is_divided_out():
    """The spot grows with the distance, so a QD calibrated at 500 mm reads 2 % less per metre
    farther out."""
    shifts = RayHead(**Z_BEAM).shifts_um(1500.0, shift_mm=(0.1, 0.0, 0))
    shifts[:2] *= 0.98
    known = head(crosstalk=Crosstalk(qd_gain_per_m=(-0.02, -0.02), qd_calibrated_at_mm=500.0))
    assert motion(channels_of(shifts), [1200.0], known).straightness_um[
        0, 0
    ] == pytest.approx(100.0)


def test_detectors_out_of_focus_are_corrected():
    """A PSD off its focal plane takes a lateral beam shift for an angle (theory.md 9, crosstalk
    c)."""
    rays = RayHead(**Z_BEAM)
    shifts = rays.shifts_um(1000.0, shift_mm=(0.1, 0, 0), turn_urad=(0, 100.0, 0))
    leak = 0.05
    shifts[2] += 300.0 * 1e-3 * leak * shifts[0]
    shifts[4] += 300.0 * 1e-3 * leak * (-200.0)
    known = head(crosstalk=Crosstalk(psd1_leak=(leak, 0), psd2_leak=(leak, 0)))
    found = motion(channels_of(shifts), [700.0], known)
    assert found.straightness_um[0, 0] == pytest.approx(100.0, abs=1e-2)
    assert found.angle_urad[0, 0] == pytest.approx(-100.0, abs=1e-2)


def test_bending_air_is_not_undone():
    """theory.md 9: a static index gradient shows nothing on PSD1, so 80 µm on the QD stay 40 µm of
    straightness."""
    found = motion(channels_of([80.0, 0, 0, 0, 0, 0]), [7700.0], head())
    assert found.straightness_um[0, 0] == pytest.approx(40.0)


def test_uncertainty_of_the_calibration_reaches_the_result():
    """QD 1 µm, PSDs 0.3 µm at 300 mm (1 urad) at a lever of 1 m: hypot(0.5, 1) um and hypot(1, 1)/2
    urad."""
    axes = [
        DetectorAxis(curve=Curve(coefficients_um=(0, 5000.0), u_um=u)) for u in (1.0, 0.3)
    ]
    qd, psd = (Detector(x=axis, y=axis) for axis in axes)
    found = motion(channels_of(np.zeros(6)), [700.0], head(qd=qd, psd1=psd, psd2=psd))
    assert found.u_straightness_um[0] == pytest.approx([np.hypot(0.5, 1.0)] * 2)
    assert found.u_angle_urad[0] == pytest.approx([np.sqrt(0.5)] * 2)


def spoiled(row, column, value):
    channels = channels_of(np.zeros((4, 6)))
    channels[row, column] = value
    return channels


@pytest.mark.parametrize(
    ("channels", "code", "words"),
    [
        (
            spoiled(2, 2, 0.1),
            "fourdof-beam-blocked",
            "QD: no light in 1 of 4 samples, first in sample 2",
        ),
        (
            spoiled(0, 5, float("nan")),
            "fourdof-beam-blocked",
            "PSD1: no light in 1 of 4 samples, first in sample 0",
        ),
        (
            spoiled(1, 8, 9.9),
            "fourdof-out-of-range.saturated",
            "PSD2: saturated in 1 of 4 samples, first in sample 1",
        ),
        (
            spoiled(3, 0, 3.5),
            "fourdof-out-of-range.saturated",
            "QD: saturated in 1 of 4 samples, first in sample 3",
        ),
    ],
)
def test_sample_without_usable_light_is_named_and_empty(channels, code, words):
    found = motion(channels, np.zeros(4), head())
    assert [(finding.key, finding.text) for finding in found.findings] == [(code, words)]
    bad = ~found.usable
    assert bad.sum() == 1
    assert np.isfinite(found.angle_urad[found.usable]).all()
    assert not (
        np.isfinite(found.straightness_um[bad]).all()
        and np.isfinite(found.angle_urad[bad]).all()
    )


@pytest.mark.parametrize(
    ("shifts", "key", "words"),
    [
        ([1310.0, 0, 0, 0, 0, 0], "straightness", "straightness beyond +-650 µm"),
        ([0, 0, 0, 0, 0, 1800.0], "angle", "angle beyond +-600 arc-seconds"),
    ],
)
def test_motion_beyond_the_published_range_is_reported(shifts, key, words):
    """Feng 2008, abstract: calibrated over +-650 µm and +-600 arc-seconds."""
    found = motion(channels_of(shifts), [0.0], head())
    assert [finding.key for finding in found.findings] == [f"fourdof-out-of-range.{key}"]
    assert found.findings[0].text.startswith(words)
    assert not found.usable[0]


def test_reading_beyond_the_calibrated_curve_is_not_usable():
    axis = DetectorAxis(curve=Curve(coefficients_um=(0, 5000.0), low=-0.1, high=0.1))
    found = motion(
        channels_of([600.0, 0, 0, 0, 0, 0]), [0.0], head(qd=Detector(x=axis, y=axis))
    )
    assert [finding.key for finding in found.findings] == [
        "fourdof-out-of-range.uncalibrated"
    ]
    assert not found.usable[0]
