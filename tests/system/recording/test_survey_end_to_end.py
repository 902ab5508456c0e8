"""Whole surveys: `stepdiag run` beside the virtual machine, each a process of its own, over real
sockets and ptys."""

import json
import os
import re
import signal
import subprocess
import sys
import time

import pytest

from testkit.cli import joined, stepdiag
from testkit.exact.siemens_files import HALL_EXPORT, HALL_PROFILE
from testkit.running.hall import daemon, hall, until, until_complete
from testkit.running.verdict import nothing_silently_wrong

pytestmark = pytest.mark.system

OTHER_PROCESSOR = {"OPENBLAS_CORETYPE": "Prescott", "OPENBLAS_NUM_THREADS": "1"}
"""Kernels of an old processor: numpy's products then differ in their last bits, a number on the
edge of its rounding in its last digit."""


def process_of_its_own(*arguments, environment=None):
    """Run a command as a process; return (exit code, standard output, standard error)."""
    command = [sys.executable, "-m", "stepdiag", *map(str, arguments)]
    done = subprocess.run(
        command,
        capture_output=True,
        text=True,
        timeout=120,
        check=False,
        env=os.environ | (environment or {}),
    )
    return done.returncode, done.stdout, joined(done.stderr)


def assert_solved(place, increments=2):
    """The result is there and identifies what four diagonals identify."""
    result = json.loads((place.round / "result.json").read_text())
    assert all(entry["value"] is not None for entry in result["squareness"].values())
    assert all(
        len(result["errors"][name]["value"]) == increments + 1
        for name in ("EXX", "EYX", "EZZ")
    )
    return result


@pytest.mark.impatient
def test_a_survey_is_recorded_solved_exported_and_replayed_to_the_same_bytes(tmp_path):
    (tmp_path / "siemens.toml").write_text(HALL_PROFILE)
    with hall(tmp_path, back=True, exports=HALL_EXPORT) as place:
        with daemon(place.survey) as process:
            place.start_setups()
            said = until(process, "survey-complete")
        assert said[-1]["exit_code"] == 0
        stops = [each for each in said if each["event"] == "stop"]
        assert len(stops) >= 7
        assert_solved(place)
        exported = {path.name for path in (place.round / "exports" / "siemens").iterdir()}
        assert {
            "AX_EEC_UNTESTED_SIGN.INI",
            "NC_CEC_UNTESTED_SIGN.INI",
            "SHA256SUMS",
            "EXPORT_REPORT.txt",
        } <= exported
        for again, environment in (("again", None), ("elsewhere", OTHER_PROCESSOR)):
            code, out, refusal = process_of_its_own(
                "replay",
                place.round,
                "--out",
                tmp_path / again,
                "--json",
                environment=environment,
            )
            assert code == 0, refusal
            compared = json.loads(out)
            assert compared["different"] == compared["missing"] == []
            assert environment or compared["rounded"] == []
            files = {
                "result.json",
                "readings.csv",
                "report.html",
                "exports/siemens/AX_EEC_UNTESTED_SIGN.INI",
            }
            assert files <= {*compared["identical"], *compared["rounded"]}


@pytest.mark.parametrize(
    ("laser", "bench", "survey"),
    [
        (
            "nd",
            "resolution_mm = 0.0001\ncompensated = true\n",
            "compensated = true\n[laser.nd]\npoll_hz = 40\n",
        ),
        (
            "line",
            "rate_hz = 500.0\n",
            (
                "[laser.line]\npattern = '(?P<position>[+-][0-9.]+) (?P<counter>[0-9]+) "
                "(?P<beam>[0-9.]+)'\nrate_hz = 500\n"
            ),
        ),
    ],
)
@pytest.mark.impatient
def test_other_lasers_over_rtu(tmp_path, laser, bench, survey):
    """A polled display and a described ASCII line, the machine on an RTU line."""
    if laser == "nd":
        bench += "noise_um = 0.0\n"
    options = {
        "laser_bench": bench.replace("noise_um = 0.0\n", ""),
        "laser_survey": survey,
        "transport": "rtu",
        "poll_hz": 40.0,
    }
    with hall(tmp_path, laser=laser, n=1, handshake=True, dwell=0.5, **options) as place:
        with daemon(place.survey) as process:
            place.start_setups()
            said = until(process, "survey-complete")
        assert said[-1]["exit_code"] == 0, said[-1]
        assert_solved(place, increments=1)


