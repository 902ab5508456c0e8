"""The survey file: what is accepted, and what a person is told when it is not."""

import re
import tomllib
from hashlib import sha256
from pathlib import Path

import msgspec
import pytest
from hypothesis import given
from hypothesis import strategies as st

from stepdiag.base.errors import UsageError
from stepdiag.base.result.typed import written
from stepdiag.base.settings import convert
from stepdiag.daq.formats.instruments.line import LineSettings
from stepdiag.daq.formats.signals import CONTRACT_SIGNALS, SignalDecoder
from stepdiag.daq.records.events import ModbusBlock, ReadRange
from stepdiag.daq.survey.bundle import compensation_of, read_bundle
from stepdiag.daq.survey.file import head_decoder, laser_decoder, load_survey, parse_survey
from stepdiag.daq.survey.formats import laser_settings
from stepdiag.daq.survey.models import Survey
from stepdiag.daq.survey.rules import rtu_poll_s
from stepdiag.daq.survey.template import template
from testkit.running.survey_files import SMALLEST

STOPPED = '[plc.signals.stopped]\naddress = 2\ntype = "bit"\n'
SWITCHED_ON = re.sub(r"^#(?=[a-z\[])", "", template(), flags=re.MULTILINE).replace(
    'source = "plc"', 'source = "sensor"'
)


def refusal(text: str) -> str:
    with pytest.raises(UsageError) as refused:
        parse_survey(SMALLEST + text, "survey.toml")
    return str(refused.value)


def field_paths(model: type[msgspec.Struct]) -> set[str]:
    """Every key of the survey file by its own name, sections included."""
    names = set()
    for field in msgspec.structs.fields(model):
        names.add(field.encode_name)
        for part in (field.type, *getattr(field.type, "__args__", ())):
            if isinstance(part, type) and issubclass(part, msgspec.Struct):
                names |= field_paths(part)
    return names


def test_template_validates_and_is_the_defaults() -> None:
    """What the template switches on is what holds where a file says nothing; but for the linear
    runs, which give the scales: logs carry files of before them, and these go on to mean what they
    meant."""
    survey = parse_survey(template(), "template")
    smallest = parse_survey(SMALLEST, "s")
    assert survey.plan.setups == (*smallest.plan.setups, "linear-x", "linear-y", "linear-z")
    assert msgspec.structs.replace(survey.plan, setups=smallest.plan.setups) == smallest.plan
    assert survey.plc == smallest.plc
    assert survey.stop == smallest.stop
    assert (survey.page, survey.metrics, survey.environment, survey.solver) == (
        smallest.page,
        smallest.metrics,
        smallest.environment,
        smallest.solver,
    )


def test_template_validates_with_everything_switched_on() -> None:
    survey = parse_survey(SWITCHED_ON, "template")
    assert survey.laser.line is not None
    assert survey.head is not None
    assert survey.plan.all_setups == (
        "ppp",
        "ppp+1",
        "npp",
        "pnp",
        "ppn",
        "linear-x",
        "linear-y",
        "linear-z",
    )
    assert set(survey.plc.own_signals) == {"stopped", "x_mm"}
    assert survey.plc.signal_names == ("stopped", "running", "stop_count", "x_mm")


def test_template_documents_every_field() -> None:
    keys = set(re.findall(r"^#?([a-z_]+) = ", template(), flags=re.MULTILINE))
    keys |= {
        part
        for section in re.findall(r"^#?\[+([a-z0-9_.]+)\]", template(), flags=re.MULTILINE)
        for part in section.split(".")
    }
    assert field_paths(Survey) - keys == {"token"}  # of older files: refused


def test_template_optional_settings_are_comments_only_by_one_sign() -> None:
    """Switching a setting on is deleting one sign: the text is TOML either way."""
    assert tomllib.loads(SWITCHED_ON)["laser"]["nd"]["resolution_mm"] == 0.0001


