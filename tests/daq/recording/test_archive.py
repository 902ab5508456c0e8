"""A budget is kept by packing finished surveys, the oldest first; nothing is lost by it."""

import threading
from functools import cache

import mcap.writer
import pytest
import zstandard

from stepdiag.daq.log.contents import open_log
from stepdiag.daq.recording.archive import MARK, digest, keep_budget, pack, size_bytes
from stepdiag.daq.records.survey_folder import RESULT
from testkit.recording import recording, with_notes, write_log


@cache
def _recorded():
    return with_notes(recording(20.0, lines_per_chunk=20))


def finished_round(folder, number, *, result=True):
    """Write a round with one log; return it."""
    made = folder / f"{number:04d}"
    made.mkdir()
    write_log(made / "0001.mcap", _recorded())
    if result:
        (made / RESULT).write_text("{}")
    return made


def read(log):
    """Return all that a reader gets of a log."""
    opened = open_log(log)
    return list(opened.events()), opened.header, opened.end


def test_a_packed_log_is_smaller_and_says_the_same(tmp_path):
    log = finished_round(tmp_path, 1) / "0001.mcap"
    before, said, stamp, size = (
        read(log),
        digest(log),
        log.stat().st_mtime_ns,
        log.stat().st_size,
    )
    assert pack(log) == size - log.stat().st_size > 0.1 * size
    assert (read(log), digest(log), log.stat().st_mtime_ns) == (before, said, stamp)
    assert [path.name for path in log.parent.iterdir() if path.name.startswith("0001")] == [
        "0001.mcap"
    ]


def test_packed_at_once_or_one_by_one_a_log_comes_to_the_same_bytes(tmp_path):
    """Two that changed the writer's level at once left it changed, and one of the logs loose."""
    logs = [finished_round(tmp_path, number) / "0001.mcap" for number in range(1, 5)]
    pack(logs[0])
    threads = [threading.Thread(target=pack, args=[log]) for log in logs[1:]]
    for each in threads:
        each.start()
    for each in threads:
        each.join()
    assert {log.read_bytes() for log in logs} == {logs[0].read_bytes()}
    assert vars(mcap.writer)["zstandard"] is zstandard


def test_the_oldest_finished_rounds_come_first(tmp_path):
    rounds = [
        finished_round(tmp_path, 1, result=False),
        *(finished_round(tmp_path, number) for number in (2, 3)),
    ]
    budget = size_bytes(tmp_path) - 1
    assert [packed.folder for packed in keep_budget(tmp_path, budget)] == [rounds[1]]
    assert list(keep_budget(tmp_path, budget)) == []
    assert [packed.folder for packed in keep_budget(tmp_path, 0)] == [rounds[2]]
    assert not (rounds[0] / MARK).exists()
    assert list(keep_budget(tmp_path, 0)) == []


@pytest.mark.parametrize("keep", [0.3, 0.9])
def test_a_damaged_log_stays_as_it_is(tmp_path, keep):
    log = finished_round(tmp_path, 1) / "0001.mcap"
    data = log.read_bytes()
    log.write_bytes(data[: int(keep * len(data))])
    assert pack(log) == 0
    assert log.read_bytes() == data[: int(keep * len(data))]
