"""Stability and comparison figures of the four-degree-of-freedom head."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from stepdiag.base.errors import DataError
from stepdiag.solver.fourdof.detector import Curve, Detector, DetectorAxis
from stepdiag.solver.fourdof.head import URAD_PER_ARCSEC, Head, motion
from stepdiag.solver.fourdof.statistics import allan_deviation, compare, stability
from testkit.exact.optics import RayHead, channels_of

LINEAR = DetectorAxis(curve=Curve(coefficients_um=(0.0, 5000.0)))
DETECTOR = Detector(x=LINEAR, y=LINEAR)


def wandering(distance_mm, pointing_urad, noise_um=0.3):
    """Return the motion that a head sees of a target that stands still while its source points
    about."""
    rng = np.random.default_rng(7)
    rays = RayHead(
        beam=np.array([0.0, 0, 1]),
        lateral_x=np.array([1.0, 0, 0]),
        lateral_y=np.array([0.0, 1, 0]),
    )
    shifts = np.array(
        [rays.shifts_um(distance_mm, pointing_urad=(angle, 0)) for angle in pointing_urad]
    )
    head = Head(
        qd=DETECTOR,
        psd1=DETECTOR,
        psd2=DETECTOR,
        psd1_focal_length_mm=300.0,
        psd2_focal_length_mm=300.0,
        dead_path_mm=distance_mm,
    )
    return motion(
        channels_of(shifts + rng.normal(0, noise_um, shifts.shape)),
        np.zeros(len(shifts)),
        head,
    )


def test_straightness_at_eight_metres_settles_as_published():
    """Feng 2008, 3.1: 25 µm fall to 12 µm or less at 8 m, where the drift is the source's pointing
    (detector noise 0.05 µm: the lever of 8 m makes 1.3 µm of it)."""
    pointing = 25 / 8 / 2 * np.sin(np.linspace(0, 12, 200))
    seen = wandering(8000.0, pointing, noise_um=0.05)
    figures = stability(seen.raw_straightness_um[:, 0], seen.straightness_um[:, 0], 5.0)
    assert figures.raw_fluctuation == pytest.approx(25.0, rel=0.05)
    assert figures.compensated_fluctuation < 12.0
    assert figures.removed_percent == pytest.approx(
        100 * (1 - figures.compensated_fluctuation / figures.raw_fluctuation)
    )


def test_angle_at_ten_metres_settles_as_published():
    """Feng 2008, 3.1: 10 arc-seconds fall to 3 or less at 10 m."""
    pointing = 10 * URAD_PER_ARCSEC * np.sin(np.linspace(0, 12, 200))
    seen = wandering(10000.0, pointing)
    figures = stability(
        seen.raw_angle_urad[:, 0] / URAD_PER_ARCSEC,
        seen.angle_urad[:, 0] / URAD_PER_ARCSEC,
        12.0,
    )
    assert figures.raw_fluctuation == pytest.approx(10.0, rel=0.1)
    assert figures.compensated_fluctuation < 3.0
    assert figures.removed_percent > 65.0


def test_compensation_that_makes_it_worse_is_negative():
    figures = stability(np.array([0.0, 1, 0]), np.array([0.0, 2, 0]), 1.0)
    assert figures.removed_percent == pytest.approx(-100.0)
    assert stability(np.zeros(3), np.ones(3), 1.0).removed_percent == 0.0


def test_allan_deviation_of_the_published_example():
    """NBS Monograph 140, Annex 8.E, nine frequencies: sigma(1) = 91.22945, overlapping sigma(2) =
    85.95287 (also NIST SP 1065, 12.4)."""
    values = np.array([892, 809, 823, 798, 671, 644, 883, 903, 677], dtype=float)
    tau, deviation = allan_deviation(values, 1.0)
    assert tau.tolist() == [1.0, 2.0, 4.0]
    assert deviation[:2] == pytest.approx([91.22945, 85.95287], abs=5e-6)


def test_white_noise_averages_down_and_a_ramp_does_not():
    """Allan deviation of white noise falls with the root of the time; of a ramp d it grows: d tau /
    sqrt 2."""
    tau, white = allan_deviation(np.random.default_rng(2).normal(0, 1, 4096), 0.1)
    assert white[:5] == pytest.approx(1 / np.sqrt(tau[:5] / 0.1), rel=0.1)
    tau, ramp = allan_deviation(0.5 * np.arange(256.0), 1.0)
    assert ramp == pytest.approx(0.5 * tau / np.sqrt(2))


profiles = arrays(np.float64, 11, elements=st.floats(-20, 20, width=32))
POSITION = np.linspace(0, 1000, 11)


@given(
    profiles,
    st.floats(-50, 50),
    st.floats(-50, 50),
    st.sampled_from(["end-point", "least-squares", "minimum-zone"]),
)
def test_straightness_comparison_ignores_how_the_reference_was_aligned(
    profile, offset, slope, line
):
    other = profile + offset + 1e-3 * slope * POSITION
    found = compare(POSITION, profile, POSITION, other, line)
    assert found.rms == pytest.approx(0.0, abs=1e-6)


def test_angle_comparison_is_relative_to_the_first_position():
    found = compare(
        [0.0, 100.0, 200.0], [5.0, 6.0, 9.0], [0.0, 100.0, 200.0], [1.0, 1.0, 1.0]
    )
    assert (found.lowest, found.highest) == (0.0, 4.0)
    assert found.rms == pytest.approx(np.sqrt(17 / 3))


def test_reference_is_read_between_its_positions_and_never_beyond():
    found = compare(
        [-50.0, 0.0, 50.0, 100.0, 150.0], [9.0, 0.0, 1.0, 2.0, 9.0], [100.0, 0.0], [2.0, 0.0]
    )
    assert found.position_mm.tolist() == [0.0, 50.0, 100.0]
    assert found.residual.tolist() == [0.0, 0.0, 0.0]


def test_reference_elsewhere_is_refused():
    with pytest.raises(DataError, match="within 500 to 600 mm"):
        compare([0.0, 100.0], [0.0, 0.0], [500.0, 600.0], [0.0, 0.0])


def test_series_of_different_length_are_refused():
    with pytest.raises(DataError, match="stability"):
        stability(np.zeros(3), np.zeros(4), 1.0)