def test_sections_reach_their_places(tmp_path: Path) -> None:
    survey = parse_survey(
        SMALLEST + "[plan]\nreturn_pass = true\nrepeats = 3\n[plc]\ntimeout_s = 1\n", "s"
    )
    assert survey.volume.size_mm == (500.0, 400.0, 300.0)
    assert survey.axis_order == "xyz"
    assert survey.plan.passes_per_setup == 6
    assert survey.plc.signals == CONTRACT_SIGNALS
    assert survey.folder(tmp_path / "survey.toml") == tmp_path / "s"


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (
            '[plc]\npoll_hz = "fast"',
            'survey.toml: plc.poll_hz: expected a number above 0, found "fast"',
        ),
        (
            "[plc]\npoll_hz = 0",
            "survey.toml: plc.poll_hz: expected a number above 0, found 0",
        ),
        (
            "[plc]\npoll_hz = 5000",
            "survey.toml: plc.poll_hz: expected at most 1000, found 5000.0",
        ),
        (
            "[plc]\nport = 70000",
            "survey.toml: plc.port: expected a whole number from 1 to 65535, found 70000",
        ),
        ("[page]\nenabled = 1", "survey.toml: page.enabled: expected true or false, found 1"),
        (
            "[stop]\nsettle_s = nan",
            "survey.toml: stop.settle_s: expected a number of at least 0, found NaN",
        ),
        (
            "[machine]\nexpansion_um_m_c = [1, 2]",
            "machine.expansion_um_m_c: expected 3 values, each a number, found [1, 2]",
        ),
        (
            "[machine]\nexpansion_um_m_c = [1, 2, inf]",
            "machine.expansion_um_m_c[2]: expected a number, found Infinity",
        ),
        (
            '[machine]\nchain = "FXY"',
            (
                "machine.chain: expected F, X, Y and Z once each, from workpiece to tool, such as "
                'FXYZ, found "FXY"'
            ),
        ),
        (
            "[[plan]]\nrepeats = 2",
            'survey.toml: plan: expected a table, found [{"repeats": 2}]',
        ),
        (
            '[plan]\nsetups = "ppp"',
            'plan.setups: expected a list, each entry a text, found "ppp"',
        ),
        (
            '[plan]\nsetups = ["ppp", "ppp"]',
            'plan.setups[1]: expected every setup once, found "ppp"',
        ),
        ('[plan]\nsetups = ["pppp"]', "did you mean ppp?"),
        (
            '[plan]\nsetups = ["fourdof-x"]',
            "plan.setups[0]: expected a [head] section for a 4-DOF run",
        ),
        ("[plan]\nsetups = []", "plan.setups: expected at least one setup"),
        (
            '[[plan.beam_offset]]\nsetup = "ppp"\noffset_mm = [0, 0, 0]',
            "plan.beam_offset[0].offset_mm: expected a beam that is shifted",
        ),
        (
            '[[plan.beam_offset]]\nsetup = "ppp"',
            (
                "plan.beam_offset[0].offset_mm: expected 3 values, each a number, found nothing; "
                "add "
                "it"
            ),
        ),
        (
            "[plan]\ndwell_s = 0.5",
            (
                "plan.dwell_s: expected at least 0.54 s (settle 0.2 + window 0.3 + two polls of "
                "0.02), found 0.5"
            ),
        ),
        (
            '[[export]]\ncontroller = "siemens"',
            "export[0].profile: expected a text that is not empty, found nothing; add it",
        ),
        ('[plc]\ntransport = "rtu"', "plc.serial_port: expected a serial port"),
        (
            '[plc]\ntransport = "rtu"\nserial_port = "/dev/ttyUSB0"\npoll_hz = 10',
            "plc.serial_port: expected another port than laser.port",
        ),
        (
            '[plc]\ntransport = "rtu"\nserial_port = "/dev/ttyS1"',
            "poll_hz: expected at most 36 polls a second at 19200 baud: one poll takes 27.5 ms",
        ),
        (
            "[environment]\nsource = 'laser'",
            (
                'environment.source: expected "laser" only with format = ids3010 or lasertex, '
                "found "
                '"umd"'
            ),
        ),
        (
            "[environment.sensor]\nport = '/dev/air'\nformat = 'ptu300'",
            'environment.source: expected "sensor" or "fixed" beside',
        ),
        (
            (
                "[environment]\nsource = 'sensor'\n[environment.sensor]\nport = "
                "'/dev/air'\nformat = "
                "'ptu300'\ntemperature_unit = 'F'"
            ),
            (
                'environment.sensor: expected the units "C" and "hPa" for format = "ptu300", '
                "found F "
                "and hPa"
            ),
        ),
        (
            "[metrics]\nenabled = true\nport = 8420",
            "metrics.port: expected another port than page.port",
        ),
    ],
)
def test_a_wrong_field_is_named_with_what_was_expected(text: str, message: str) -> None:
    assert message in refusal(text)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("[plc]\npol_hz = 3", "plc.pol_hz: expected one of"),
        ("[plc]\npol_hz = 3", "found the unknown name pol_hz; did you mean poll_hz?"),
        ("[planed]\nx = 3", "survey.toml: planed: expected one of"),
        (STOPPED + "[plc.signals.stop_cont]\naddress = 1\n", "did you mean stop_count?"),
        (STOPPED + "adress = 3\n", "plc.signals.stopped.adress"),
    ],
)
def test_an_unknown_key_is_refused_with_the_nearest_known_one(
    text: str, message: str
) -> None:
    assert message in refusal(text)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (
            "[plc.signals.stop_count]\naddress = 1\n",
            "plc.signals: expected at least the signal `stopped`",
        ),
        (
            STOPPED + "[plc.signals.stop_count]\naddress = 2\n",
            (
                "plc.signals.stop_count.address: expected an address that no other signal has, "
                "found holding 2"
            ),
        ),
        (
            STOPPED + '[plc.signals.running]\naddress = 2\ntype = "bit"\n',
            "found holding 2 bit 0, which stopped uses (holding 2 bit 0)",
        ),
        (
            STOPPED + '[plc.signals.x_mm]\naddress = 1\ntype = "int32"\n',
            "found holding 1-2, which stopped uses",
        ),
        (
            STOPPED + '[plc.signals.x_mm]\naddress = 65535\ntype = "int32"\n',
            "plc.signals.x_mm.address: expected at most 65534",
        ),
        (
            STOPPED + '[plc.signals.x_mm]\naddress = 9\ntable = "coil"\n',
            'plc.signals.x_mm.type: expected "bit" in table coil',
        ),
        (
            STOPPED + '[plc.signals.x_mm]\naddress = 9\ntype = "bit"\n',
            "plc.signals.x_mm.type: expected a number",
        ),
        (
            STOPPED + '[plc.signals.setup]\naddress = 9\ntype = "bit"\n',
            "plc.signals.setup.type: expected a number",
        ),
        (
            STOPPED + "[plc.signals.running]\naddress = 9\nscale = 2\n",
            "plc.signals.running.scale: expected scale 1 and offset 0",
        ),
        (
            STOPPED + "[plc.signals.x_mm]\naddress = 9\nscale = 0\n",
            "plc.signals.x_mm.scale: expected a number other than 0",
        ),
        (
            '[plc.signals.stopped]\naddress = 2\ntype = "bit"\nbit = 1\ntable = "coil"\n',
            "plc.signals.stopped.bit: expected 0 in table coil",
        ),
        (
            STOPPED + "[plc.handshake]\nenabled = true\n",
            "plc.handshake.enabled: expected the signal stop_count",
        ),
        (
            "[plc.handshake]\nenabled = true\naddress = 5\n",
            "plc.handshake.address: expected a free register: the signal x_mm already uses",
        ),
    ],
)
def test_a_register_map_that_contradicts_itself_is_refused(text: str, message: str) -> None:
    assert message in refusal(text)


