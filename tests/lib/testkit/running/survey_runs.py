"""A whole small survey over whatever the hall has, and its replay."""

import json
import os
import subprocess
import sys

from testkit.running.hall import daemon, until


def stepdiag(*arguments, environment=None):
    """Run a command; return (exit code, standard output, standard error)."""
    done = subprocess.run(
        [sys.executable, "-m", "stepdiag", *map(str, arguments)],
        capture_output=True,
        text=True,
        timeout=120,
        check=False,
        env=os.environ | (environment or {}),
    )
    return done.returncode, done.stdout, done.stderr


def drive_and_replay(place):
    """Drive every setup of the hall, wait for the result, replay the logs to the same bytes; return what the daemon said."""
    with daemon(place.survey) as process:
        place.start_setups()
        said = until(process, "survey-complete")
    assert said[-1]["exit_code"] == 0, said[-1]
    result = json.loads((place.round / "result.json").read_text())
    assert all(entry["value"] is not None for entry in result["squareness"].values())
    code, out, refusal = stepdiag("replay", place.round, "--out", place.folder / "again", "--json")
    assert code == 0, refusal
    compared = json.loads(out)
    assert compared["different"] == compared["rounded"] == compared["missing"] == []
    assert {"result.json", "readings.csv"} <= set(compared["identical"])
    return said
