"""The optical model of the 4-DOF head against hand-traced rays and the theory notes, and its wire
formats."""

import binascii
import math
import struct

import numpy as np
import pytest

from stepdiag.virtual.bench.bench import VirtualBench
from stepdiag.virtual.bench.building import build_machine, head_builder
from stepdiag.virtual.bench.config import BenchConfig, HeadPart, load_config
from stepdiag.virtual.drive.sequence import Box, outward_stops_mm
from stepdiag.virtual.instruments.head import (
    Disturbance,
    HeadOptics,
    HeadStand,
    SpotDetector,
    VirtualHead,
    Wander,
    quadrant_response,
)
from stepdiag.virtual.instruments.head_wire import (
    FourdofHead,
    QuadrantDetector,
    frame_checksum,
)
from stepdiag.virtual.physics.kinematics import Pose, rotation_matrix
from testkit.ordinary.heads import stage_pose

BENCH = HeadStand(np.zeros(3), *np.eye(3)[[2, 0, 1]])
"""A head at the origin that looks along Z, right is X, up is Y."""
STILL = np.zeros((1, 2))


def spots(
    distance_mm, shift_mm=STILL, turn_urad=STILL, *, pointing=None, bending=None, optics=None
):
    """Spots of one pose; pointing and bending are steady lateral values."""

    class Steady(Wander):
        def at(self, time_s):
            return np.broadcast_to(self.value, (len(time_s), 2))

    def steady(value):
        wander = Steady()
        object.__setattr__(wander, "value", np.zeros(2) if value is None else np.array(value))
        return wander

    Steady.__slots__ = ()
    aligned = stage_pose(distance_mm, STILL, STILL, BENCH)
    disturbance = Disturbance(pointing_urad=steady(pointing), bending_urad_m=steady(bending))
    head = VirtualHead(optics or HeadOptics(), BENCH, aligned, disturbance=disturbance)
    return head.spots(
        stage_pose(distance_mm, np.atleast_2d(shift_mm), np.atleast_2d(turn_urad), BENCH),
        np.zeros(1),
    )


def test_a_shift_of_the_cube_moves_the_quadrant_spot_twice_as_far_and_nothing_else():
    """Feng section 2.2."""
    seen = spots(1000.0, shift_mm=(0.02, -0.03))
    assert seen.qd_mm[0] == pytest.approx([0.04, -0.06])
    assert seen.psd1_mm[0] == pytest.approx([0.0, 0.0], abs=1e-12)
    assert seen.psd2_mm[0] == pytest.approx([0.0, 0.0], abs=1e-12)


def test_a_turn_moves_only_the_mirror_spot_by_twice_the_angle():
    """Feng section 2.3: 2 f theta; the cube does not see a turn about its vertex."""
    seen = spots(1000.0, turn_urad=(50.0, -80.0))
    assert seen.psd2_mm[0] == pytest.approx([2 * 150.0 * 50e-6, -2 * 150.0 * 80e-6], rel=1e-6)
    assert seen.qd_mm[0] == pytest.approx([0.0, 0.0], abs=1e-9)
    assert seen.psd1_mm[0] == pytest.approx([0.0, 0.0], abs=1e-12)


def test_pointing_drift_shows_with_the_signs_of_the_theory():
    """Theory 9: QD = -2 L a, PSD1 = -a, PSD2 = +a; L is the way to the cube and half of the rest to
    the QD."""
    optics = HeadOptics(qd_path_mm=100.0)
    seen = spots(8000.0, pointing=(10.0, 0.0), optics=optics)
    assert seen.qd_mm[0, 0] == pytest.approx(-2 * 8050.0 * 10e-6)
    assert seen.psd1_mm[0, 0] == pytest.approx(-150.0 * 10e-6)
    assert seen.psd2_mm[0, 0] == pytest.approx(150.0 * 10e-6)