def test_what_is_counted_may_come_as_any_number_and_a_heartbeat_as_one_bit() -> None:
    """Contract 2: any signal in any type. Controls that know only reals send even the setup as
    float32; many toggle one heartbeat bit."""
    text = (
        STOPPED
        + """
[plc.signals.setup]
address = 9
type = "float32"
order = "CDAB"
[plc.signals.stop_count]
address = 30
scale = 1.0
offset = -1.0
[plc.signals.heartbeat]
table = "discrete"
address = 7
type = "bit"
"""
    )
    signals = parse_survey(SMALLEST + text, "survey.toml").plc.signals
    asked = (
        ReadRange("holding", 9, 2),
        ReadRange("holding", 30, 1),
        ReadRange("discrete", 7, 1),
    )
    block = ModbusBlock(0, 1, asked, (bytes.fromhex("00004130"), b"\x00\x05", b"\x01"))
    found = SignalDecoder(
        {name: signals[name] for name in ("setup", "stop_count", "heartbeat")}
    ).decode(block)
    assert (found.setup, found.stop_count, found.heartbeat) == (11, 4, 1)


@pytest.mark.parametrize(
    ("pattern", "message"),
    [
        (
            "(?P<position>[",
            (
                "laser.line.pattern: expected a regular expression of RE2, between single quotes, "
                "found '(?P<position>[' ("
            ),
        ),
        ("[0-9]+", "laser.line.pattern: expected a named group (?P<position>...)"),
        ("(?P<position>.)(?P<bean>.)", "did you mean beam?"),
    ],
)
def test_a_line_pattern_is_read_before_it_is_needed(pattern: str, message: str) -> None:
    text = SMALLEST.replace('"umd"', '"line"') + f"[laser.line]\npattern = '{pattern}'\n"
    with pytest.raises(UsageError, match=re.escape(message)):
        parse_survey(text, "survey.toml")


