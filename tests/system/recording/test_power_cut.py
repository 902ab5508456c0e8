"""The recorder loses its power in a move, the machine and the laser go on: the laser's own number
and the way back decide whether its stops are doubted. Real processes, sockets and ptys.
"""

import json
import os
import signal
import time

import pytest

from testkit.cli import stepdiag
from testkit.examples import spread
from testkit.running.hall import daemon, hall, until
from testkit.running.verdict import nothing_silently_wrong

pytestmark = [pytest.mark.system, pytest.mark.impatient]

PACED = {
    "handshake": True,
    "dwell": 0.5,
    "n": 4,
    "back": True,
    "feed": 1200.0,
    "setups": ("ppp",),
    "laser_bench": "compensated = true\n",
    "laser_survey": "compensated = true\n",
}
"""The machine waits at every stop until it is captured, and is long on its way between two."""
FAULTS = {
    "nothing": None,
    "the beam is cut": '{"kind": "beam-lost", "duration_s": 0.2}',
    "the laser is switched off and on": '{"kind": "laser-unplug", "duration_s": 0.2}',
}


@pytest.mark.parametrize("happens", spread(list(FAULTS), 2))
def test_the_recorder_loses_its_power(tmp_path, happens):
    with hall(tmp_path, **PACED) as place:
        with daemon(place.survey) as process:
            place.start_setups(stop_after=1)
            until(process, "stop", stop=5)
            time.sleep(0.15)
            os.kill(process.process.pid, signal.SIGKILL)
            process.process.wait()
        if FAULTS[happens]:
            place.bench.say(f"fault {FAULTS[happens]}")
            time.sleep(0.4)
        with daemon(place.survey) as process:
            said = until(process, "stop", stop=6)
            said += until(process, "pass-ended")
            said += until(
                process, "survey-complete" if happens == "nothing" else "pass-ended"
            )
            told = stepdiag("status", place.survey, "--verbose").out
        book = nothing_silently_wrong(place)
        code, out, refusal = stepdiag(
            "replay", place.round, "--out", tmp_path / "again", "--json"
        )
    findings = [each for each in said if each["event"] == "finding"]
    remarks = [each["text"] for each in findings if each["code"] == "laser-unwatched"]
    assert {each["code"] for each in findings} & {
        "laser-unwatched",
        "laser-reset",
        "beam-lost",
    }
    assert book.complete() == (happens == "nothing")
    if happens == "nothing":
        assert any("the readings are used" in text for text in remarks)
        assert (code, json.loads(out)["different"]) == (0, []), refusal
    else:
        assert not any("the readings are used" in text for text in remarks)
        assert "again from stop" in told
