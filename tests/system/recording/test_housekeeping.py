"""What the daemon does about its disk, in a process of its own."""

import sys
from pathlib import Path

import pytest

from stepdiag.daq.recording.archive import MARK
from testkit.running.hall import daemon, hall, until

pytestmark = pytest.mark.system


def test_it_says_that_the_disk_is_nearly_full(tmp_path):
    with hall(tmp_path) as place:
        place.survey.write_text(
            f"{place.survey.read_text()}\n[recording]\nmin_free_gb = 1e6\n"
        )
        with daemon(place.survey, wait_for=()) as process:
            said = until(process, "disk-low")[-1]
    assert said["level"] == "error"
    assert said["free_gb"] < 1e6


@pytest.mark.impatient
def test_a_finished_survey_is_packed_when_the_budget_is_exceeded(tmp_path):
    """Both done by processes that the daemon starts: what lies in its working directory and is
    called like a library is none of theirs."""
    (tmp_path / "numpy.py").write_text("raise SystemExit('not this one')\n")
    program = (
        "env",
        "-C",
        str(tmp_path),
        "-u",
        "PYTHONSAFEPATH",
        str(Path(sys.executable).with_name("stepdiag")),
    )
    with hall(tmp_path, handshake=True, dwell=0.5, n=1) as place:
        place.survey.write_text(
            f"{place.survey.read_text()}\n[recording]\nmax_gb = 0.000001\n"
        )
        with daemon(place.survey, command=program) as process:
            place.start_setups()
            until(process, "survey-complete", exit_code=0)
            packed = until(process, "archived")[-1]
            until(process, "over-budget")
        assert packed["saved_mb"] > 0
        assert (place.round / MARK).exists()
