"""``status``: what of a survey is kept and what must be driven again, from the disk alone."""

import json
import re
import shlex
from dataclasses import replace
from pathlib import Path

import msgspec
import pytest

from stepdiag.base.messages import message
from stepdiag.daq.capture.captured_stop import CapturedStop, marked
from stepdiag.daq.log.topics import stop_note
from stepdiag.daq.recording.rounds import FolderLock, latest_round
from stepdiag.daq.records.status import AheadStatus
from stepdiag.daq.service.ahead import write_ahead
from testkit.cli import stepdiag
from testkit.exact.captured import stops_of
from testkit.exact.driven import Fault, Program, machine_of, recorded, survey_file
from testkit.fleets import finished_survey
from testkit.recording import HEADER, recording, write_log
from testkit.timeline import survey_text

TEXT = survey_text(setups=("ppp", "npp"))
EVENTS = recording(0.1)


@pytest.fixture
def survey(tmp_path: Path) -> Path:
    path = tmp_path / "survey.toml"
    path.write_text(TEXT, encoding="utf-8")
    return path


def record(
    survey: Path,
    number: int,
    stops: list[CapturedStop],
    *,
    round_: str = "0001",
    finish: bool = True,
) -> Path:
    """Leave a log behind as a daemon does; cut off where it is not finished."""
    path = survey.parent / "bench" / round_ / f"{number:04d}.mcap"
    path.parent.mkdir(parents=True, exist_ok=True)
    write_log(
        path,
        [*EVENTS, *map(stop_note, stops)],
        flush_every=1,
        finish=finish,
        header=replace(HEADER, survey_text=TEXT),
    )
    return path


def told(*arguments: object) -> dict:
    return json.loads(stepdiag("status", *arguments, "--json").out)


def test_advice_of_a_setup_that_is_in_is_shown_no_longer(survey):
    """The advice after the last setup takes its time, and a daemon may end before."""
    path = record(survey, 1, stops_of())
    for setup, shown in (("npp", "npp"), ("ppp", "")):
        write_ahead(path.parent, AheadStatus(words=f"drive {setup}", setup=setup))
        assert told(survey)["ahead"]["setup"] == shown


def test_before_anything_was_recorded_everything_is_to_do(survey):
    said = told(survey)
    assert [(setup["name"], setup["state"]) for setup in said["setups"]] == [
        ("ppp", "to-do"),
        ("npp", "to-do"),
    ]
    assert (said["round"], said["next_setup"], said["complete"], said["logs"]) == (
        None,
        "ppp",
        False,
        [],
    )
    assert not (survey.parent / "bench").exists(), "status makes nothing"
    assert "nothing recorded yet" in stepdiag("status", survey).out


def test_the_table_names_diagonals_by_their_corners(survey):
    rows = [line for line in stepdiag("status", survey).out.splitlines() if "to do │" in line]
    assert [row.split("│")[1].strip() for row in rows] == [
        "diagonal X-Y-Z- to X+Y+Z+ (ppp)",
        "diagonal X+Y-Z- to X-Y+Z+ (npp)",
    ]
    assert max(map(len, rows)) <= 80


def test_what_is_whole_is_kept(survey):
    record(survey, 1, stops_of("ppp"))
    said = told(survey)
    assert [setup["state"] for setup in said["setups"]] == ["done", "to-do"]
    assert said["setups"][0]["stops_done"] == said["setups"][0]["stops_wanted"] == 10
    assert said["next_setup"] == "npp"


def test_a_pass_left_in_the_middle_goes_on_from_its_last_stop(survey):
    record(survey, 1, stops_of("ppp", only=range(4)), finish=False)
    out = stepdiag("status", survey).out
    missing = "pass 1: stops 5–10 are missing: drive again from stop 4 on"
    assert f"diagonal X-Y-Z- to X+Y+Z+ (ppp): {missing}" in out
    assert (
        "0001.mcap.part: the log is not closed: a daemon is writing it, or it was cut off"
        in out
    )
    assert "next setup: diagonal X-Y-Z- to X+Y+Z+ (ppp)" in out


def test_a_beam_that_was_lost_says_so(survey):
    stops = stops_of("ppp")
    stops[5] = msgspec.structs.replace(stops[5], broken="beam lost")
    record(survey, 1, stops)
    reason = told(survey)["setups"][0]["reason"]
    assert reason.startswith(
        "pass 1: stops 6–10 cannot be compared with the first stop (beam lost): drive again "
        "from stop 5 on"
    )


def test_the_folder_alone_is_enough_and_the_last_round_counts(survey):
    record(survey, 1, [*stops_of("ppp"), *stops_of("npp")])
    record(survey, 1, stops_of("npp"), round_="0002")
    folder = survey.parent / "bench"
    assert told(folder)["next_setup"] == "ppp"
    assert told(folder / "0001")["complete"]
    assert (
        "every pass is complete; `stepdiag solve" in stepdiag("status", folder / "0001").out
    )
    (folder / "0001" / "result.json").write_text("{}", encoding="utf-8")
    assert "complete: " in stepdiag("status", folder / "0001").out


