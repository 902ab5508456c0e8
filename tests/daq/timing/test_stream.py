"""A stream gives the same whenever somebody looks at it: what is decoded together is what would
have been decoded alone."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from stepdiag.daq.formats.instruments.line import LineDecoder, LineSettings
from stepdiag.daq.formats.instruments.umd.decoder import UmdDecoder, UmdSettings
from stepdiag.daq.timing.stream import HOLD_NS, MEMORY_NS, MEMORY_SAMPLES, StreamBuffer
from testkit.examples import few

MS = 1_000_000
START = [b"20000 20000 0 0 0 1 8 100000\r\n", b"20000 20000 0 0 0 2 10 6000\r\n"]


def line(number, *, meas=20000, code=0, data=0, phase=0):
    """Return one line of a board; MEAS 0 is a lost beam."""
    return f"20000 {meas} {number * 7 % 50} -3 {phase} {number} {code} {data}\r\n".encode()


PIECES = st.one_of(
    st.tuples(st.just("plain"), st.integers(1, 60)),
    st.tuples(st.just("lost"), st.integers(1, 3)),
    st.tuples(st.just("gap"), st.integers(1, 5)),
    st.tuples(st.just("rate"), st.sampled_from([50000, 100000])),
    st.tuples(
        st.sampled_from(["garbage", "banner", "again", "restart", "environment"]), st.just(0)
    ),
)


def stream(pieces):
    """Return the bytes of a board to which all this happens."""
    lines, number = list(START), 2
    for what, amount in pieces:
        if what in ("plain", "lost"):
            for _ in range(amount):
                number += 1
                lines.append(
                    line(number, meas=20000 if what == "plain" else 0, phase=number % 200)
                )
        elif what == "gap":
            number += amount
        elif what == "restart":
            number = 0
        elif what == "rate":
            number += 1
            lines.append(line(number, code=8, data=amount))
        else:
            odd = {
                "garbage": b"\xff%!\r\n",
                "banner": b"Hello board\r\n",
                "again": lines[-1],
                "environment": line(number + 1, code=5, data=9),
            }
            number += what == "environment"
            lines.append(odd[what])
    return b"".join(lines)


def chunks_of(data, sizes):
    """Cut bytes into chunks of these sizes, in turn, each 20 ms after the one before."""
    chunks, at = [], 0
    while at < len(data):
        size = sizes[len(chunks) % len(sizes)]
        chunks.append((data[at : at + size], (len(chunks) + 1) * 20 * MS + size * 1000))
        at += size
    return chunks


def seen(buffer, to_ns):
    """Return all that anybody can see of a stream."""
    span = buffer.span(0, to_ns)
    columns = [column.tolist() for column in (span.time_ns, span.position_mm)]
    return (
        columns,
        span.unusable,
        buffer.flags(0, to_ns).tolist(),
        buffer.breaks,
        buffer.samples,
        buffer.garbage,
        buffer.newest_ns(),
    )


@few(50)
@given(
    st.lists(PIECES, min_size=1, max_size=12),
    st.lists(st.integers(1, 400), min_size=1, max_size=5),
    st.integers(2, 40),
)
def test_looking_changes_nothing(pieces, sizes, every):
    """One buffer is looked at after every chunk, one now and then, one only at the end."""
    chunks = chunks_of(stream(pieces), sizes)
    always, sometimes, never = (StreamBuffer(UmdDecoder(UmdSettings())) for _ in range(3))
    for number, (data, arrival_ns) in enumerate(chunks):
        for buffer in (always, sometimes, never):
            buffer.feed(data, arrival_ns)
        always.newest_ns()
        if number % every == 0:
            sometimes.newest_ns()
    end = chunks[-1][1] + HOLD_NS
    assert seen(always, end) == seen(sometimes, end) == seen(never, end)
    assert always.heard() == sometimes.heard() == never.heard()


def test_many_chunks_are_taken_at_once():
    """The shortcut is really taken on a plain stream, and refused, with nothing taken, where a line
    is odd."""
    decoder = UmdDecoder(UmdSettings())
    decoder.feed(b"".join(START), 0)
    batch = decoder.feed_steady([(line(3) + line(4)[:9], 20 * MS), (line(4)[9:], 40 * MS)])
    assert batch is not None
    assert batch.counter.tolist() == [3, 4]
    assert batch.arrival_ns.tolist() == [20 * MS, 40 * MS]
    assert decoder.feed_steady([(line(5), 60 * MS), (line(7), 80 * MS)]) is None
    assert decoder.feed(line(5), 60 * MS).counter.tolist() == [5]


def test_what_is_forgotten_does_not_depend_on_looking():
    """Age and number both limit what is remembered, by whole chunks."""
    looked, left = (StreamBuffer(UmdDecoder(UmdSettings())) for _ in range(2))
    block, first = 4000, 3
    for buffer in (looked, left):
        buffer.feed(b"".join(START), 0)
    for chunk in range(MEMORY_SAMPLES // block + 40):
        data = b"".join(
            b"20000 20000 1 0 0 %d 0 0\r\n" % number for number in range(first, first + block)
        )
        first += block
        for buffer in (looked, left):
            buffer.feed(data[: len(data) // 2], (2 * chunk + 1) * 20 * MS)
            buffer.feed(data[len(data) // 2 :], (2 * chunk + 2) * 20 * MS)
        looked.newest_ns()
    end = (2 * chunk + 2) * 20 * MS
    times = [buffer.span(0, end + MEMORY_NS).time_ns for buffer in (looked, left)]
    assert np.array_equal(*times)
    assert MEMORY_SAMPLES - block <= len(times[0]) <= MEMORY_SAMPLES
    for buffer in (looked, left):
        buffer.feed(line(first), end + MEMORY_NS)
        assert len(buffer.flags(0, end + 2 * MEMORY_NS)) <= block + 1


COUNTED = LineSettings(pattern=r"(?P<position>[-+.0-9]+) (?P<counter>[0-9]+)", rate_hz=100.0)
UNCOUNTED = LineSettings(pattern=r"(?P<position>[-+.0-9]+) [0-9]+", rate_hz=100.0)


@pytest.mark.parametrize("settings", [COUNTED, UNCOUNTED], ids=["counted", "uncounted"])
@pytest.mark.parametrize("away_ms", [0, 50, 300])
def test_a_line_that_was_lost_is_a_time_when_the_laser_was_unwatched(settings, away_ms):
    """However short, and with a counter too: a beam that is cut meanwhile and comes back leaves no
    trace."""
    buffer = StreamBuffer(LineDecoder(settings))
    for number in range(40):
        if number == 20:
            buffer.interrupted(195 * MS)
            buffer.feed(b"cut\n", (number * 10 + away_ms) * MS)
        if not 20 <= number < 20 + away_ms // 10:
            buffer.feed(b"1.5 %d\n" % number, number * 10 * MS)
    assert [str(each.reason) for each in buffer.breaks if not each.watched] == [
        "the line was lost for a moment"
    ]
    assert [each.reason for each in buffer.breaks if each.watched] == []
