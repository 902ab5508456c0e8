"""Faults over real processes, sockets and ptys. The rule: a stop is right, or it is named as
doubtful, or it is asked for again."""

import json
import os
import re

import pytest
from mcap.reader import make_reader

from stepdiag.daq.log.contents import open_log
from stepdiag.daq.records.survey_folder import logs_in
from stepdiag.daq.replay import replay
from stepdiag.daq.service.daemon import Daemon
from testkit.cli import stepdiag
from testkit.running.hall import daemon, hall, until
from testkit.running.verdict import nothing_silently_wrong

pytestmark = pytest.mark.system

COMPENSATED = "compensated = true\n"


SETUPS = ("ppp", "npp", "pnp", "ppn")
LONGER_S = 3.5
"""In seconds of the machine, ten to one of ours: six of dwell leave room for a fault and for a
window beside it."""


def at(setup, stop, kind, **more):
    """Return a fault that strikes when the machine comes to a stop, or with ``phase="move"`` on the
    way to it."""
    return {"kind": kind, "setup": setup, "stop": stop, **more}


def run_with(tmp_path, faults, *, ends=None, **options):
    """Drive setups with faults; return the passes by setup, what the daemon said, and what
    ``status`` says afterwards.

    Where no dwell is given, those stops dwell longer to which a fault comes.
    """
    setups = tuple(name for name in SETUPS if name in {each["setup"] for each in faults})
    longer = (
        []
        if "dwell" in options
        else [
            at(each["setup"], each["stop"], "dwell-longer", duration_s=LONGER_S)
            for each in faults
        ]
    )
    tables = [
        "[[fault]]\n"
        + "".join(
            f"{key} = {json.dumps(value)}\n"
            for key, value in each.items()
            if value is not None
        )
        for each in (*longer, *faults)
    ]
    settings = {
        "laser_bench": COMPENSATED,
        "laser_survey": COMPENSATED,
        "setups": setups,
        **options,
    }
    with hall(tmp_path, faults="\n".join(tables), **settings) as place:
        with daemon(place.survey) as process:
            place.start_setups()
            said = []
            while sum(each["event"] == "pass-ended" for each in said) < (ends or len(setups)):
                said.append(process.next(120.0, "daemon"))
        book = nothing_silently_wrong(place)
        told = stepdiag("status", place.survey, "--verbose").out
    return book, said, told


def codes_of(said, setup=""):
    """Return the codes of the findings, those of one setup where it is named, and the events."""
    named = [each for each in said if each["event"] != "finding" or setup in each["text"]]
    return {each.get("code", each["event"]) for each in named}


@pytest.mark.impatient
def test_what_can_be_bridged_costs_nothing(tmp_path):
    """All passes come out whole, and what happened is named where the data show it."""
    faults = {
        "stop-recovered": at("ppp", 2, "stop-unsignalled"),
        "count-disagrees": at("ppp", 5, "count-doubled"),
        "bytes-lost unseen": at("ppp", 3, "laser-garbage", delay_s=0.2, value=-60.0),
        "silent PLC": at("npp", 2, "plc-silent", duration_s=0.2),
        "count-disagrees anew": at("npp", 4, "plc-reboot", phase="move", duration_s=0.2),
        "slow PLC": at("pnp", 1, "plc-late", duration_s=0.3, value=0.1),
        "bytes-garbled": at("pnp", 3, "laser-garbage", value=40.0),
        "samples-missing": at("pnp", 5, "laser-silent", phase="move", duration_s=0.1),
        "beam-lost": at("ppn", 2, "beam-lost", delay_s=0.25, duration_s=0.1),
        "instrument-restart": at("ppn", 4, "laser-unplug", delay_s=0.25, duration_s=0.1),
    }
    book, said, told = run_with(tmp_path, faults.values())
    assert all(each.whole for each in book.passes), [
        each.why_incomplete() for each in book.passes
    ]
    assert {code for code in faults if " " not in code} <= codes_of(said)
    first = said[: next(at for at, each in enumerate(said) if each["event"] == "pass-ended")]
    assert {"bytes-garbled", "samples-missing"} <= codes_of(first), (
        "the line that lost bytes, and the samples that went with them"
    )
    assert "instrument-restart" not in codes_of(first)
    assert {doubt.code for doubt in book.doubts()} == {"stop-recovered"}
    assert "found in the laser's readings" in told


