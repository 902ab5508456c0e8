"""From a dwell and samples to windows: whatever happened to the count in between, no mean is made
of readings with different zeros."""

from hypothesis import example, given
from hypothesis import strategies as st

from stepdiag.daq.capture.standing.certain_window import certain_windows
from stepdiag.daq.capture.standing.dwell import Dwell
from stepdiag.daq.capture.standing.window import EDGE_NS
from stepdiag.daq.capture.stop_capture import plateau_window
from stepdiag.daq.formats.instruments.line import LineDecoder, LineSettings
from stepdiag.daq.formats.signals import Signals
from stepdiag.daq.survey.models import StopRules
from stepdiag.daq.timing.stream import StreamBuffer

MS = 1_000_000
JUMP_MM = 0.002
HOLE_MS = (500, 10_500)
RULES = StopRules(settle_s=0.05, min_window_s=0.1)


def samples(first_ms, end_ms, position_mm):
    """Return lines of a laser that counts its thousand samples a second, seen or not."""
    return "".join(
        f"{position_mm:+.6f} {number}\r\n" for number in range(first_ms, end_ms)
    ).encode()


def stood_still(late_ms, after_ms, more_ms):
    """Return the stream of a computer that stood still: what was in the line's buffer and the first
    lines after it come in one chunk."""
    settings = LineSettings(
        pattern=r"(?P<position>[-+.\d]+) (?P<counter>\d+)",
        rate_hz=1000.0,
        counter_modulus=1_000_000,
    )
    buffer = StreamBuffer(LineDecoder(settings))
    asleep, awake = HOLE_MS
    for end in range(20, asleep + 1, 20):
        buffer.feed(samples(end - 20, end, 0.0), end * MS)
    buffer.feed(
        samples(asleep, asleep + late_ms, 0.0) + samples(awake - after_ms, awake, JUMP_MM),
        awake * MS,
    )
    for end in range(awake + 20, awake + more_ms + 1, 20):
        buffer.feed(samples(end - 20, end, JUMP_MM), end * MS)
    return buffer


@given(
    late_ms=st.integers(0, 100),
    after_ms=st.integers(1, 100),
    more_ms=st.integers(0, 400),
    to_ms=st.floats(200.0, 11_000.0),
)
@example(late_ms=10, after_ms=20, more_ms=0, to_ms=10_499.0)
def test_a_window_never_spans_a_hole(late_ms, after_ms, more_ms, to_ms):
    """The count slips while nobody looks; the dwell may end before, in or after the chunk that
    shows it."""
    buffer = stood_still(late_ms, after_ms, more_ms)
    dwell = Dwell(
        from_ns=100 * MS,
        to_ns=round(to_ms * MS),
        not_before_ns=None,
        signals=Signals(stopped=True),
    )
    windows = certain_windows(buffer, dwell, RULES)
    assert 1 <= len(windows) <= 2
    for taken, zero_mm in zip(windows, (0.0, JUMP_MM), strict=False):
        assert abs(taken.window.mean_mm - zero_mm) < 1e-6
        assert taken.from_ns <= taken.to_ns <= dwell.to_ns


def test_of_a_plateau_shorter_than_twice_the_settling_half_is_taken():
    """Half a second of standing and 0.4 s to settle: a mean over the last tenth would hold nothing,
    one over all the settling."""
    settings = LineSettings(
        pattern=r"(?P<position>[-+.\d]+) (?P<counter>\d+)",
        rate_hz=1000.0,
        counter_modulus=1_000_000,
    )
    buffer = StreamBuffer(LineDecoder(settings))
    for end, position_mm in ((1000, -20.0), (1500, 0.0), (2500, 20.0)):
        for at in range(end - (500 if end == 1500 else 1000), end, 100):
            buffer.feed(samples(at, at + 100, position_mm), (at + 100) * MS)
    taken = plateau_window(
        buffer, 0.0, 2500 * MS, 0.0, StopRules(settle_s=0.4, min_window_s=0.1)
    )
    assert taken is not None
    assert taken.window.mean_mm == 0.0
    whole_ns = 500 * MS - EDGE_NS
    assert abs((taken.to_ns - taken.from_ns) - whole_ns / 2) < 20 * MS