def test_the_table_of_the_chosen_format_is_asked_for() -> None:
    with pytest.raises(UsageError, match=r"laser\.line: expected a table for format"):
        parse_survey(SMALLEST.replace('"umd"', '"line"'), "survey.toml")


def test_a_volume_that_reads_like_metres_is_refused() -> None:
    """0.5 x 0.4 x 0.3: a table in metres would be a thousand times too short."""
    metres = SMALLEST.replace("size_mm = [500, 400, 300]", "size_mm = [0.5, 0.4, 0.3]")
    assert metres != SMALLEST
    with pytest.raises(
        UsageError, match=r"volume\.size_mm: expected lengths in mm.*seems to be in metres"
    ):
        parse_survey(metres, "s")


def test_as_many_increments_as_can_be_solved_and_no_more() -> None:
    """500 along an axis take the solver a minute and 2.4 GB (`base.volume`)."""
    most = SMALLEST.replace("increments = 10", "increments = 500")
    assert parse_survey(most, "s").volume.increments == 500
    with pytest.raises(UsageError, match=r"volume\.increments: expected .*500, found 501"):
        parse_survey(most.replace("= 500\n", "= 501\n"), "s")


def test_a_toml_error_names_its_line() -> None:
    assert "at line 11" in refusal("[plc\n")


@pytest.mark.parametrize("name", ["../up", "", "a/b", ".hidden", "x" * 65])
def test_a_name_cannot_leave_its_folder(name: str) -> None:
    with pytest.raises(UsageError, match=r"survey\.name"):
        parse_survey(SMALLEST.replace('"s"', f'"{name}"'), "survey.toml")


def test_files_that_are_named_must_exist(tmp_path: Path) -> None:
    path = tmp_path / "survey.toml"
    path.write_text(
        SMALLEST + '[[export]]\ncontroller = "siemens"\nprofile = "p.toml"\n',
        encoding="utf-8",
    )
    with pytest.raises(
        UsageError,
        match=r"export\[0\]\.profile: expected a file that exists, found no file p\.toml beside "
        r"survey\.toml",
    ):
        load_survey(path)
    (tmp_path / "p.toml").touch()
    assert load_survey(path).exports[0].controller == "siemens"


def test_an_unreadable_survey_file_is_refused(tmp_path: Path) -> None:
    with pytest.raises(UsageError, match="expected a survey file, found No such file"):
        load_survey(tmp_path / "none.toml")
    (tmp_path / "latin.toml").write_bytes(b"x = '\xe4'")
    with pytest.raises(
        UsageError, match="expected text in UTF-8, found byte 5, which is not"
    ):
        load_survey(tmp_path / "latin.toml")
    (tmp_path / "big.toml").write_bytes(b"#" * 1_000_001)
    with pytest.raises(UsageError, match="at most 1000000 bytes"):
        load_survey(tmp_path / "big.toml")


def test_wire_time_of_ten_registers() -> None:
    """instruments.md 4.2: FC03, 10 registers at 19200 baud take 22.9 ms."""
    signals = {
        name: msgspec.structs.replace(spec, address=index)
        for index, (name, spec) in enumerate(list(CONTRACT_SIGNALS.items())[:10])
    }
    narrow = {
        name: msgspec.structs.replace(spec, type="uint16") for name, spec in signals.items()
    }
    assert rtu_poll_s(narrow, 19200) * 1e3 == pytest.approx(22.9, abs=0.05)