def recommended(out: str) -> list[list[str]]:
    """Return the commands that a text recommends, as a person would type them."""
    return [
        shlex.split(each.replace("...", "'looked at it'"))
        for each in re.findall(r"`stepdiag ([^`]+)`", out.replace("\n", " "))
    ]


def test_what_it_recommends_for_a_doubt_makes_the_pass_whole(tmp_path):
    """In a folder whose name has a space, too."""
    survey = tmp_path / "the shop" / "survey.toml"
    survey.parent.mkdir()
    survey.write_text(TEXT, encoding="utf-8")
    doubted = stops_of("npp")
    doubted[3] = marked(doubted[3], message("window-step", step_um=4.0))
    record(survey, 1, [*stops_of("ppp"), *doubted])
    (accept,) = recommended(stepdiag("status", survey).out)
    assert not told(survey)["complete"]
    assert stepdiag(*accept).code == 0
    assert told(survey)["complete"]


def test_the_state_fits_a_screen_and_verbose_prints_every_doubt(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Of 30 lines of 80 columns; the next drive stands above the table of the setups."""
    monkeypatch.setenv("COLUMNS", "80")
    monkeypatch.setattr("testkit.cli.joined", lambda text: text)
    setups = ("ppp", "npp", "pnp", "ppn", "linear-x", "linear-y", "linear-z")
    text = survey_text(setups=setups)
    file = tmp_path / "survey.toml"
    file.write_text(text, encoding="utf-8")
    stops = []
    for setup in setups[:4]:
        stops += stops_of(setup)
        for at in (-2, -5, -7):
            stops[at] = marked(stops[at], message("window-step", step_um=4.0 - at))
    path = tmp_path / "bench" / "0001" / "0001.mcap"
    path.parent.mkdir(parents=True)
    notes = [*EVENTS, *map(stop_note, stops)]
    write_log(path, notes, flush_every=1, header=replace(HEADER, survey_text=text))
    lines = stepdiag("status", file).out.splitlines()
    whole = stepdiag("status", file, "--verbose").out
    assert len(lines) <= 30 < len(whole.splitlines())
    # a path is one word, and as long as the folder of the test
    own = [line for line in lines if "`" not in line and str(tmp_path) not in line]
    assert max(map(len, own)) <= 80
    (next_,) = (at for at, line in enumerate(lines) if line.startswith("next setup: "))
    assert next_ < next(
        at for at, line in enumerate(lines) if "setup" in line and "stops" in line
    )
    assert all(f"{4.0 - at:+.1f} µm" in whole for at in (-2, -5, -7))
    accepted = stepdiag("accept", file, "ppp/1", "--reason", "looked at it", "--verbose").out
    assert accepted.count("open doubt") == 9


def test_each_doubt_of_a_pass_is_said_in_words_before_the_command_that_accepts_it(survey):
    """The line of the pass has the first one alone: of the other nobody heard why."""
    stops = stops_of("npp")
    doubts = {
        3: message("window-step", step_um=4.0),
        7: message("laser-frozen", same=20, count=41),
    }
    for at, doubt in doubts.items():
        stops[at] = marked(stops[at], doubt)
    record(survey, 1, [*stops_of("ppp"), *stops])
    lines = stepdiag("status", survey, "--verbose").out.splitlines()
    for stop, words in doubts.items():
        (command,) = [at for at, line in enumerate(lines) if f"npp/1/{stop} --reason" in line]
        assert (
            lines[command - 1]
            == f"diagonal X+Y-Z- to X-Y+Z+ (npp) out, stop {stop + 1} of 10: {words}"
        )


def test_a_clock_that_was_never_set_is_named_until_the_time_is_stated(survey):
    """`status` gives the command, the result the time that was stated, and the page hears of it
    through the same file."""
    unset = [
        msgspec.structs.replace(stop, time_s=60.0 * stop.stop)
        for setup in ("ppp", "npp")
        for stop in stops_of(setup)
    ]
    record(survey, 1, unset)
    line = next(
        line for line in stepdiag("status", survey).out.splitlines() if "clock-unset" in line
    )
    assert "the survey has the date 1970-01-01" in line
    (command,) = recommended(line)
    assert stepdiag(*command).code == 2, "TIME is no time"
    for wrong in ("1999-01-01T08:00", "tomorrow"):
        assert (
            "the time of the first stop"
            in stepdiag(*(wrong if word == "TIME" else word for word in command)).refusal
        )
    assert (
        "the acceptance of the finding"
        in stepdiag(
            "accept", survey, "ppp/1", "--reason", "x", "--begun", "2027-01-15T08:00"
        ).refusal
    )
    assert (
        stepdiag(
            *("2027-01-15T08:00+00:00" if word == "TIME" else word for word in command)
        ).code
        == 0
    )
    said = told(survey)
    assert [(each["code"], each["severity"]) for each in said["findings"]] == [
        ("clock-unset", "info")
    ]
    assert "2027-01-15T08:00+00:00" in said["findings"][0]["text"]
    assert "clock-unset" not in stepdiag("status", survey).out


def test_of_a_way_back_that_the_plan_does_not_want_nothing_is_asked(survey):
    """A daemon that came back while the machine stood at its last stop begins one: who did as told
    drove a pass that nobody wants."""
    back = stops_of("ppp", outward=False, only=range(3))
    back[1] = marked(back[1], message("window-step", step_um=4.0))
    record(survey, 1, [*stops_of("ppp", only=range(5)), *back])
    out = stepdiag("status", survey).out
    assert "diagonal X-Y-Z- to X+Y+Z+ (ppp): pass 1: stops 6–10 are missing" in out
    assert "pass 2" not in out


def test_nor_where_it_is_solved(tmp_path):
    program = Program(machine_of(1), faults=[Fault("left", "ppp", 2, 3)])
    program.drive("ppp", passes=(2,))
    session, _ = recorded(tmp_path, survey_file(setups=("ppp",)), program.events())
    assert [(each.number, each.whole) for each in session.book.passes] == [(2, False)]
    refusal = stepdiag("solve", tmp_path).refusal
    assert "missing diagonal X-Y-Z- to X+Y+Z+ (ppp): pass 1" in refusal
    assert "pass 2" not in refusal


def test_what_it_recommends_where_every_pass_is_in_makes_the_result(tmp_path):
    """The same as the daemon's; afterwards it recommends nothing."""
    folder = finished_survey(tmp_path / "the shop")
    made = (folder / "result.json").read_bytes()
    (folder / "result.json").unlink()
    (solve,) = recommended(stepdiag("status", folder).out)
    assert stepdiag(*solve).code == 0
    assert (folder / "result.json").read_bytes() == made
    assert recommended(stepdiag("status", folder).out) == []


def test_a_daemon_that_records_is_seen_and_not_disturbed(survey):
    record(survey, 1, stops_of("ppp"))
    folder = survey.parent / "bench"
    assert not told(survey)["recording"]
    lock = FolderLock.take(folder)
    try:
        assert told(survey)["recording"]
    finally:
        lock.release()
    assert not told(survey)["recording"]


def test_a_survey_file_changed_since_is_named(survey):
    record(survey, 1, stops_of("ppp"))
    survey.write_text(TEXT.replace("[plc]", "[plc]\nlatency_s = 0.1", 1), encoding="utf-8")
    assert "stepdiag correct" in stepdiag("status", survey).out
    survey.write_text(TEXT, encoding="utf-8")
    assert "new round" not in stepdiag("status", survey).out
    assert latest_round(survey.parent / "bench", TEXT, {}).folder.name == "0001", (
        "undone, it goes on with these"
    )


def test_a_log_of_another_survey_among_them_is_named_and_does_not_count(survey, tmp_path):
    """Copied there by hand: `solve` and `replay` refuse it, and its stops counted as those of this
    survey."""
    record(survey, 1, stops_of("ppp"))
    other = replace(HEADER, survey_text=TEXT.replace("bench", "another"))
    write_log(
        survey.parent / "bench" / "0001" / "0002.mcap",
        [*EVENTS, *map(stop_note, stops_of("npp"))],
        flush_every=1,
        header=other,
    )
    assert told(survey)["next_setup"] == "npp"
    assert (
        "0002.mcap: different content: the stops of this log are not counted"
        in stepdiag("status", survey).out
    )


def test_a_log_that_cannot_be_read_is_named_and_the_others_count(survey):
    record(survey, 1, stops_of("ppp"))
    path = record(survey, 2, stops_of("npp"))
    path.write_bytes(b"\x00" * 100)
    said = told(survey)
    assert said["next_setup"] == "npp"
    assert said["logs"][1]["trouble"]
    (path.parent / "0001.mcap").write_bytes(b"\x00" * 100)
    told_ = stepdiag("status", path.parent)
    assert told_.code == 3
    assert "at least one log that can be read" in told_.refusal


@pytest.mark.parametrize(
    "damage",
    [
        {"setup": ""},
        {"setup": "linear-q"},
        {"setup": "xyz"},
        {"setup": "ppp+x"},
        {"stop": -1},
        {"time_s": -1e300},
        {"time_s": 1e300},
    ],
)
def test_a_log_with_a_stop_that_no_pass_can_have_is_named_and_the_others_count(
    survey, damage
):
    """`status` and `accept` ended in a traceback where a stop named no setup."""
    record(survey, 1, stops_of("ppp"))
    stops = stops_of("npp")
    stops[4] = msgspec.structs.replace(stops[4], **damage)
    record(survey, 2, stops)
    said = told(survey)
    assert [setup["state"] for setup in said["setups"]] == ["done", "to-do"]
    assert [bool(log["trouble"]) for log in said["logs"]] == [False, True]
    assert stepdiag("accept", survey, "npp/1", "--reason", "looked at it").code == 2


def test_a_folder_without_logs_is_refused(tmp_path):
    found = stepdiag("status", tmp_path)
    assert found.code == 2
    assert "expected a folder with logs (*.mcap), found none" in found.refusal
