"""A whole small survey over whatever the hall has, and its replay."""

import json
import os
import signal
import time

from stepdiag.daq.service.live import live_in
from testkit.cli import stepdiag
from testkit.running.hall import daemon, until


def until_told(place, names, *, since_s=0.0):
    """Wait until the daemon knows these conditions: a machine that stands at its first stop before
    has air that nobody told.

    ``since_s`` is when it was started, since 1970: what one that was killed before it left behind
    counts for ten seconds.
    """
    end = time.monotonic() + 60.0
    while (
        (live := live_in(place.folder / "hall")) is None
        or live.time_s < since_s
        or not set(names) <= set(live.conditions)
    ):
        assert time.monotonic() < end, live
        time.sleep(0.05)


def drive_one_and_kill(place, *, links=("laser", "machine"), told=()):
    """Drive the first setup and kill the daemon after its pass, as a supply that fails would."""
    started_s = time.time()
    with daemon(place.survey, wait_for=links) as process:
        until_told(place, told, since_s=started_s)
        place.start_setups(stop_after=1)
        until(process, "pass-ended")
        os.kill(process.process.pid, signal.SIGKILL)
        process.process.wait()


def drive_and_replay(place, told=()):
    """Drive every setup of the hall, wait for the result, replay the logs to the same bytes; return
    what the daemon said.

    ``told`` names the conditions that have to be known first.
    """
    started_s = time.time()
    with daemon(place.survey) as process:
        until_told(place, told, since_s=started_s)
        place.start_setups()
        said = until(process, "survey-complete")
    assert said[-1]["exit_code"] == 0, said[-1]
    result = json.loads((place.round / "result.json").read_text())
    assert all(entry["value"] is not None for entry in result["squareness"].values())
    code, out, refusal = stepdiag(
        "replay", place.round, "--out", place.folder / "again", "--json"
    )
    assert code == 0, refusal
    compared = json.loads(out)
    assert compared["different"] == compared["rounded"] == compared["missing"] == []
    assert {"result.json", "readings.csv"} <= set(compared["identical"])
    return said
