"""The computer itself fails: its disk is full, its clock is set, it stands still. Real processes,
sockets and ptys."""

import csv
import json
import shutil
import signal
import sys
import time
from pathlib import Path

import pytest
from mcap.records import Message

from stepdiag.daq.log.reader import RecordReader
from stepdiag.daq.recording.rounds import noted_stops
from stepdiag.daq.replay import replay
from testkit.cli import stepdiag
from testkit.running.hall import STEPDIAG, daemon, hall, until, until_complete
from testkit.running.smalldisk import small_disk
from testkit.running.verdict import nothing_silently_wrong

pytestmark = pytest.mark.system

COMPENSATED = {"laser_bench": "compensated = true\n", "laser_survey": "compensated = true\n"}
PACED = {"handshake": True, "dwell": 0.1, **COMPENSATED}
"""The machine waits at every stop until it is captured."""
SET_CLOCK = Path(__file__).parents[2] / "lib" / "testkit" / "running" / "set_clock.py"
HELD_S = 5.0


def stops_in(said):
    """Return (setup, stop) of every stop that a daemon announced."""
    return [(each["setup"], each["stop"]) for each in said if each["event"] == "stop"]


def test_a_full_disk_stops_the_recording_and_the_machine_until_there_is_room(tmp_path):
    """Loud, nothing announced is lost, what was recorded stays readable, a restart while it is full
    works, the survey completes."""
    with small_disk(tmp_path / "hall", "8m") as disk, hall(tmp_path, **PACED) as place:
        inside = (*disk.inside, *STEPDIAG)
        round_ = disk.here / "0001"
        with daemon(place.survey, command=inside) as process:
            place.start_setups(stop_after=1)
            said = until(process, "stop", stop=2)
            disk.fill()
            said += until(process, "recorder", state="blocked")
            assert (said[-1]["level"], said[-1]["reason"]) == (
                "error",
                "No space left on device",
            )
            before = stops_in(said)
            time.sleep(1.0)
            said += list(iter(process.poll, None))
            announced = stops_in(said)
            assert len(announced) <= len(before) + 1, "the machine waits for room"
            told = stepdiag("status", disk.here, "--verbose").out
            shutil.copytree(round_, tmp_path / "meanwhile")
            kept = noted_stops(next((tmp_path / "meanwhile").iterdir()))
            assert [(stop.setup, stop.stop) for stop in kept[: len(announced)]] == announced
            assert len(kept) <= len(announced) + 1, (
                "kept, and not announced where the disk was full right behind it"
            )
            assert "a daemon is recording here" in told
            assert "only 0.0 GB are left on the disk" in told
            assert f"drive again from stop {kept[-1].stop + 1} on" in told
            assert (
                replay([next((tmp_path / "meanwhile").iterdir())]).book.last_count
                == kept[-1].stop_count
            )
        assert process.process.returncode == 4, "it could not write what it had"
        with daemon(place.survey, command=inside, wait_for=()) as process:
            until(process, "recorder", state="blocked")
            disk.free()
            until(process, "recorder", state="recording")
            place.setups = place.setups[1:]
            place.start_setups()
            assert until_complete(process, disk.here)[-1]["exit_code"] == 0
        shutil.copytree(round_, tmp_path / "kept")
        compared = json.loads(
            stepdiag("replay", tmp_path / "kept", "--out", tmp_path / "again", "--json").out
        )
        assert compared["different"] == compared["rounded"] == compared["missing"] == []
    book = nothing_silently_wrong(place, tmp_path / "kept")
    assert all(each.whole for each in book.passes)
    again = {
        (stop.setup, stop.stop)
        for log in (tmp_path / "kept").glob("*.mcap*")
        for stop in noted_stops(log)
    }
    assert set(announced) <= again


@pytest.mark.parametrize("while_recording", [False, True])
def test_a_survey_folder_that_goes_away_is_an_error_in_words(tmp_path, while_recording):
    """Unmounted or moved, and nothing is recorded elsewhere in silence: the daemon ends, and says
    what to do."""
    with (
        hall(tmp_path, setups=("ppp",), n=1, **PACED) as place,
        daemon(place.survey) as process,
    ):
        if while_recording:
            place.start_setups(stop_after=1)
            until(process, "stop")
        place.round.parent.rename(tmp_path / "away")
        said = []
        while (line := process.lines.get(timeout=120)) is not None:
            said.append(line)
        process.process.wait(timeout=120)
    words = " ".join(said)
    assert process.process.returncode == 4
    assert "Traceback" not in words
    assert "No such file or directory" in words
    assert "mount or restore the survey's folder" in words