VALUES = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=8),
    lambda inner: (
        st.lists(inner, max_size=4)
        | st.dictionaries(
            st.sampled_from(["stopped", "address", "pattern", "x"]), inner, max_size=3
        )
    ),
    max_leaves=6,
)


@given(
    section=st.sampled_from(["survey", "plan", "laser", "plc", "volume", "head", "export"]),
    key=st.data(),
    value=VALUES,
)
def test_anything_in_any_field_is_accepted_or_refused_by_name(
    section: str, key: st.DataObject, value: object
) -> None:
    """Whatever stands in a field: a survey, or the one refusal that names the file; never another
    error."""
    data = tomllib.loads(SWITCHED_ON)
    table = data[section][0] if section == "export" else data[section]
    table[key.draw(st.sampled_from(sorted(table)))] = value
    try:
        said = str(convert(data, Survey, "survey.toml"))
    except UsageError as refused:
        said = str(refused)
    assert said.startswith(("Survey(", "survey.toml: "))


@pytest.mark.parametrize(("name", "polled"), [("umd", False), ("nd", True), ("line", False)])
def test_the_laser_format_gives_its_decoder(name: str, polled: bool) -> None:
    survey = parse_survey(
        SWITCHED_ON.replace(
            'format = "umd"', f'format = "{name}"\nlatency_s = 0.25', 1
        ).replace("latency_s = 0.0\n", "", 1),
        "s",
    )
    decoder = laser_decoder(survey)
    assert decoder.latency_s == 0.25
    assert hasattr(decoder, "request") == polled


@pytest.mark.parametrize(("name", "polled"), [("fourdof", False), ("tqd", True)])
def test_the_head_format_gives_its_decoder(name: str, polled: bool) -> None:
    survey = parse_survey(
        SWITCHED_ON.replace('format = "fourdof"', f'format = "{name}"'), "s"
    )
    assert hasattr(head_decoder(survey), "request") == polled


def test_a_counter_that_never_repeats_is_said_with_nought() -> None:
    text = SWITCHED_ON.replace('format = "umd"', 'format = "line"', 1)
    settings = laser_settings(
        parse_survey(
            text.replace("counter_modulus = 65536", "counter_modulus = 0"), "s"
        ).laser
    )
    assert isinstance(settings, LineSettings)
    assert settings.counter_modulus is None
    with pytest.raises(
        UsageError,
        match=r"laser\.line\.counter_modulus: expected 0 \(the counter never repeats\) or a "
        r"number from 2 up, found 1",
    ):
        parse_survey(text.replace("counter_modulus = 65536", "counter_modulus = 1"), "s")


class TestCompensation:
    """What is active in the control while measuring: asked by the template, with files, day and way
    where it is on."""

    ON = (
        '[machine]\ncompensation = "on"\nactive = ["A.INI"]\nactive_date = '
        '2026-01-31\nactive_source = "archive"\n'
    )

    def test_the_template_asks(self) -> None:
        assert parse_survey(template(), "template").machine.compensation == "?"

    @pytest.mark.parametrize(
        ("left_out", "field"),
        [
            ("active = ", "machine.active"),
            ("active_date", "machine.active_date"),
            ("active_source", "machine.active_source"),
        ],
    )
    def test_on_needs_the_files_with_day_and_way(self, left_out: str, field: str) -> None:
        text = "".join(
            line
            for line in self.ON.splitlines(keepends=True)
            if not line.startswith(left_out)
        )
        assert refusal(text).startswith(f"survey.toml: {field}: expected")

    def test_off_has_no_active_files(self) -> None:
        assert "machine.active" in refusal(self.ON.replace('"on"', '"off"'))

    def test_the_files_go_into_the_log_with_their_hashes(self, tmp_path: Path) -> None:
        (tmp_path / "A.INI").write_bytes(b"table")
        survey = parse_survey(SMALLEST + self.ON, "survey.toml")
        bundle = read_bundle(tmp_path / "survey.toml", survey)
        assert bundle == {"A.INI": b"table"}
        assert (
            written(compensation_of(survey, bundle).facts()).items()
            >= {
                "compensation": "on",
                "active_files": [
                    {
                        "name": "A.INI",
                        "sha256": sha256(b"table").hexdigest(),
                        "date": "2026-01-31",
                        "source": "archive",
                    }
                ],
            }.items()
        )
