"""How good the 4-DOF head must be: the paper's stability, calibration and comparison on the
ray-traced virtual head (Feng 2008, section 3).

Nothing of the equations is used to make the samples; the calibration used to evaluate them is found
from them as well.
"""

import math

import numpy as np
import pytest

from stepdiag.daq.survey.head_file import AxisTable
from stepdiag.fourdof.calibrated import calibrated as head_of
from stepdiag.fourdof.commissioning import (
    StageRun,
    calibrate_axis,
    compare_curves,
    stability_of,
    with_curve,
)
from stepdiag.fourdof.record import HeadRecord
from stepdiag.solver.fourdof.head import URAD_PER_ARCSEC, motion
from stepdiag.virtual.instruments.head import (
    Disturbance,
    HeadOptics,
    HeadStand,
    SpotDetector,
    VirtualHead,
    Wander,
)
from testkit.exact.heads import head_file
from testkit.ordinary.heads import stage_pose

BENCH = HeadStand(np.zeros(3), *np.eye(3)[[2, 0, 1]])
STILL = np.zeros((1, 2))
NOISE = SpotDetector(noise=2e-5)
OPTICS = HeadOptics(qd=NOISE, psd1=NOISE, psd2=NOISE)
"""Twenty parts per million of the full sum: 15 nm of straightness, 0.06 arc-seconds of the drift,
which are 2 µm at 8 m, a sample."""


def standing(
    distance_mm,
    seconds,
    *,
    pointing=0.0,
    bending=0.0,
    period_s=600.0,
    rate_hz=2.0,
    optics=OPTICS,
    seed=4,
):
    """Samples of a target that stands."""
    time = np.arange(0.0, seconds, 1 / rate_hz)
    disturbance = Disturbance(
        pointing_urad=Wander(amplitude=pointing, period_s=period_s, seed=seed),
        bending_urad_m=Wander(amplitude=bending, period_s=period_s, seed=seed + 1),
    )
    aligned = stage_pose(distance_mm, STILL, STILL, BENCH)
    head = VirtualHead(optics, BENCH, aligned, disturbance=disturbance, seed=seed)
    still = np.zeros((len(time), 2))
    return HeadRecord(
        time_s=time,
        channels=head.channels(stage_pose(distance_mm, still, still, BENCH), time).astype(
            float
        ),
    )


def at(distance_mm, shift_um=None, turn_urad=None, *, optics=OPTICS, seed=1):
    """Channels of a stage that shifts or turns, shape (N, 9)."""
    moved = np.atleast_2d(shift_um if shift_um is not None else np.zeros((len(turn_urad), 2)))
    turned = np.atleast_2d(turn_urad if turn_urad is not None else np.zeros((len(moved), 2)))
    head = VirtualHead(optics, BENCH, stage_pose(distance_mm, STILL, STILL, BENCH), seed=seed)
    return head.channels(
        stage_pose(distance_mm, 1e-3 * moved, turned, BENCH), np.zeros(len(moved))
    ).astype(float)


def far_file(distance_mm):
    """The ideal calibration with the QD's curve as it is where the beam has grown on its way out
    and back."""
    file = head_file()
    radius = float(OPTICS.spot_radius_mm(np.array([2 * distance_mm + OPTICS.qd_path_mm]))[0])
    for axis in ("x", "y"):
        file = file.with_axis(
            "qd",
            axis,
            AxisTable(
                kind="erf",
                coefficients_um=(0.0, 1e3 * radius / math.sqrt(2)),
                low=-0.9,
                high=0.9,
            ),
        )
    return file


def test_straightness_at_8_m_is_four_times_as_stable_where_the_pointing_drifts():
    """Feng 3.1, Fig. 5: 25 µm within 16 minutes become 12 µm at most."""
    record = standing(8000.0, 960.0, pointing=2.0)
    found = stability_of(record, far_file(8000.0), 8000.0, 1.0)
    raw = max(found[f"straightness {axis}"].raw_fluctuation for axis in "xy")
    assert 20.0 < raw < 30.0
    assert max(found[f"straightness {axis}"].compensated_fluctuation for axis in "xy") < 12.0
    assert min(found[f"straightness {axis}"].removed_percent for axis in "xy") > 50.0


def test_a_noisy_drift_detector_makes_nothing_worse():
    """1.7 urad of PSD1's noise in a mean of a second are 14 µm at 8 m: taken at its word it makes
    67 µm and more of 25; half are left."""
    noisy = SpotDetector(noise=1.8e-4)
    record = standing(
        8000.0, 960.0, pointing=2.0, optics=HeadOptics(qd=NOISE, psd1=noisy, psd2=NOISE)
    )
    found = stability_of(record, far_file(8000.0), 8000.0, 1.0)
    means = record.averaged(1.0)
    word = motion(means.channels, 8000.0, head_of(far_file(8000.0)))
    assert np.std(np.diff(word.drift_urad, axis=0)) / np.sqrt(2.0) == pytest.approx(
        1.7, rel=0.1
    )
    assert np.ptp(word.straightness_um, axis=0).min() > 67.0
    for axis in "xy":
        assert (
            found[f"straightness {axis}"].compensated_fluctuation
            < 0.75 * found[f"straightness {axis}"].raw_fluctuation
        )
        assert (
            found[f"angle {axis}"].compensated_fluctuation
            < found[f"angle {axis}"].raw_fluctuation
        )


