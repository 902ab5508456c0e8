"""Names and signs of the head's results on the machine, against rays that know nothing of
either."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from stepdiag.base.errors import UsageError
from stepdiag.solver.fourdof.axes import Mount, axis_errors
from stepdiag.solver.fourdof.detector import Curve, Detector, DetectorAxis
from stepdiag.solver.fourdof.head import Head, motion
from testkit.exact.optics import RayHead, channels_of

AXES = "xyz"
LINEAR = DetectorAxis(curve=Curve(coefficients_um=(0.0, 5000.0)))
DETECTOR = Detector(x=LINEAR, y=LINEAR)
HEAD = Head(
    qd=DETECTOR,
    psd1=DETECTOR,
    psd2=DETECTOR,
    psd1_focal_length_mm=300.0,
    psd2_focal_length_mm=300.0,
    dead_path_mm=300.0,
)


def unit(direction):
    vector = np.zeros(3)
    vector[AXES.index(direction[1])] = 1.0 if direction[0] == "+" else -1.0
    return vector


@st.composite
def mounts(draw):
    axis, first, second = draw(st.permutations(list(AXES)))
    sign = st.sampled_from("+-")
    return Mount(
        axis=axis,
        beam=draw(sign) + axis,
        detector_x=draw(sign) + first,
        detector_y=draw(sign) + second,
        target_on=draw(st.sampled_from(["tool", "work"])),
    )


@given(mounts(), st.integers(0, 2**32 - 1))
def test_run_gives_back_the_errors_of_the_machine(mount, seed):
    """Every axis, mounting and side: rays are traced with the target's true pose, names come out
    with ISO 230-1 signs."""
    rng = np.random.default_rng(seed)
    position = np.linspace(0, 400, 5)
    displacement_um, rotation_urad = (
        rng.uniform(-20, 20, (5, 3)),
        rng.uniform(-30, 30, (5, 3)),
    )
    rotation_urad[:, AXES.index(mount.axis)] = 0.0
    side = 1 if mount.target_on == "tool" else -1
    rays = RayHead(
        beam=unit(mount.beam),
        lateral_x=unit(mount.detector_x),
        lateral_y=unit(mount.detector_y),
    )
    # a target on the work side travels against the axis coordinate
    travel = side * (1 if mount.beam[0] == "+" else -1) * position
    travel = travel - travel.min()
    shifts = [
        rays.shifts_um(
            300 + d,
            shift_mm=1e-3 * side * e,
            turn_urad=side * w,
            pointing_urad=rng.uniform(-30, 30, 2),
        )
        for d, e, w in zip(travel, displacement_um, rotation_urad, strict=True)
    ]
    seen = motion(channels_of(np.array(shifts)), travel, HEAD)
    found = axis_errors(position, seen.straightness_um, seen.angle_urad, mount)
    lateral = [axis for axis in AXES if axis != mount.axis]
    assert set(found.straightness_um) == {
        f"E{axis.upper()}{mount.axis.upper()}" for axis in lateral
    }
    assert set(found.rotation_urad) == {
        f"E{'ABC'[AXES.index(axis)]}{mount.axis.upper()}" for axis in lateral
    }
    for axis in lateral:
        column = AXES.index(axis)
        truth = displacement_um[:, column]
        line = truth[0] + (truth[-1] - truth[0]) * position / 400
        assert found.straightness_um[f"E{axis.upper()}{mount.axis.upper()}"] == pytest.approx(
            truth - line, abs=0.02
        )
        turned = rotation_urad[:, column] - rotation_urad[0, column]
        assert found.rotation_urad[f"E{'ABC'[column]}{mount.axis.upper()}"] == pytest.approx(
            turned, abs=0.02
        )


def test_repeated_positions_are_averaged():
    """Two passes of 1 and 3 urad: mean 2."""
    mount = Mount(axis="x", beam="+x", detector_x="+y", detector_y="+z")
    angle = np.array([[0.0, 0], [1.0, 0], [3.0, 0], [0.0, 0]])
    found = axis_errors(np.array([0.0, 100.0, 100.0, 0.0]), np.zeros((4, 2)), angle, mount)
    assert found.position_mm.tolist() == [0.0, 100.0]
    # y x beam(+x) = -z: yaw is minus the head's angle in y
    assert found.rotation_urad["ECX"].tolist() == [0.0, -2.0]


@pytest.mark.parametrize(
    ("beam", "second", "field"), [("+y", "+z", "beam"), ("+x", "-y", "three different axes")]
)
def test_mounting_that_cannot_be_is_refused(beam, second, field):
    with pytest.raises(UsageError, match=field):
        Mount(axis="x", beam=beam, detector_x="+y", detector_y=second)