@pytest.mark.impatient
@pytest.mark.parametrize(
    "options", [{}, {"transport": "rtu", "poll_hz": 40.0}], ids=["TCP", "RTU"]
)
def test_a_plc_that_answers_after_its_time_out(tmp_path, options):
    """A late answer is never taken for the one to the next poll; a stop that was not seen meanwhile
    is taken from the laser and doubted."""
    book, said, _ = run_with(
        tmp_path, [at("ppp", 2, "plc-late", duration_s=0.3, value=0.4)], dwell=6.0, **options
    )
    assert all(each.whole for each in book.passes), [
        each.why_incomplete() for each in book.passes
    ]
    assert "link-silent" in codes_of(said)
    late = [each["detail"] for each in said if each["event"] == "answers-late"]
    assert re.search(r"raise plc.timeout_s above 0\.[4-9]", late[0]), late


@pytest.mark.impatient
def test_a_line_read_at_a_wrong_baud_rate_for_a_second(tmp_path):
    """What was not read is not made up: the stop without a reading is asked for, or the count that
    nobody watched is doubted."""
    book, said, told = run_with(
        tmp_path, [at("ppp", 3, "laser-baud", phase="move", duration_s=1.0)], dwell=6.0
    )
    assert "bytes-garbled" in codes_of(said)
    assert not book.complete() or "may be wrong" in told
    assert "drive again from stop" in told


@pytest.mark.impatient
def test_what_cannot_is_asked_for_again_by_name(tmp_path):
    """No pass is whole, a finding says why, and ``status`` says what is kept and from where to
    drive again."""
    expected = {
        "ppp": ("beam-lost", at("ppp", 3, "beam-lost", phase="move", duration_s=0.1)),
        "npp": ("beam-lost", at("npp", 3, "laser-unplug", phase="move", duration_s=0.05)),
        "pnp": ("step-mismatch", at("pnp", 3, "laser-reset", phase="move")),
        "ppn": ("stop-lost", at("ppn", 3, "stop-skipped")),
    }
    book, said, told = run_with(
        tmp_path, [fault for _, fault in expected.values()], dwell=3.0
    )
    for setup, (code, _) in expected.items():
        (only,) = book.of(setup)
        assert not only.complete, setup
        assert code in codes_of(said, setup), setup
        assert f"({setup}): pass 1: {only.why_incomplete()}" in told
        assert "drive again from stop 3 on" in str(only.why_incomplete())


@pytest.mark.impatient
def test_a_program_with_another_order_of_axes_is_named(tmp_path):
    book, said, _ = run_with(
        tmp_path, [{"kind": "axis-order", "setup": "ppp", "text": "yxz"}], n=1, dwell=3.0
    )
    (named,) = [
        each for each in said if each["event"] == "finding" and each["severity"] == "error"
    ]
    assert 'volume.axis_order = "yxz"' in named["text"]
    assert not book.complete()