def test_angles_at_10_m_fall_from_10_to_3_arc_seconds_where_the_pointing_drifts():
    """Feng 3.1, Fig. 6: 10 arc-seconds within 40 minutes become 3 at most. A drift of the beam
    counts half in the angle."""
    record = standing(10000.0, 2400.0, pointing=62.0)
    found = stability_of(record, far_file(10000.0), 10000.0, 1.0)
    assert 8.0 < max(found[f"angle {axis}"].raw_fluctuation for axis in "xy") < 12.0
    assert max(found[f"angle {axis}"].compensated_fluctuation for axis in "xy") < 3.0


def test_bending_air_is_the_stated_limit():
    """Theory 9: a cube sends bent light back as if unbent, PSD1 sees nothing: of 25 µm by air all
    remain, and of the angle too."""
    record = standing(8000.0, 960.0, bending=0.5)
    found = stability_of(record, far_file(8000.0), 8000.0, 30.0)
    for name, each in found.items():
        assert abs(each.removed_percent) < 5.0, name
    assert max(found[f"straightness {axis}"].raw_fluctuation for axis in "xy") > 10.0


def calibrated(distance_mm=500.0):
    """A file whose curves were found with a reference stage: 650 µm in 27 steps, 600 arc-seconds in
    25."""
    file = head_file()
    fits = {}
    for column, axis in enumerate("xy"):
        shift = np.zeros((27, 2))
        shift[:, column] = np.linspace(-650.0, 650.0, 27)
        channels = at(distance_mm, shift)
        run = StageRun(
            reading=channels[:, column] / channels[:, 2],
            reference=shift[:, column],
            unit="um",
        )
        fits["qd", axis] = calibrate_axis(run, "qd", file, degree=5, u_reference=0.1)
        turn = np.zeros((25, 2))
        turn[:, column] = np.linspace(-600.0, 600.0, 25) * URAD_PER_ARCSEC
        channels = at(distance_mm, turn_urad=turn)
        run = StageRun(
            reading=channels[:, 6 + column] / channels[:, 8],
            reference=turn[:, column] / URAD_PER_ARCSEC,
            unit="arcsec",
        )
        fits["psd2", axis] = calibrate_axis(run, "psd2", file, degree=3, u_reference=0.1)
    for (detector, axis), fit in fits.items():
        file = with_curve(file, detector, axis, fit)
    return file, fits


def test_calibration_residuals_are_within_the_published_limits():
    """Feng 3.2: +-1.5 µm over +-650 µm and +-1.5 arc-seconds over +-600; a quadrant under a
    Gaussian spot is 43 µm off a line there."""
    file, fits = calibrated()
    for (detector, axis), fit in fits.items():
        assert max(map(abs, fit.limits)) < 1.5, (detector, axis)
    assert file.qd.x.kind == "erf"
    shift = np.column_stack([np.linspace(-600.0, 600.0, 31), np.linspace(500.0, -500.0, 31)])
    seen = motion(at(500.0, shift, seed=9), 500.0, head_of(file)).straightness_um
    assert seen - seen[15] == pytest.approx(shift, abs=1.5)


def test_comparison_residuals_are_within_the_published_ones():
    """Feng 3.3: travel of 1 m in steps of 100 mm; -2.4 to 1.1 and +-3.9 µm, -1.8 to 1.3 and -2.8 to
    2.4 arc-seconds against a reference."""
    file, _ = calibrated()
    position = np.arange(0.0, 1001.0, 100.0)
    rng = np.random.default_rng(7)
    shift = 40.0 * np.sin(position[:, None] / 150.0 + [0.0, 1.0]) + rng.normal(size=(11, 2))
    turn = 60.0 * np.sin(position[:, None] / 200.0 + [2.0, 0.5])
    wander = Disturbance(pointing_urad=Wander(amplitude=10.0, period_s=300.0, seed=2))
    head = VirtualHead(
        OPTICS, BENCH, stage_pose(300.0, STILL, STILL, BENCH), disturbance=wander, seed=3
    )
    rows = [
        head.channels(
            stage_pose(300.0 + p, 1e-3 * s[None], a[None], BENCH), np.array([60.0 * i])
        )[0]
        for i, (p, s, a) in enumerate(zip(position, shift, turn, strict=True))
    ]
    seen = motion(np.array(rows, dtype=float), 300.0 + position, head_of(file))
    names = ("EXZ", "EYZ", "EBZ", "EAZ")
    ours = [*seen.straightness_um.T, *(seen.angle_urad.T / URAD_PER_ARCSEC)]
    truth = [*shift.T, *(turn.T / URAD_PER_ARCSEC)]
    found = compare_curves(
        {name: (position, value) for name, value in zip(names, ours, strict=True)},
        {name: (position, value) for name, value in zip(names, truth, strict=True)},
    )
    for name, (low, high) in {
        "EXZ": (-2.4, 1.1),
        "EYZ": (-3.9, 3.8),
        "EBZ": (-1.8, 1.3),
        "EAZ": (-2.8, 2.4),
    }.items():
        assert low < found[name].lowest <= found[name].highest < high, name
        assert found[name].rms < 1.0
