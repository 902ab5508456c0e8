"""What fuzzing and reading have found: each by the smallest input that showed it, with what
somebody else is told now."""

import base64
import json
import os
import re
from dataclasses import replace
from pathlib import Path

import pytest

from stepdiag.base.csv_table import read_table
from stepdiag.base.errors import DataError, UsageError
from stepdiag.base.files import read_bytes
from stepdiag.base.readings.readings import parse_readings
from stepdiag.base.readings.runs import Plan, Run
from stepdiag.base.result.result import parse_result
from stepdiag.base.settings import read_toml
from stepdiag.completion.completion import complete
from stepdiag.daq.links.ports.address import host_and_port, network_line
from stepdiag.daq.log.codec import decode
from stepdiag.daq.log.contents import open_log
from stepdiag.daq.log.topics import BLOCK_TOPIC, RAW_TOPICS
from stepdiag.daq.recording.rounds import latest_round, noted_stops, round_folders
from stepdiag.daq.survey.assumed import parse_uncertainty
from stepdiag.daq.survey.bundle import bundle_from_run, read_bundle
from stepdiag.daq.survey.file import load_survey, parse_survey
from stepdiag.daq.survey.head_file import parse_head_file
from stepdiag.exporters.files.control_file import ControlFile
from stepdiag.exporters.profiles.file import load_profile, parse_profile
from stepdiag.exporters.profiles.registry import CONTROLLERS
from stepdiag.exporters.programs.signals import LONGEST_TEXT, Signals
from stepdiag.exporters.tables import lattice
from stepdiag.fourdof.commissioning import compare_curves, parse_curves
from stepdiag.fourdof.record import read_head_csv
from stepdiag.solver.methods.solve import solve
from stepdiag.solver.model.angles import parse_angles
from stepdiag.solver.planning.circumstances import Circumstances
from stepdiag.solver.planning.planner import forecast
from testkit.exact.machines import EOB, MACHINES, profile_of, profile_text
from testkit.exact.results import VOLUME, made_result
from testkit.exact.surveys import Bench
from testkit.hostile.doors import doors
from testkit.hostile.foreign import HEAD, READINGS, page_order
from testkit.hostile.foreign_logs import SURVEY, contents, log_of, recorded
from testkit.running.survey_files import SMALLEST
from testkit.timeline import survey_text

HUGE = "9" * 5000
"""More digits than Python turns into a number."""


# settings: survey, profile, calibration


@pytest.mark.parametrize(
    ("text", "found"),
    [
        (f"a = {HUGE}", "integer string conversion"),
        ("a = " + "[" * 5000, "recursion"),
        ("a." * 100_000 + "b = 1", "names of at most 20 parts"),
        ('"\\"". ' * 30 + "b = 1", "names of at most 20 parts"),
    ],
)
def test_toml_that_takes_for_ever_or_breaks_the_reader_is_refused(text, found):
    """A dotted name of 100,000 parts took minutes and gigabytes."""
    with pytest.raises(UsageError, match=found):
        read_toml(text, "foreign")


@pytest.mark.parametrize("field", ["drift_um", "reading_um"])
def test_a_cause_larger_than_any_machine_is_refused(field):
    """A drift of a kilometre divided by zero in the solver."""
    with pytest.raises(UsageError, match=rf"{field}: expected.*10000"):
        parse_uncertainty(f"[uncertainty]\n{field} = 1e9\n", "u.toml")


def test_a_cause_next_to_nothing_is_solved_with():
    """Angles of 1e-320 urad overflowed where the head's place was compared with them."""
    assumed = parse_uncertainty("[uncertainty]\nangles_urad = 1e-320\n", "u.toml")
    assert solve(parse_readings(READINGS.decode(), "r.csv"), assumed=assumed).errors


def test_toml_of_many_dots_that_are_no_names_is_read():
    text = "# " + "." * 500 + "\na.b.c = 1.5\nd = '" + "." * 500 + "'\n"
    assert read_toml("\ufeff" + text, "mine")["a"] == {"b": {"c": 1.5}}