def test_bending_air_is_hidden_from_the_drift_detector():
    """Theory 9: 10 urad of bending over 8 m: PSD1 sees 0, the QD twice X_bend = 40 µm, PSD2 twice
    the angle."""
    seen = spots(8000.0, bending=(1250.0 / 1000.0, 0.0))
    assert seen.psd1_mm[0, 0] == pytest.approx(0.0, abs=1e-9)
    assert seen.qd_mm[0, 0] == pytest.approx(-2 * 0.040, rel=1e-6)
    assert seen.psd2_mm[0, 0] == pytest.approx(2 * 150.0 * 10e-6, rel=1e-6)


def test_a_roll_moves_a_cube_that_sits_off_the_axis():
    """Theory 9 (a): roll g with vertex offset (xv, yv): X -= g yv, Y += g xv."""
    aligned = stage_pose(1000.0, STILL, STILL, BENCH)
    head = VirtualHead(HeadOptics(), BENCH, aligned, vertex_mm=np.array([30.0, 0.0, 0.0]))
    rolled = Pose(aligned.origin_mm, rotation_matrix(np.array([[0.0, 0.0, 10e-6]])))
    assert head.spots(rolled, np.zeros(1)).qd_mm[0] == pytest.approx(
        [0.0, 2 * 30.0 * 10e-6], abs=1e-8
    )


def test_a_drift_detector_out_of_focus_sees_the_shift_of_the_beam():
    """Theory 9 (c): a thin lens 1 mm out of 150 mm focus lets 1/150 of the lateral shift
    through."""
    seen = spots(1000.0, shift_mm=(0.15, 0.0), optics=HeadOptics(psd1_defocus_mm=1.0))
    assert seen.psd1_mm[0, 0] == pytest.approx(-2 * 0.15 / 150.0)


@pytest.mark.parametrize(
    ("radius", "error_um"), [(1.0, -145.0), (1.5, -73.0), (2.0, -43.0), (3.0, -20.0)]
)
def test_a_quadrant_cell_is_as_curved_as_a_gaussian_spot_makes_it(radius, error_um):
    """Instruments 2: error of a line through the origin at 0.65 mm."""
    slope = 2.0 * math.sqrt(2.0 / math.pi) / radius
    reading = quadrant_response(np.array([0.65]), np.array([radius]))[0]
    assert (reading / slope - 0.65) * 1e3 == pytest.approx(error_um, abs=1.0)


def test_detectors_have_signs_roll_light_and_noise():
    detector = SpotDetector(sign=(-1.0, 1.0), rotation_mrad=100.0, full_sum=1000.0, noise=0.0)
    face = detector.face_mm(np.array([[1.0, 0.0]]))
    assert face[0] == pytest.approx([-math.cos(0.1), -math.sin(0.1)])
    counts = detector.counts(
        np.array([[0.5, -0.25]]), np.array([0.5]), np.random.default_rng(1)
    )
    assert counts.tolist() == [[250, -125, 500]]


def test_the_wander_stays_within_its_amplitude():
    moved = Wander(amplitude=5.0, period_s=60.0, seed=3).at(np.linspace(0.0, 3600.0, 20000))
    assert 3.0 < np.max(np.abs(moved)) <= 5.0


RUNS = [
    ("x", ("EYX", "EZX"), (("ECX", -1), ("EBX", 1))),
    ("y", ("EXY", "EZY"), (("ECY", -1), ("EAY", -1))),
    ("z", ("EXZ", "EYZ"), (("EBZ", -1), ("EAZ", 1))),
]
"""A mirror that faces +X and turns by C about Z sends the beam towards -Y by 2 C: the head sees b x
w in its right and up."""


