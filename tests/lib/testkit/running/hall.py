"""A virtual machine and a daemon as processes of their own, on real sockets and ptys."""

import json
import os
import sys
import time
import urllib.error
import urllib.request
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from urllib.parse import quote

from stepdiag.demo.processes import Talker, talking
from testkit.cli import stepdiag

SILENT_S = 90.0
"""A daemon that says nothing for so long waits for a person: what a test waits for does not come
any more."""

UNIT_NICE = -10
"""The unit's priority; the bench stands for hardware, which no busy computer holds up."""

BENCH = """
seed = {seed}
time_scale = 10.0
[volume]
size_mm = [{size}]
increments = {n}
[program]
setups = [{setups}]
passes = {passes}
feed_mm_min = {feed}
acceleration_mm_s2 = 4000.0
dwell_s = {dwell}
overrun_mm = {overrun}
start = "command"
pause_s = 0.5
handshake = {handshake}
patient = {patient}
{program_more}
[laser]
format = "{laser}"
optics = 1
noise_um = 0.2
{laser_more}
[plc]
transport = "{transport}"
{plc_more}
{faults}
{bench_more}
"""

SURVEY = """
[survey]
name = "hall"
machine = "virtual"
[volume]
size_mm = [{size}]
increments = {n}
[plan]
setups = [{setups}]
return_pass = {back}
dwell_s = 0.6
overrun_mm = {overrun}
propose_next = {propose}
[machine]
{machine}
[laser]
format = "{laser}"
port = "{laser_port}"
optics = 1
{laser_more}
[plc]
{plc}
poll_hz = {poll_hz}
[plc.handshake]
enabled = {handshake}
{signals}
[stop]
settle_s = 0.03
min_window_s = {window}
max_scatter_um = 5.0
max_slope_um_s = 5.0
[page]
enabled = {page}
port = {page_port}
{exports}
"""


@dataclass
class Hall:
    """Where everything is: the folder, the bench process, its options, and what it said when it was
    ready."""

    folder: Path
    bench: Talker
    survey: Path
    setups: tuple
    ready: dict

    @property
    def round(self):
        """The folder of the first survey's logs."""
        return self.folder / "hall" / "0001"

    def start_setups(self, stop_after=None):
        """Start every setup as soon as the bench waits for it; return when the program has finished
        (or after some)."""
        begun = 0
        while True:
            event = self.bench.next(300.0, "bench")["event"]
            if event == "finished" or (stop_after is not None and begun == stop_after):
                return
            if event == "waiting" and begun < len(self.setups):
                begun += 1
                self.bench.say("start")


@contextmanager
def hall(
    folder,
    *,
    setups=("ppp", "npp", "pnp", "ppn"),
    n=2,
    back=False,
    laser="umd",
    transport="tcp",
    handshake=False,
    patient=True,
    poll_hz=None,
    dwell=2.5,
    feed=30000.0,
    window=0.08,
    overrun=2.0,
    seed=5,
    exports="",
    page=False,
    page_port=8420,
    laser_bench="",
    laser_survey="",
    faults="",
    program="",
    propose=False,
    signals="",
    plc_bench="",
    machine='compensation = "off"',
    bench="",
    size=(300.0, 200.0, 100.0),
    silent=False,
):
    """Run a bench process in ``folder``; a survey file that fits it stands there.

    A machine that says less than everything (``signals``) is looked at twice as often: one without
    a stop counter has nothing else to tell two stops apart.
    """
    named = ", ".join(f'"{setup}"' for setup in setups)
    common = {
        "n": n,
        "size": ", ".join(map(str, size)),
        "setups": named,
        "laser": laser,
        "handshake": str(handshake).lower(),
        "overrun": overrun,
    }
    bench_file = folder / "bench.toml"
    driven = {
        "passes": 1 + back,
        "patient": str(patient).lower(),
        "dwell": dwell,
        "feed": feed,
        "program_more": program,
        "plc_more": plc_bench,
    }
    bench_file.write_text(
        BENCH.format(
            **common,
            **driven,
            seed=seed,
            laser_more=laser_bench,
            transport=transport,
            faults=faults,
            bench_more=bench,
        ),
        encoding="utf-8",
    )
    command = (
        sys.executable,
        "-m",
        "stepdiag.virtual",
        "--config",
        str(bench_file),
        "--directory",
        str(folder / "devices"),
    )
    with talking(command, errors=False) as bench:
        ready = bench.next(120.0, "bench")
        go_first(bench.process)
        if silent:
            plc = 'transport = "none"'
        elif transport == "tcp":
            plc = f"port = {ready['plc_port']}"
        else:
            plc = (
                f'transport = "rtu"\nserial_port = "{ready["plc_link"]}"\nbaud = 115200\nparity '
                '= "N"'
            )
        survey = folder / "survey.toml"
        survey.write_text(
            SURVEY.format(
                **common,
                back=str(back).lower(),
                laser_port=ready["laser_link"],
                plc=plc,
                poll_hz=poll_hz or (100.0 if signals else 50.0),
                window=window,
                laser_more=laser_survey,
                signals=signals,
                exports=exports,
                machine=machine,
                page=str(page).lower(),
                propose=str(propose).lower(),
                page_port=page_port,
            ),
            encoding="utf-8",
        )
        yield Hall(folder, bench, survey, setups, ready)