@pytest.mark.parametrize(
    "pattern",
    ["(?P<position>[a)", "(?P<position>" * 500, "(?P<position>(((a{999}){999}){999}))"],
)
def test_a_pattern_that_cannot_be_held_is_refused(pattern):
    text = survey_text().replace(
        "pattern = '(?P<counter>\\d+) (?P<position>-?\\d+\\.\\d+) (?P<beam>\\d\\.\\d+)'",
        f"pattern = '{pattern}'",
    )
    assert pattern in text
    with pytest.raises(UsageError, match=r"laser\.line\.pattern"):
        parse_survey(text, "foreign")


def test_a_control_s_name_cannot_lead_out_of_the_folder():
    """The replay of a foreign log wrote REFUSED.txt wherever the log wanted."""
    with pytest.raises(UsageError, match=r"export\[0\]\.controller"):
        parse_survey(
            survey_text() + '[[export]]\ncontroller = "../../else"\nprofile = "p"\n',
            "foreign",
        )


def test_a_name_with_a_nul_is_no_file(tmp_path: Path):
    with pytest.raises(UsageError, match="null byte"):
        read_bytes(tmp_path / "a\x00b")


def test_what_a_profile_names_is_a_file_and_no_pipe_that_never_speaks(tmp_path: Path):
    os.mkfifo(tmp_path / "pipe")
    text = profile_text(
        "neutral",
        steps_mm=(100.0, 100.0, 50.0),
        references_mm=(0.0, 0.0, 0.0),
        direction="mean",
    )
    (tmp_path / "p.toml").write_text(text.replace("existing = []", 'existing = ["pipe"]'))
    with pytest.raises(
        UsageError,
        match=r"^p\.toml: machine\.existing: expected a readable file pipe, found pipe, which is "
        r"not valid$",
    ):
        load_profile(tmp_path / "p.toml", CONTROLLERS["neutral"], VOLUME)


def profile(controller: str, old: str, new: str) -> object:
    text = profile_text(
        controller,
        steps_mm=(100.0, 100.0, 50.0),
        references_mm=(-200.0, 0.0, -100.0),
        direction="mean",
    )
    assert old in text
    return parse_profile(
        text.replace(old, new, 1),
        "foreign",
        CONTROLLERS[controller],
        VOLUME,
        MACHINES[controller].files,
    )


@pytest.mark.parametrize(
    ("controller", "old", "new", "field"),
    [
        ("heidenhain", 'name = "AX1"', 'name = "../../AX1"', "axes.X.name"),
        ("siemens", 'name = "AX1"', 'name = "Ä"', "axes.X.name"),
        ("siemens", 'name = "AX1"', 'name = "X]=1\\nM30"', "axes.X.name"),
        ("siemens", "X = 50", f"X = {10**12}", "siemens.eec_points.X"),
        ("siemens", "X = 50", f"X = {10**400}", "siemens.eec_points.X"),
        (
            "heidenhain",
            'generation = "tnc640"',
            'generation = "tnc640"\nassignment = "../C.CMA"',
            "heidenhain.assignment",
        ),
        ("neutral", "existing = []", 'existing = ["a\\u0000"]', "machine.existing"),
        (
            "fanuc",
            "detection_unit_um = 1.0",
            "detection_unit_um = 1e-300",
            "fanuc.detection_unit_um",
        ),
        ("neutral", 'name = "test machine"', 'name = "a\\u0000"', "machine.name"),
        ("fanuc", "reference_mm = -200.0", f"reference_mm = {10**30}", "axes.X.reference_mm"),
    ],
)
def test_a_profile_that_writes_elsewhere_or_without_end_is_refused(
    controller, old, new, field
):
    with pytest.raises(UsageError, match=f"foreign: {field}: "):
        profile(controller, old, new)


@pytest.mark.parametrize("step", ["1e-9", "1e-300"])
def test_a_step_that_gives_a_table_without_end_is_refused(step):
    """200,000,000,001 points asked for 1.5 TB."""
    with pytest.raises(
        UsageError, match=r"axes\.X\.step_mm: expected at most 20000 sections"
    ):
        profile("neutral", "step_mm = 100.0", f"step_mm = {step}").grid_mm("X")  # type: ignore[attr-defined]
    with pytest.raises(UsageError, match="vertices"):
        lattice.lattice_of(made_result(), float(step))


