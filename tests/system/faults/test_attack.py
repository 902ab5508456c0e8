"""An attacker inside the page's process and inside what publishes, by every version of Landlock,
while one survey is recorded."""

import json
import subprocess
import sys
import threading
from pathlib import Path

import pytest

from testkit.running.hall import daemon, hall, until

pytestmark = pytest.mark.system

ATTACK = Path(__file__).parents[2] / "lib/testkit/hostile/attack.py"
TRIED = [(walls, version) for version in (1, 2, 3, 4, 6, 99) for walls in ("page", "opcua")]


@pytest.mark.impatient
def test_every_stop_of_a_survey_is_captured_beside_twelve_attacks(tmp_path):
    (tmp_path / "secret").write_text("a secret", encoding="utf-8")
    found = []
    with hall(tmp_path, back=True) as place, daemon(place.survey) as process:

        def attack():
            for walls, version in TRIED:
                command = [
                    sys.executable,
                    ATTACK,
                    walls,
                    version,
                    process.process.pid,
                    place.ready["plc_port"],
                    place.round,
                    tmp_path / "secret",
                ]
                done = subprocess.run(
                    list(map(str, command)),
                    capture_output=True,
                    text=True,
                    timeout=120,
                    check=False,
                )
                found.append(json.loads(done.stdout) if done.returncode == 0 else done.stderr)

        thread = threading.Thread(target=attack)
        thread.start()
        place.start_setups()
        thread.join()
        said = until(process, "survey-complete")
    assert len(found) == len(TRIED)
    assert [each for each in found if set(each["succeeded"]) - {"reads the log"}] == []
    assert all(each["tried"] >= 50 for each in found)
    assert len([each for each in said if each["event"] == "stop"]) == 4 * 2 * 7
    assert said[-1]["exit_code"] == 0