@pytest.mark.parametrize(("axis", "straightness", "turns"), RUNS)
def test_a_run_sees_straightness_pitch_and_yaw_of_its_axis(axis, straightness, turns):
    """Feng Eqs 2 and 4 without drift: X = QD / 2, theta = PSD2 / (2 f); right is +Y, -X, +X, up is
    +Z, +Z, +Y."""
    config = load_config("[machine]\nangle_urad = 20.0\n")
    machine = build_machine(config)
    head = head_builder(config, HeadPart(), machine)(f"fourdof-{axis}")
    stops = outward_stops_mm(Box(), f"fourdof-{axis}")
    seen = head.spots(machine.pose(stops), np.zeros(len(stops)))
    truth = machine.truth(10)
    fraction = np.linspace(0.0, 1.0, 11)
    for lateral, name in enumerate(straightness):
        sign = -1.0 if (axis, lateral) == ("y", 0) else 1.0
        measured = seen.qd_mm[:, lateral] / 2.0 * 1e3 * sign
        shape = measured - measured[0] - fraction * (measured[-1] - measured[0])
        assert shape == pytest.approx(truth.errors[name], abs=0.01)
    for lateral, (name, sign) in enumerate(turns):
        measured = seen.psd2_mm[:, lateral] / (2.0 * 150.0) * 1e6
        assert measured - measured[0] == pytest.approx(sign * truth.errors[name], abs=0.05)


def look(wall_s):
    values = np.arange(-3, 6) * 1000
    return np.tile(values, (len(wall_s), 1))


def test_a_binary_frame_has_the_layout_of_its_document():
    head = FourdofHead(look)
    head.skip(7)
    frame = head.speak(np.zeros(1))
    assert len(frame) == 46
    assert frame[:4] == b"\xf4\xd0i\x00"
    assert struct.unpack_from("<I9i", frame, 4) == (
        7,
        -3000,
        -2000,
        -1000,
        0,
        1000,
        2000,
        3000,
        4000,
        5000,
    )
    assert struct.unpack_from("<H", frame, 44)[0] == binascii.crc_hqx(frame[2:44], 0xFFFF)


def test_an_ascii_frame_has_the_layout_of_its_document():
    frame = FourdofHead(look, encoding="ascii").speak(np.zeros(2)).split(b"\r\n")[1]
    body, _, crc = frame.partition(b"*")
    assert body == b"$4D,1,0,-3000,-2000,-1000,0,1000,2000,3000,4000,5000"
    assert int(crc, 16) == binascii.crc_hqx(body[1:], 0xFFFF)


def test_the_frame_checksum_is_the_standard_one():
    """CRC-16/CCITT-FALSE of "123456789" is 29B1h (catalogue check value)."""
    assert frame_checksum(b"123456789") == 0x29B1


def test_the_quadrant_detector_answers_its_one_question():
    """APT message 0871h parameter 3 (instruments 1.C): x inverted, differences over 10 V, the sum
    over 20 V."""
    detector = QuadrantDetector(
        lambda wall_s: np.array([[250, -125, 1000, 0, 0, 0, 0, 0, 0]]), full_sum=1000.0
    )
    ask = bytes.fromhex("710803005001")
    assert [detector.requests(piece) for piece in (ask[:4], ask[4:])] == [[], [ask]]
    answer = detector.answer(ask, 0.0)
    assert answer[:6] == bytes.fromhex("72080c008150")
    sub_id, x, y, total, _, _ = struct.unpack("<HhhHhh", answer[6:])
    assert sub_id == 3
    assert [x / 3276.7, y / 3276.7, total / 1638.35] == pytest.approx(
        [-2.0, -1.0, 8.0], abs=1e-3
    )
    assert detector.answer(bytes.fromhex("050000005001"), 0.0) == b""


def test_a_bench_with_a_head_has_its_line(tmp_path):
    bench = VirtualBench(BenchConfig(head=HeadPart()), tmp_path)
    bench.start()
    try:
        assert (tmp_path / "head").is_symlink()
        assert bench.addresses["head_link"] == str(tmp_path / "head")
    finally:
        bench.close()
    assert not (tmp_path / "head").is_symlink()