@pytest.mark.parametrize(
    "text",
    [
        "{setup:>999999999}",
        "{setup!r}",
        "{setup:{count}}",
        "A\x00",
        "Ä",
        "A" * (LONGEST_TEXT + 1),
    ],
)
def test_a_text_for_the_plc_that_breaks_the_program_is_refused(text):
    with pytest.raises(UsageError, match=r"program\.stand"):
        Signals(begin="", stand=text, leave="", wait="", end="")


def test_too_much_beside_a_survey_is_refused_before_it_makes_a_log_that_nobody_can_read(
    tmp_path: Path,
):
    names = [f"t{number}" for number in range(9)]
    (tmp_path / "p.toml").write_text(f"[machine]\nexisting = {names}\n")
    for name in names:
        (tmp_path / name).write_bytes(bytes(4_000_000))
    path = tmp_path / "survey.toml"
    path.write_text(survey_text() + '[[export]]\ncontroller = "fanuc"\nprofile = "p.toml"\n')
    with pytest.raises(UsageError, match="at most 32000000 bytes"):
        read_bundle(path, load_survey(path))


@pytest.mark.parametrize("size", [1_000_001])
def test_a_calibration_or_a_profile_too_large_to_be_one_is_not_read(
    tmp_path: Path, size: int
):
    (tmp_path / "big.toml").write_bytes(b"#" * size)
    with pytest.raises(UsageError, match="at most 1000000 bytes"):
        load_profile(tmp_path / "big.toml", CONTROLLERS["neutral"], VOLUME)
    (tmp_path / "survey.toml").write_text(
        survey_text(
            setups=("ppp", "fourdof-x"),
            signals='[head]\nformat = "tqd"\nport = "/dev/null1"\nid = "a"\ncalibration = '
            '"big.toml"\n',
        )
    )
    with pytest.raises(UsageError, match="at most 1000000 bytes"):
        load_survey(tmp_path / "survey.toml")


# tables of controls


@pytest.mark.parametrize(
    ("controller", "name", "data", "found"),
    [
        (
            "beckhoff",
            "a.lis",
            "kopf.achs_nr 1\nkw.ssfk.interval 1\nkw.ssfk.unit 1\nkw.ssfk.kw_nr_max 999999999999\n",
            "at most as many points as the list has entries",
        ),
        (
            "mitsubishi",
            "a.txt",
            (
                "#4000 1\n#4001 AX1\n#4002 AX1\n#4003 1\n#4004 1\n#4005 999999999999\n#4006 "
                "1\n#4007 "
                "1\n"
            ),
            "5124",
        ),
        (
            "siemens",
            "a.INI",
            f"$AN_CEC[0,{HUGE}]=1\nM17\n",
            "line 1: expected at most 4096 characters",
        ),
        (
            "siemens",
            "a.INI",
            f"$AN_CEC[0,{'9' * 30}]=1\nM17\n",
            "a whole number within the range of the control",
        ),
        ("linuxcnc", "screw_x.comp", "0 0 0\n1e308 0 0\n", "three numbers"),
        (
            "neutral",
            "a.csv",
            "function,direction,position_mm,error_um\nEXX,0,0,0\nEXX,0,1e300,0\nend,,,\n",
            "line 3: expected a number",
        ),
    ],
)
def test_a_table_that_asks_for_everything_is_refused(controller, name, data, found):
    with pytest.raises(DataError, match=found):
        CONTROLLERS[controller].parse(
            [ControlFile(name=name, data=data.encode())], profile_of(controller, VOLUME)
        )


@pytest.mark.parametrize("number", [HUGE, "9" * 400])
def test_a_punch_file_with_endless_numbers_is_no_pitch_data(number):
    lines = ["%", f"N1{number}Q0P0", f"N10001P{number}", "%"]
    file = ControlFile(name="PITCH.TXT", data=EOB.join(line.encode() for line in lines) + EOB)
    with pytest.raises(DataError, match="expected pitch data"):
        CONTROLLERS["fanuc"].parse([file], profile_of("fanuc", VOLUME))


def test_a_lattice_of_rows_that_never_meet_is_not_filled_up():
    """Ten thousand rows of their own places would have been a lattice of 10^12 vertices."""
    rows = "".join(f"{n},{n},{n},0,0,0\n" for n in range(10_000))
    with pytest.raises(DataError, match="a complete lattice"):
        lattice.parse(
            ControlFile(name="lattice.csv", data=f"{lattice.HEADER}\n{rows}".encode())
        )


