"""What the virtual lasers put on the wire, read back by the rules of the instruments' notes written
out in the test."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from stepdiag.virtual.instruments.laser_source import Counter
from stepdiag.virtual.instruments.lasers import BOARDS, AsciiLine, NdDisplay, UmdBoard

COUNT_MM = 632.991e-6 / 2


def fields(data: bytes) -> np.ndarray:
    assert data.endswith(b"\r\n")
    return np.array(
        [[int(word) for word in line.split(b" ")] for line in data[:-2].split(b"\r\n")]
    )


def sent(board: UmdBoard, readings, beam=None):
    readings = np.asarray(readings, dtype=float)
    present = np.ones(len(readings), dtype=bool) if beam is None else np.asarray(beam)
    return fields(board.encode(readings, present))


@given(st.lists(st.floats(-2000.0, 2000.0), min_size=1, max_size=20))
@pytest.mark.parametrize(("name", "steps"), [("umd1", 256), ("umd2", 65536)])
def test_a_heterodyne_reading_is_count_minus_phase(name, steps, readings):
    """Rule of the GUI (instruments 1.A): (D - phase/steps) * lambda/2/optics; 8-bit phases lie in
    0..255, 16-bit ones are signed."""
    lines = sent(UmdBoard(BOARDS[name]), readings)
    assert (lines[:, 2] - lines[:, 4] / steps) * COUNT_MM == pytest.approx(
        readings, abs=0.51 * COUNT_MM / steps
    )
    low, high = (0, 255) if steps == 256 else (-32768, 32767)
    assert np.all((lines[:, 4] >= low) & (lines[:, 4] <= high))


def test_umd0_is_the_board_of_the_recorded_stream():
    """The real recording begins with this banner and these codes; counts are quarters of a cycle,
    REF and MEAS are zero."""
    board = UmdBoard(BOARDS["umd0"], optics=1)
    assert board.banner() == b"\nMinimalist Homodyne Test:\r\n"
    lines = sent(board, np.full(300, 0.158248))
    assert lines[:3, 5:].tolist() == [[0, 0, 0], [1, 10, 209], [2, 8, 24414]]
    assert lines[13, 6:].tolist() == [20, 1025]
    assert lines[257, 6:].tolist() == [10, 209]
    assert np.all(lines[:, [0, 1, 4]] == 0)
    assert lines[5, 2] == int(0.158248 / (632.991e-6 / 2 / 4))


def test_umd0_prints_its_sequence_as_a_16_bit_number():
    board = UmdBoard(BOARDS["umd0"])
    board.skip(32766)
    assert sent(board, np.zeros(4))[:, 5].tolist() == [32766, 32767, -32768, -32767]


def test_a_lost_beam_shows_as_no_measurement_signal():
    lines = sent(UmdBoard(BOARDS["umd1"]), np.zeros(3), [True, False, True])
    assert lines[:, 1].tolist() == [lines[0, 0], 0, lines[0, 0]]
    assert lines[1, 4] & 0x7E00 == 0x800


def test_velocity_is_the_change_of_the_count_and_moves_the_measurement_frequency():
    lines = sent(UmdBoard(BOARDS["umd2"]), np.array([0.0, 0.1, 0.05]))
    assert lines[1:, 3].tolist() == np.diff(lines[:, 2]).tolist()
    assert np.all(lines[:, 1] - lines[:, 0] == lines[:, 3])


def test_a_multi_axis_board_sends_sixteen_fields_and_its_rate():
    lines = sent(
        UmdBoard(BOARDS["umd2"], axes=3, rate_hz=500.0, environment={3: 2150}), np.zeros(32)
    )
    assert lines.shape == (32, 16)
    assert lines[2, 6:8].tolist() == [8, 50000]
    assert lines[23, 6:8].tolist() == [3, 2150]


def test_lines_carry_position_counter_and_beam():
    line = AsciiLine(rate_hz=100.0, counter_modulus=3)
    line.skip(2)
    data = line.encode(np.array([-1.5, 2.0]), np.array([True, False]))
    assert data == b"-1.500000 00002 1.00\r\n+2.000000 00000 0.00\r\n"


@pytest.mark.parametrize(
    ("request_bytes", "answer"),
    [
        (b"\x1bA0200\r", b"\x02-000123457\r\n"),
        (b"\x1bA0100\r", b"\x02-12.3457\r\n"),
        (b"\x02", b"\x02-12.3457\r\n"),
        (b"\x1bT0001\r", b"\x06"),
        (b"\x1bA9999\r", b"\x15"),
        (b"x", b"\x15"),
    ],
)
def test_a_display_answers_what_its_manual_knows(request_bytes, answer):
    """ND 28x/287 manual pages (instruments 1.B): sign and nine digits for the current value, NAK
    for the unknown."""
    assert NdDisplay().answer(request_bytes, -12.34567, beam=True) == answer


def test_a_display_without_signal_gives_no_value():
    assert NdDisplay().answer(b"\x1bA0200\r", 1.0, beam=False) == b"\x15"


def test_a_display_takes_requests_in_any_pieces():
    display = NdDisplay()
    pieces = [display.requests(bytes([byte])) for byte in b"\x02\x1bA0200\r\x02"]
    assert [request for piece in pieces for request in piece] == [
        b"\x02",
        b"\x1bA0200\r",
        b"\x02",
    ]


def test_a_counter_begins_at_zero_and_holds_while_the_beam_is_away():
    counter = Counter(seed=1)
    beam = np.array([True, True, False, False, True, True])
    reading = counter.count(np.array([300.0, 301.0, 302.0, 303.0, 304.0, 306.0]), beam)
    assert reading[:4].tolist() == [0.0, 1.0, 1.0, 1.0]
    assert reading[5] - reading[4] == pytest.approx(2.0)
    assert 0.0 < abs(reading[4] - 1.0) < 0.07


def test_a_counter_can_be_zeroed_shifted_and_reversed():
    counter = Counter(sign=-1)
    beam = np.ones(1, dtype=bool)
    assert counter.count(np.array([300.0]), beam).tolist() == [0.0]
    assert counter.count(np.array([310.0]), beam).tolist() == [-10.0]
    counter.jump(5.0)
    assert counter.count(np.array([310.0]), beam) == pytest.approx([-9.995])
    counter.zero()
    assert counter.count(np.array([320.0]), beam).tolist() == [0.0]


def test_a_reset_of_the_counter_does_not_look_like_a_speed():
    lines = sent(UmdBoard(BOARDS["umd2"]), np.array([0.0, 500.0, 500.0]))
    assert lines[:, 1].tolist() == lines[:, 0].tolist()