def test_a_clock_set_by_an_hour_changes_nothing_but_the_time_of_day(tmp_path):
    """Forwards in a pass, backwards between two: stops, readings and result are right, the logs in
    order, the replay the same bytes."""
    off_by = tmp_path / "off-by"

    def set_clock(process, seconds):
        new = off_by.with_suffix(".new")
        new.write_text(str(seconds))
        new.replace(off_by)
        return round(until(process, "clock-set")[-1]["by_s"])

    off_by.write_text("0")
    with hall(tmp_path, n=2, back=True, **PACED) as place:
        with daemon(
            place.survey, command=(sys.executable, str(SET_CLOCK), str(off_by))
        ) as process:
            place.start_setups(stop_after=1)
            until(
                process, "stop", stop=0
            )  # the daemon looks at the clocks once a second: the log must still be open then
            assert set_clock(process, 3600) == 3600
            whole = {path: path.read_bytes() for path in place.round.glob("*.mcap")}
            place.setups = place.setups[1:]
            place.start_setups(stop_after=1)
            until(process, "stop", setup="npp", outward=True, stop=6)
            assert set_clock(process, -3600) == -7200
            place.setups = place.setups[1:]
            place.start_setups()
            assert until(process, "survey-complete")[-1]["exit_code"] == 0
        assert all(path.read_bytes() == data for path, data in whole.items())
        logs = sorted(place.round.glob("*.mcap*"))
        assert [log.name for log in logs] == [f"{number:04d}.mcap" for number in range(1, 9)]
        assert nothing_silently_wrong(place).complete()
        assert "the time of day was changed by +3600.0 s" in messages(logs)
        times = [float(row["time_s"]) for row in readings(place)]
        assert times == sorted(times)
        assert times[-1] < 300
        compared = json.loads(
            stepdiag("replay", place.round, "--out", tmp_path / "again", "--json").out
        )
        assert compared["different"] == compared["rounded"] == compared["missing"] == []


def messages(logs):
    """Return what the logs hold, message by message, as one text."""
    return "".join(
        record.data.decode()
        for log in logs
        for record in RecordReader(log)
        if isinstance(record, Message)
    )


def readings(place):
    """Return the rows of the readings in the order in which they were measured."""
    return list(csv.DictReader((place.round / "readings.csv").read_text().splitlines()))


@pytest.mark.parametrize(
    ("options", "after_s"),
    [
        pytest.param({"feed": 600.0}, 0.3, id="in a move"),
        pytest.param({"window": 0.5}, 0.45, id="in a dwell"),
    ],
)
def test_a_computer_that_stands_still(tmp_path, options, after_s):
    """SIGSTOP is what a suspended computer looks like: its stamps go on. The beam is cut meanwhile:
    the count is off, and nobody saw it."""
    with hall(tmp_path, setups=("ppp",), **PACED, **options) as place:
        with daemon(place.survey) as process:
            place.start_setups(stop_after=1)
            until(process, "stop", stop=1)
            time.sleep(after_s)
            process.process.send_signal(signal.SIGSTOP)
            time.sleep(HELD_S / 2)
            place.bench.say('fault {"kind": "beam-lost", "duration_s": 0.2}')
            time.sleep(HELD_S / 2)
            process.process.send_signal(signal.SIGCONT)
            said = until(process, "pass-ended")
        book = nothing_silently_wrong(place)
        told = stepdiag("status", place.survey, "--verbose").out
    (still,) = [each for each in said if each["event"] == "stood-still"]
    assert still["seconds"] > HELD_S - 1
    assert still["asleep_s"] == 0
    assert "laser-unwatched" in {each["code"] for each in said if each["event"] == "finding"}
    (only,) = book.passes
    assert only.whole, only.why_incomplete()
    assert ("may be wrong" in told) is bool(only.why_doubtful())