def test_remarks_that_never_end_cost_no_time():
    with pytest.raises(DataError, match="a new key"):
        CONTROLLERS["beckhoff"].parse(
            [ControlFile(name="a.lis", data=b"kw." + b"/*" * 2000 + b"\n")],
            profile_of("beckhoff", VOLUME),
        )


# readings, angles, curves, results


def test_a_header_of_very_many_columns_is_refused_at_once():
    """Every name was counted for every name."""
    with pytest.raises(DataError, match="twice"):
        read_table("a," * 200_000 + "a\n1\n", "foreign", ("a",))


@pytest.mark.parametrize("number", ["1e300", "-1e300", "9" * 400])
def test_a_number_no_machine_has_is_refused(number):
    with pytest.raises(DataError, match="line 2: reading_mm: expected a finite number"):
        parse_readings(f"setup,pass,stop,x_mm,y_mm,z_mm,reading_mm\nppp,1,0,0,0,0,{number}\n")


@pytest.mark.parametrize(
    "setups",
    [
        ("ppp",),
        ("ppp", "npp", "pnp", "ppn"),
        ("ppp", "npp", "pnp", "ppn", "linear-x", "linear-y", "linear-z"),
    ],
)
def test_a_survey_of_one_increment_is_solved(setups):
    """A function between two nodes has no shape: the estimator looked for one."""
    result = solve(Bench(increments=1).survey(setups))
    assert all(
        not function.value[0] and len(function.value) == 2
        for function in result.errors.values()
        if function.value is not None
    )
    assert parse_result(result.to_json()).errors["EYX"].value.tolist() == [0.0, 0.0]


def test_a_survey_of_one_increment_is_planned():
    survey = Plan(
        volume=replace(VOLUME, increments=1),
        runs=tuple(Run(setup=name) for name in ("ppp", "npp", "pnp", "ppn")),
    )
    assert forecast(survey, Circumstances()).volumetric_um > 0


def test_angles_that_lean_the_mirror_out_of_the_beam_are_refused():
    """Every round of the adjustment leaned it further, until its numbers overflowed."""
    readings = Bench(size_mm=(300.0, 200.0, 100.0), increments=2).survey()
    angles = parse_angles(
        "axis,position_mm,EA_urad,EB_urad,EC_urad,u_urad\nx,0,0,0,0,0.1\nx,100,1,24294967296,,"
        "0.1\nx,300,2,3,24,8.1\n"
    )
    with pytest.raises(DataError, match="a mirror leaning by at most 200 mrad"):
        solve(readings, angles=angles)


def test_curves_that_share_no_place_are_refused():
    ours = parse_curves("position_mm,EYX_um\n0,1\n100,2\n", "ours")
    for theirs in ("position_mm,EYX_um\n0,\n1,\n", "position_mm,EYX_um\n100,1\n100,2\n"):
        with pytest.raises(DataError, match="two positions or more"):
            compare_curves(ours, parse_curves(theirs, "theirs"))
    with pytest.raises(DataError, match="two positions or more"):
        compare_curves(parse_curves("position_mm,EYX_um\n50,1\n50,2\n", "theirs"), ours)


def test_a_clock_that_jumps_does_not_ask_for_an_interval_a_second():
    text = "time_s,qd_x,qd_y,qd_sum\n0,0,0,1\n1,0,0,1\n900000000000,0,0,1\n"
    with pytest.raises(DataError, match="samples in every interval of 1 s"):
        read_head_csv(text, "foreign").averaged(1.0)


def changed(path: list[str], value: str) -> str:
    """Return a result with one entry replaced by JSON as it stands."""
    document = json.loads(made_result().to_json())
    inner = document
    for name in path[:-1]:
        inner = inner[name]
    inner[path[-1]] = "@"
    return json.dumps(document).replace('"@"', value)