@pytest.mark.impatient
def test_the_handshake_paces_the_machine(tmp_path):
    """With the handshake the machine waits for each stop to be captured, however short its
    dwell."""
    with hall(tmp_path, handshake=True, dwell=0.1) as place:
        with daemon(place.survey) as process:
            place.start_setups()
            said = until(process, "survey-complete")
        assert said[-1]["exit_code"] == 0
        assert not [
            each
            for each in said
            if each["event"] == "finding" and each["code"].startswith("stop-")
        ]
        assert_solved(place)


@pytest.mark.impatient
def test_setups_in_any_order(tmp_path):
    with hall(
        tmp_path, n=1, handshake=True, dwell=0.5, setups=("pnp", "ppp", "ppn", "npp")
    ) as place:
        text = place.survey.read_text().replace(
            '"pnp", "ppp", "ppn", "npp"', '"ppp", "npp", "pnp", "ppn"'
        )
        place.survey.write_text(text)
        with daemon(place.survey) as process:
            place.start_setups()
            assert until(process, "survey-complete")[-1]["exit_code"] == 0


@pytest.mark.impatient
def test_a_killed_daemon_goes_on_where_it_was(tmp_path):
    """kill -9 in the middle of a pass: the captured stops are kept, the pass goes on in a second
    log, what nobody watched is doubted.

    A person accepts it: the result is made, and replays.
    """
    with hall(tmp_path, handshake=True, n=3, dwell=0.5) as place:
        with daemon(place.survey) as process:
            place.start_setups(stop_after=1)
            until(process, "stop", stop=4)
            os.kill(process.process.pid, signal.SIGKILL)
            process.process.wait()
        assert list(place.round.glob("*.part"))
        with daemon(place.survey) as process:
            seen = until(process, "stop")
            assert seen[-1]["stop"] in (4, 5, 6)
            place.setups = place.setups[1:]
            place.start_setups()
            assert until_complete(process, place.survey)[-1]["exit_code"] == 0
        code, out, refusal = stepdiag(
            "replay", place.round, "--out", tmp_path / "again", "--json"
        )
        assert code == 0, refusal
        assert json.loads(out)["different"] == []
        book = nothing_silently_wrong(place)
        assert all(each.whole for each in book.passes)
        assert {doubt.code for doubt in book.doubts()} <= {"laser-unwatched"}


def test_absent_devices_are_a_state_not_a_failure(tmp_path):
    """Neither port nor PLC is there: the daemon says so and waits; it ends cleanly when told to."""
    with hall(tmp_path) as place:
        absent = tmp_path / "absent.toml"
        text = place.survey.read_text().replace("devices/laser", "devices/nowhere")
        lines = [
            "port = 1"
            if line.startswith("port = ") and line[7:].isdigit() and line != "port = 8420"
            else line
            for line in text.splitlines()
        ]
        absent.write_text("\n".join(lines))
        with daemon(absent, wait_for=()) as process:
            seen = until(process, "link-lost", link="machine")
            seen += (
                until(process, "link-lost", link="laser")
                if not any(s.get("link") == "laser" for s in seen)
                else []
            )
            time.sleep(0.5)
            assert process.process.poll() is None
        assert process.process.returncode == 0


def test_a_second_daemon_on_the_folder_refuses(tmp_path):
    with hall(tmp_path) as place, daemon(place.survey):
        code, _, said = process_of_its_own("run", place.survey)
    assert code == 2
    assert "no other daemon in this folder" in said
    assert re.search(r"found a daemon that runs \(process [0-9]+\)", " ".join(said.split()))


def test_a_wrong_survey_file_is_refused_by_field(tmp_path):
    with hall(tmp_path) as place:
        wrong = tmp_path / "wrong.toml"
        wrong.write_text(
            place.survey.read_text().replace("poll_hz = 50.0", 'poll_hz = "fast"')
        )
        code, _, said = process_of_its_own("run", wrong)
    assert code == 2
    assert 'plc.poll_hz: expected a number above 0, found "fast"' in said


def test_a_survey_with_a_missing_pass_says_which(tmp_path):
    with hall(tmp_path, n=1, handshake=True, dwell=0.5, setups=("ppp", "npp")) as place:
        place.survey.write_text(
            place.survey.read_text().replace('"ppp", "npp"', '"ppp", "npp", "pnp", "ppn"')
        )
        with daemon(place.survey) as process:
            place.start_setups()
            until(process, "pass-ended", kind="complete")
            until(process, "pass-ended", kind="complete")
        code, _, said = stepdiag("replay", place.round, "--out", tmp_path / "again")
    assert code == 3
    assert "(pnp): pass 1; diagonal X-Y-Z+ to X+Y+Z- (ppn): pass 1" in said
    assert not (tmp_path / "again").exists()
