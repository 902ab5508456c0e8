"""How a machine comes to the stops of its way back: what the laser saw of it is true, or named,
over real processes, sockets and ptys."""

import socket
import struct
import threading
import time
from contextlib import contextmanager

import pytest

from testkit.running.hall import daemon, hall, until
from testkit.running.verdict import nothing_silently_wrong

pytestmark = pytest.mark.system

COMPENSATED = {"laser_bench": "compensated = true\n", "laser_survey": "compensated = true\n"}
UNCOUNTED = (
    '[plc.signals.stopped]\naddress = 2\ntype = "bit"\nbit = 0\n[plc.signals.setup]\naddress = 3\n'
    + "".join(
        f'[plc.signals.{name}]\naddress = {at}\ntype = "int32"\nscale = 1e-4\n'
        for name, at in (("x_mm", 4), ("y_mm", 6), ("z_mm", 8))
    )
)
UNSIGNALLED = "".join(
    f'[[fault]]\nkind = "{kind}"\nsetup = "ppp"\npass_number = 2\nstop = 0\nduration_s = 3.5\n'
    for kind in ("stop-unsignalled", "dwell-longer")
)
"""The first stop of the way back, longer than the others: nobody looks at it."""
GLANCE_S = 0.4
"""So seldom does somebody look who does not see the whole of a dwell."""
READ_BLOCK = struct.pack(">HHHBBHH", 1, 0, 6, 1, 3, 0, 14)


def findings_of(said, code):
    """Return what was said under a code."""
    return [
        each["text"] for each in said if each["event"] == "finding" and each["code"] == code
    ]


@pytest.mark.impatient
@pytest.mark.parametrize(
    ("drive", "code", "doubts"),
    [
        ({"overrun": 0.0}, "turned-round", []),
        ({"faults": UNSIGNALLED}, "stop-recovered", ["ppp/2/0"]),
    ],
    ids=["turned round", "not signalled"],
)
def test_the_first_stop_of_the_way_back_is_told_from_the_last_one_out(
    tmp_path, drive, code, doubts
):
    """Who turns round has one reading for both; who went beyond has a stop of its own there, though
    Modbus did not show it."""
    with hall(tmp_path, n=1, back=True, setups=("ppp",), **drive, **COMPENSATED) as place:
        with daemon(place.survey) as process:
            place.start_setups()
            until(process, "pass-ended", kind="complete")
            said = until(process, "pass-ended", kind="complete")
        book = nothing_silently_wrong(place)
    out, back = book.passes
    assert "(ppp) back, stop 1 of 4" in findings_of(said, code)[0]
    assert [doubt.place for doubt in book.doubts()] == doubts
    shared = out.chosen()[3].window_from_ns == back.chosen()[0].window_from_ns
    assert shared is (code == "turned-round")


def look(link):
    """Poll the machine once; return its stop count."""
    link.sendall(READ_BLOCK)
    answer = b""
    while len(answer) < 37:
        answer += link.recv(37 - len(answer))
    return struct.unpack(">H", answer[11:13])[0]


@contextmanager
def held_at(port, count):
    """Hold the machine at a stop by its own count: it waits for who glances at it, and goes on when
    somebody really looks."""
    with socket.create_connection(("127.0.0.1", port), timeout=60.0) as link:
        while look(link) < count:
            time.sleep(0.02)
        over = threading.Event()

        def glance():
            while not over.wait(GLANCE_S):
                look(link)

        glances = threading.Thread(target=glance)
        glances.start()
        try:
            yield
        finally:
            over.set()
            glances.join()


@pytest.mark.impatient
def test_a_daemon_that_comes_back_on_the_way_back_doubts_what_it_takes_for_the_way_out(
    tmp_path,
):
    """Without a counter the places are those of the way out: the fourth stop back stands where the
    second one out was.

    The first daemon may see one stop more while it ends.
    """
    with hall(
        tmp_path,
        n=4,
        back=True,
        dwell=4.0,
        setups=("linear-x",),
        signals=UNCOUNTED,
        **COMPENSATED,
    ) as place:
        with daemon(place.survey) as process:
            place.start_setups(stop_after=1)
            until(process, "stop", stop=2)
        with held_at(place.ready["plc_port"], 9), daemon(place.survey) as process:
            said = until(process, "pass-ended")
        book = nothing_silently_wrong(place)
    (only,) = book.passes
    assert "(linear-x) out, stop 2 of 5" in findings_of(said, "other-side")[0]
    assert (1, "other-side") in {(doubt.stop, doubt.code) for doubt in only.open_doubts()}
    assert not only.complete