@pytest.mark.parametrize(
    ("path", "value", "found"),
    [
        (["volume", "increments"], HUGE, "integer string conversion"),
        (["volume", "increments"], "9" * 400, "from 1 to 500"),
        (["volume", "size_mm"], "[1, 1, " + "9" * 400 + "]", "a finite number"),
        (["method"], '"\\ud800"', "surrogate"),
        (["closure_um"], '{"x": [1e999]}', "closure_um.x.0.: expected a finite number"),
        (["fit"], "[" * 50 + "]" * 50, "fit: expected an object"),
        (
            ["budget"],
            '{"assumptions": {}, "combined": {}, "shares": {"EXX": {"air": '
            + "9" * 400
            + "}}}",
            "a finite number",
        ),
        (["setups"], '{"ppp": 3}', "setups.ppp: expected an object"),
    ],
)
def test_a_result_that_cannot_be_written_again_is_refused(path, value, found):
    with pytest.raises(DataError, match=found):
        parse_result(changed(path, value), "foreign")


# logs


def test_a_log_that_names_a_file_it_does_not_bring_costs_that_export_alone(tmp_path: Path):
    """KeyError."""
    text, run, *messages = contents(recorded()).split(b"\n")
    left = {key: value for key, value in json.loads(run).items() if key != "file:p.toml"}
    log = tmp_path / "0001.mcap"
    log.write_bytes(log_of(b"\n".join([text, json.dumps(left).encode(), *messages])))
    done = complete([log], tmp_path / "out")
    assert (
        str(done.refusals["neutral"])
        == "p.toml: expected this file in the log, because the survey file names it, found nothing"
    )


@pytest.mark.parametrize(
    "note", [b"", b"[]", b"{}", b'{"window_from_mono_ns": "x"}', b"[" * 3000]
)
def test_notes_that_no_recorder_wrote_are_refused(tmp_path: Path, note: bytes):
    log = tmp_path / "0001.mcap"
    log.write_bytes(log_of(contents(recorded()) + b"\n/machine/stop " + note))
    with pytest.raises(DataError, match="captured stops in the format of a log"):
        noted_stops(log)


def test_a_log_that_was_cut_off_before_it_began_does_not_hold_up_the_survey(tmp_path: Path):
    """A kill, or a full disk, before the first byte of a log: the daemon did not start again, and
    the survey was never solved."""
    round_ = tmp_path / "0001"
    round_.mkdir()
    (round_ / "0001.mcap.part").write_bytes(b"")
    begun = latest_round(tmp_path, SURVEY, {})
    assert (begun.folder, begun.logs, begun.stops) == (round_, 1, ())
    (round_ / "0002.mcap").write_bytes(recorded())
    assert len(latest_round(tmp_path, SURVEY, {}).stops) == 4
    assert complete([round_], tmp_path / "out").result.volume.increments == 1


BYTES = {
    "time": {"sec": 1, "nsec": 2},
    "t_mono_ns": "5000",
    "order": 0,
    "skip": [0],
    "run": [1],
    "after_us": [0],
    "data": ["x"],
}
BLOCKS = {
    **BYTES,
    "recv_us": [0],
    "answer_us": [0],
    "ranges": "holding 0 1",
    "data": ["0000"],
}


@pytest.mark.parametrize(
    ("topic", "fields", "change"),
    [
        (RAW_TOPICS["laser"], BYTES, {"t_mono_ns": "9" * 30}),
        (RAW_TOPICS["laser"], BYTES, {"t_mono_ns": "-1"}),
        (RAW_TOPICS["laser"], BYTES, {"after_us": [2**60]}),
        (BLOCK_TOPIC, BLOCKS, {"answer_us": [6]}),
        (BLOCK_TOPIC, BLOCKS, {"ranges": "holding 0 1|holding 2 1"}),
    ],
)
def test_events_at_times_that_no_clock_shows_or_answers_nobody_asked_for_are_damage(
    topic, fields, change
):
    assert decode(topic, json.dumps(fields).encode())
    with pytest.raises(ValueError, match=r"t_mono_ns cannot be|answers cannot be"):
        decode(topic, json.dumps({**fields, **change}).encode())


@pytest.mark.parametrize("text", ["Ä", "a", "@@@@"])
def test_a_file_in_a_log_that_is_no_base64_is_refused(text):
    assert bundle_from_run({"file:a": base64.b64encode(b"x").decode()}, "mine") == {"a": b"x"}
    with pytest.raises(DataError, match="base64"):
        bundle_from_run({"file:a": text}, "foreign")


