"""kill -9 at random moments, many in a row, in one survey: nothing captured is lost, and it is
completed all the same.

``make soak`` kills 200 times (STEPDIAG_SOAK_KILLS); `make test` eight times.
"""

import json
import os
import random
import signal
import sys
import time

import pytest

from stepdiag.daq.recording.rounds import mend, noted_stops
from stepdiag.daq.replay import find_logs, replay
from stepdiag.demo.processes import talking
from testkit.cli import stepdiag
from testkit.running.hall import daemon, go_first, hall, until_complete

KILLS = int(os.environ.get("STEPDIAG_SOAK_KILLS", "8"))
pytestmark = [pytest.mark.system, pytest.mark.timeout(300 + 5 * KILLS)]


def captured_in(said):
    """Return (setup, stop, outward) of every stop that the daemon said it had captured."""
    return [
        (each["setup"], each["stop"], each["outward"])
        for each in said
        if each.get("event") == "stop"
    ]


def live_and_die(survey, seconds):
    """Run a daemon, kill it without a word after a while, and return what it had said."""
    said = []
    with talking(
        (sys.executable, "-m", "stepdiag", "run", str(survey)), errors=True
    ) as process:
        end = time.monotonic() + seconds
        while time.monotonic() < end:
            if process.lines.empty():
                time.sleep(0.005)
            else:
                said.append(process.next(1.0, "daemon"))
                if said[-1]["event"] == "link-connected":
                    go_first(process.process)
        os.kill(process.process.pid, signal.SIGKILL)
        process.process.wait()
        while (line := process.lines.get()) is not None:
            said.append(json.loads(line))
    return said


def test_a_survey_is_completed_across_kills(tmp_path):
    """Every stop that was ever announced stands in a log; the longest hole in the laser's bytes
    before a kill is half a second."""
    rng = random.Random(20)
    with hall(tmp_path, handshake=True, n=max(2, KILLS // 10), dwell=2.5) as place:
        announced, started = [], 0
        for _ in range(KILLS):
            while not place.bench.lines.empty():
                event = place.bench.next(1.0, "bench")["event"]
                if event == "waiting" and started < len(place.setups):
                    started += 1
                    place.bench.say("start")
            announced += captured_in(live_and_die(place.survey, rng.uniform(0.7, 2.0)))
        place.setups = place.setups[started:]
        if not (place.round / "result.json").exists():
            with daemon(place.survey) as process:
                if place.setups:
                    place.start_setups()
                assert until_complete(process, place.survey)[-1]["exit_code"] == 0
        mend(place.round)
        logs = find_logs(
            [place.round]
        )  # a daemon that is killed at once leaves a file with nothing in it
        noted = [
            (stop.setup, stop.stop, stop.outward) for log in logs for stop in noted_stops(log)
        ]
        assert set(announced) <= set(noted)
        book = replay(logs).book
        assert all(each.whole for each in book.passes)
        assert {doubt.code for doubt in book.doubts()} <= {"laser-unwatched"}, (
            "what nobody watched is doubted, and nothing else"
        )
        assert (
            json.loads(
                stepdiag("replay", place.round, "--out", tmp_path / "again", "--json").out
            )["different"]
            == []
        )