def go_first(process):
    """Give a process that has begun, with all its threads, the priority it has beside a machine,
    where this user may.

    Not before: what reads its libraries ahead of everybody holds up the workers of the kernel that
    bring bytes through the ptys of others.
    """
    for thread in Path(f"/proc/{process.pid}/task").iterdir():
        with suppress(PermissionError, ProcessLookupError):
            os.setpriority(os.PRIO_PROCESS, int(thread.name), UNIT_NICE)


STEPDIAG = (sys.executable, "-m", "stepdiag")


@contextmanager
def daemon(survey, *, wait_for=("laser", "machine"), command=STEPDIAG):
    """Run ``stepdiag run`` and wait until the links named are connected."""
    with talking((*command, "run", str(survey)), errors=True) as process:
        connected = set()
        while not set(wait_for) <= connected:
            said = process.next(120.0, "daemon")
            assert said["event"] != "text", said
            if said["event"] == "link-connected":
                connected.add(said["link"])
        go_first(process.process)
        try:
            yield process
        except Exception as failure:
            failure.add_note(
                "\n".join(
                    [
                        "the daemon said last:",
                        *process.last,
                        "status:",
                        stepdiag("status", survey, "--verbose").out,
                    ]
                )
            )
            raise


def accept_all(survey):
    """Accept whatever is doubted of a survey (its file or folder) now."""
    for place in dict.fromkeys(
        each["place"]
        for each in json.loads(stepdiag("status", survey, "--json").out)["doubts"]
    ):
        done = stepdiag("accept", survey, place, "--reason", "the test has looked at it")
        assert done.code == 0, done.refusal


def until_complete(process, survey, *, timeout_s=500.0):
    """Accept whatever keeps a survey (its file or folder) open, also what comes; return what was
    said up to its completion."""
    accept_all(survey)
    seen, end = [], time.monotonic() + timeout_s
    while time.monotonic() < end:
        seen.append(process.next(SILENT_S, "process"))
        if seen[-1].get("event") == "survey-complete":
            return seen
        if seen[-1].get("event") == "survey-open":
            accept_all(survey)
    raise AssertionError(f"no survey-complete within {timeout_s} s; last: {seen[-3:]}")


def until(talker, event, *, timeout_s=500.0, **fields):
    """Return every object up to the first of an event with these fields."""
    seen, end = [], time.monotonic() + timeout_s
    while time.monotonic() < end:
        seen.append(talker.next(SILENT_S, "process"))
        if seen[-1].get("event") == event and all(
            seen[-1].get(key) == value for key, value in fields.items()
        ):
            return seen
    raise AssertionError(f"no {event} {fields} within {timeout_s} s; last: {seen[-3:]}")


def order(port, token, body):
    """Send a command as the page does; return the status, 0 where nobody listens yet."""
    headers = {
        "Authorization": f"Bearer {quote(token)}",
        "Content-Type": "application/json",
        "Origin": f"http://127.0.0.1:{port}",
    }
    request = urllib.request.Request(
        f"http://127.0.0.1:{port}/command", json.dumps(body).encode(), headers
    )
    try:
        with urllib.request.urlopen(request, timeout=60.0) as answer:
            return answer.status
    except urllib.error.HTTPError as refused:
        return refused.code
    except OSError:
        return 0


def ordered(port, token, name, /, **arguments):
    """Send a command as soon as somebody listens; it has to be taken."""
    end = time.monotonic() + 60.0
    while (status := order(port, token, {"name": name, "arguments": arguments})) == 0:
        assert time.monotonic() < end, "nobody listens"
        time.sleep(0.1)
    assert status == 204