def test_a_log_with_a_survey_or_a_file_too_large_to_be_one_is_refused(tmp_path: Path):
    log = tmp_path / "0001.mcap"
    log.write_bytes(log_of(json.dumps(SURVEY + "#" * 1_000_000).encode()))
    with pytest.raises(DataError, match="a survey file of at most 1000000 bytes"):
        open_log(log)
    with pytest.raises(DataError, match="mine: a: expected at most 4000000 bytes"):
        bundle_from_run({"file:a": base64.b64encode(bytes(4_000_001)).decode()}, "mine")


def test_a_setup_of_endless_number_is_none():
    with pytest.raises(DataError, match="setup: expected one of"):
        parse_readings(f"setup,stop,x_mm,y_mm,z_mm,reading_mm\nppp+{HUGE},0,0,0,0,0\n")


def test_a_folder_named_by_half_a_digit_is_no_round(tmp_path: Path):
    """To Python a superscript two is a digit, but no number."""
    (tmp_path / "²").mkdir()
    assert round_folders(tmp_path) == []


@pytest.mark.parametrize("body", [b'{"name": "\xff"}', b'{"x": ' + b"[" * 2000])
def test_an_order_that_is_no_text_is_not_understood(body: bytes):
    """It was answered as a fault of the program."""
    assert page_order(body) == [400, 403]


NAMES_OF_NOBODY = ("192.168..5", "x" * 64, "a." + "x" * 70 + ".b")


@pytest.mark.parametrize("host", NAMES_OF_NOBODY)
@pytest.mark.parametrize("section", ["plc", "page", "metrics"])
def test_a_host_that_cannot_be_looked_up_is_refused_when_the_survey_is_read(
    section: str, host: str
):
    """A dot too many in plc.host ended the daemon: Python refuses such a name while looking it up,
    with an error that is no OSError."""
    with pytest.raises(
        UsageError,
        match=rf"{section}\.host: expected a name or an address with 1 to 63 letters",
    ):
        parse_survey(f'{SMALLEST}[{section}]\nhost = "{host}"\n', "s.toml")


@pytest.mark.parametrize("host", NAMES_OF_NOBODY)
def test_nor_is_it_the_host_of_a_line_or_a_broker(host: str):
    with pytest.raises(UsageError, match="the host as a name or an address"):
        network_line(f"socket://{host}:4001")
    assert host_and_port(f"{host}:4001") is None
    assert host_and_port("mill-7.works.example:4001") == ("mill-7.works.example", 4001)


@pytest.mark.parametrize("directory", ["x" * 256, "a/" + "ä" * 128, "a/" * 1001, "a\\u0000b"])
def test_a_folder_that_no_file_system_takes_is_refused_when_the_survey_is_read(
    directory: str,
):
    """`status` said that the name is too long; the daemon ended with a traceback."""
    with pytest.raises(UsageError, match=r"survey\.directory"):
        parse_survey(
            SMALLEST.replace("[survey]\n", f'[survey]\ndirectory = "{directory}"\n'), "s.toml"
        )


@pytest.mark.parametrize("position", [[0.0, 1e9, 200.0], [0.0], [0.0, 0.0, 200.0]])
def test_a_posterior_whose_positions_do_not_rise_is_refused(position):
    """The spline between them ended `compare` with a traceback."""
    found = json.loads(solve(parse_readings(READINGS.decode(), "r.csv")).to_json())
    found["posterior"]["position_mm"]["Y"] = position
    with pytest.raises(DataError, match="ascending positions"):
        parse_result(json.dumps(found), "r.json")


@pytest.mark.parametrize("count", [0, 21])
def test_a_curve_of_a_head_has_coefficients(count):
    """One without any ended the command that read it with a traceback."""
    text, changed = re.subn(
        "coefficients_um = .*", f"coefficients_um = {[1.0] * count}", HEAD, count=1
    )
    assert changed
    with pytest.raises(UsageError, match="coefficients_um"):
        parse_head_file(text.encode(), "head.toml")


def test_positions_that_no_control_knows_apart_do_not_rise(tmp_path):
    """A position of 1e-320 mm beside 0 made a slope that overflowed in `verify`."""
    door = doors()["verify fagor table"]
    changed = door.files[door.wrong].replace("\n100.0000;", "\n1e-320;")
    assert changed != door.files[door.wrong]
    (tmp_path / "here").mkdir()
    told = door.with_text(changed).go_through(tmp_path / "here")
    assert (told.code, "grid-unfit" in told.refusal + told.out) == (5, True), told