@pytest.mark.impatient
@pytest.mark.parametrize("cut", [False, True], ids=["beam kept", "beam cut meanwhile"])
def test_a_program_restarted_two_stops_back_goes_on(tmp_path, cut):
    """The program is aborted and restarted. Where the beam was cut meanwhile, the stops measured on
    both sides join the count."""
    faults = [at("ppp", 4, "program-aborted", value=2.0, duration_s=10.0)]
    faults += [at("ppp", 4, "beam-lost", delay_s=0.9, duration_s=0.2)] if cut else []
    book, said, told = run_with(tmp_path, faults, ends=2)
    assert [each["kind"] for each in said if each["event"] == "pass-ended"] == [
        "aborted",
        "complete",
    ]
    assert {"stop-again"} <= codes_of(said)
    assert ("beam-lost" in codes_of(said)) is cut
    (only,) = book.passes
    assert only.whole, only.why_incomplete()
    assert [len(only.measured[stop]) for stop in range(7)] == [1, 1, 2, 2, 2, 1, 1]
    assert "drive again" not in told


@pytest.mark.impatient
def test_a_log_cut_at_every_byte_of_its_last_chunk_replays_up_to_the_cut(tmp_path):
    """Power loss: whatever is left of a log, its events are the first ones, so its stops are those
    of the whole log up to there.

    The last one may have been waiting for what came after the cut: it is the same stop, and reads
    the same but for its noise, or is doubted. A replay is a function of the events, so it is made
    once for each number of events.
    """
    with hall(
        tmp_path, setups=("linear-x",), n=1, laser_bench=COMPENSATED, laser_survey=COMPENSATED
    ) as place:
        with daemon(place.survey) as process:
            place.start_setups()
            until(
                process, "survey-open"
            )  # one run along one axis is no survey: the log is what is wanted
        (log,) = logs_in(place.round)
    data, whole, stops = log.read_bytes(), events_of(log), stops_of(log)
    begin, end = last_chunks(log)
    cut = tmp_path / "cut.mcap.part"
    cut.write_bytes(data)
    kept = {}
    for length in [
        *range(len(data), end, -997),
        *range(end, begin - 1, -1),
        *range(begin, len(data) // 3, -2999),
    ]:
        os.truncate(cut, length)
        events = events_of(cut)
        assert events == whole[: len(events)]
        if len(events) not in kept:
            kept[len(events)] = stops_of(cut)
            *before, last = kept[len(events)] or [None]
            assert before == stops[: len(before)]
            if last is not None:
                same = stops[len(before)]
                assert (last.setup, last.stop) == (same.setup, same.stop)
                assert last.doubts or last.reading_mm == pytest.approx(
                    same.reading_mm, abs=1e-4
                )
    assert list(kept) == sorted(kept, reverse=True)
    assert kept[len(whole)] == stops
    assert len(kept) > 2


def events_of(log):
    """Return the events that can be read from a log."""
    return list(open_log(log).events())


def stops_of(log):
    """Return the captured stops of one log."""
    book = replay([log]).book
    return [
        entry.stop
        for each in book.passes
        for index in sorted(each.measured)
        for entry in each.measured[index]
    ]


def last_chunks(log):
    """Return where the last chunk of some size begins, and where the last chunk ends: a note alone
    may stand in that."""
    with log.open("rb") as file:
        summary = make_reader(file).get_summary()
    chunks = sorted(summary.chunk_indexes, key=lambda each: each.chunk_start_offset)
    sizable = [each for each in chunks if each.chunk_length > 500]
    return sizable[-1].chunk_start_offset, chunks[-1].chunk_start_offset + chunks[
        -1
    ].chunk_length


def test_the_daemon_refuses_a_folder_it_cannot_write(tmp_path):
    (tmp_path / "survey.toml").write_text(SURVEY_ELSEWHERE)
    with pytest.raises(ValueError, match="a folder that can be written"):
        run_daemon(tmp_path / "survey.toml")


SURVEY_ELSEWHERE = """
[survey]
name = "nowhere"
machine = "m"
directory = "/proc/1"
[volume]
size_mm = [100.0, 100.0, 100.0]
increments = 1
[laser]
format = "umd"
port = "/dev/null"
"""


def run_daemon(survey):
    """Run a daemon in this process until it ends."""
    import asyncio

    async def serve():
        await Daemon(survey, ("true",)).run()

    asyncio.run(serve())
