"""The rules of a survey file that concern more than the limits of a single field."""

import re
from collections.abc import Collection, Iterator

from stepdiag.base.errors import UsageError
from stepdiag.base.messages import message
from stepdiag.base.names import AXES, FOURDOF_RUNS
from stepdiag.base.settings import refuse, unknown_key
from stepdiag.base.setups import DRIVEN_SETUPS, SETUP_NAMES, setup_of
from stepdiag.base.volume import reads_like_metres
from stepdiag.daq.formats.instruments.line import line_pattern
from stepdiag.daq.formats.signals import (
    COUNTED,
    SIGNAL_NAMES,
    SWITCHED,
    SignalMap,
    SignalSpec,
    describe,
    plan_reads,
    registers,
)
from stepdiag.daq.links.ports.address import can_be_host, network_line
from stepdiag.daq.survey.formats import air_settings, laser_settings
from stepdiag.daq.survey.models import Head, LineSection, Plc, Survey

_INPUT_NAME = re.compile(r"[A-Za-z]\w{0,31}\Z", re.ASCII)
_LINE_GROUPS = ("position", "counter", "beam")
_MAX_POLL_HZ = 1000.0
_S7_PDU = 240
_MODBUS = (re.compile(r"coil\Z|discrete\Z|holding\Z|input\Z"), message("table-over-modbus"))
_TABLES = {
    "tcp": _MODBUS,
    "rtu": _MODBUS,
    "s7": (re.compile(r"db\d+\Z"), message("table-over-s7")),
    "lsv2": (re.compile(r"[BMIO]\Z"), message("table-over-lsv2")),
}
_ORDERS = {"s7": "ABCD", "lsv2": "DCBA"}
_MAPS = {"s7": message("map-of-s7"), "lsv2": message("map-of-lsv2")}
LONGEST_PATH, LONGEST_NAME = 2000, 255
"""Largest lengths in bytes of a folder's path and of its name: the limits of kernel and file
systems (PATH_MAX 4096, NAME_MAX 255) minus space for names inside the folder.
"""
MOST_SHOWN = 100
_TELL_AIR = ("ids3010", "lasertex")
"""Formats of lasers whose own sensors of air and material are read."""
_BITS_PER_CHARACTER = 11
"""Bits of a character: start, eight data, parity or a second stop bit, stop (Modbus over serial
line V1.02, 2.5.1).
"""


def check(survey: Survey, source: str) -> None:
    """Raise UsageError for the first contradiction in a survey file, in the order of the
    sections.
    """
    for rule in (
        _named_well,
        _volume,
        _plan,
        _machine,
        _laser,
        _head,
        _air,
        _plc,
        _dwell,
        _page,
    ):
        for refusal in rule(survey, source):
            raise refusal


def _volume(survey: Survey, source: str) -> Iterator[UsageError]:
    if reads_like_metres(survey.box.size_mm):
        yield refuse(
            source,
            "volume.size_mm",
            message("lengths-mm"),
            list(survey.box.size_mm),
            message("reads-like-metres"),
        )


def _plan(survey: Survey, source: str) -> Iterator[UsageError]:
    setups = survey.plan.setups
    if not survey.plan.all_setups:
        yield refuse(source, "plan.setups", message("some-setup"), [])
    for index, setup in enumerate(setups):
        field = f"plan.setups[{index}]"
        if setup not in DRIVEN_SETUPS:
            yield unknown_key(source, field, setup, list(DRIVEN_SETUPS))
        if setup in setups[:index]:
            yield refuse(
                source,
                field,
                message("every-setup-once"),
                setup,
                message("use-plan-repeats-drive"),
            )
        if setup in FOURDOF_RUNS and survey.head is None:
            yield refuse(source, field, message("head-section-needed"), setup)
        if setup in FOURDOF_RUNS and survey.head is not None and survey.head.angular:
            yield from _turns(survey.head, setup, source)
        elif (
            setup in FOURDOF_RUNS
            and survey.head is not None
            and not (survey.head.id and survey.head.calibration)
        ):
            remedy = message("stepdiag-fourdof-calibrate-writes")
            yield refuse(
                source,
                "head.calibration",
                message("head-s-id-calibration"),
                survey.head.calibration,
                remedy,
            )
    yield from _shifted_lines(survey, source)


def _shifted_lines(survey: Survey, source: str) -> Iterator[UsageError]:
    for index, offset in enumerate(survey.plan.beam_offset):
        if not any(offset.offset_mm):
            field = f"plan.beam_offset[{index}].offset_mm"
            yield refuse(
                source,
                field,
                message("beam-shifted"),
                list(offset.offset_mm),
                message("name-setup-plan-setups"),
            )
        if offset.setup not in SETUP_NAMES:
            yield unknown_key(
                source, f"plan.beam_offset[{index}].setup", offset.setup, list(SETUP_NAMES)
            )
        signs, size = setup_of(offset.setup).signs, survey.box.size_mm
        for axis, sign, shift_mm, edge_mm in zip(
            AXES, signs, offset.offset_mm, size, strict=True
        ):
            if not sign and not 0.0 <= shift_mm <= edge_mm:
                field = f"plan.beam_offset[{index}].offset_mm: {axis}"
                yield refuse(
                    source, field, message("mm-to", low=0.0, high_mm=edge_mm), shift_mm
                )


def _turns(head: Head, setup: str, source: str) -> Iterator[UsageError]:
    axis = setup_of(setup).axis
    own = "ABC"[AXES.index(axis)]
    turns = head.angles.turns(axis)
    field, letters = f"head.angles.{axis}", [turn[1] for turn in turns]
    if not turns or len(turns) > 2 or len(set(letters)) != len(letters):
        remedy = message("such-c-b-first")
        yield refuse(
            source,
            field,
            message("rotation-each-reading-tells", setup=setup),
            list(turns),
            remedy,
        )
    if head.format == "elcomat" and own in letters:
        yield refuse(
            source, field, message("no-autocollimator-does-not", own=own), list(turns)
        )


def _named_well(survey: Survey, source: str) -> Iterator[UsageError]:
    """Check the names of hosts and folders: a name that no system accepts would later end the
    daemon with an error of Python.
    """
    for field, host in (
        ("plc.host", survey.plc.host),
        ("page.host", survey.page.host),
        ("metrics.host", survey.metrics.host),
    ):
        if not can_be_host(host):
            yield refuse(source, field, message("name-or-address"), host[:MOST_SHOWN])
    directory = survey.identity.directory
    if (
        "\0" in directory
        or len(directory.encode()) > LONGEST_PATH
        or any(len(part.encode()) > LONGEST_NAME for part in directory.split("/"))
    ):
        expected = message(
            "path-at-most-bytes", longest_path=LONGEST_PATH, longest_name=LONGEST_NAME
        )
        yield refuse(source, "survey.directory", expected, directory[:MOST_SHOWN])


def _machine(survey: Survey, source: str) -> Iterator[UsageError]:
    letters = survey.machine.chain.upper().replace("F", "", 1)
    if "F" not in survey.machine.chain.upper() or sorted(letters.lower()) != sorted(AXES):
        yield refuse(source, "machine.chain", message("f-x-y-z"), survey.machine.chain)
    machine = survey.machine
    if machine.compensation == "on":
        remedy = message("back-active-tables-up")
        if not machine.active:
            yield refuse(
                source, "machine.active", message("files-are-active-for"), [], remedy
            )
        if machine.active_date is None:
            yield refuse(source, "machine.active_date", message("day-on-which-active"), None)
        if not machine.active_source.strip():
            yield refuse(
                source,
                "machine.active_source",
                message("how-active-files-were"),
                machine.active_source,
            )
    elif machine.compensation == "off" and machine.active:
        yield refuse(
            source,
            "machine.active",
            message("no-file-for-compensation"),
            list(machine.active),
        )


def _laser(survey: Survey, source: str) -> Iterator[UsageError]:
    laser = survey.laser
    if laser.format == "frames" and laser.frames is None:
        yield refuse(
            source,
            "laser.frames",
            message("table-for-format-frames"),
            None,
            message("add-laser-frames-with"),
        )
    elif laser.format == "line" and laser.line is None:
        yield refuse(
            source,
            "laser.line",
            message("table-for-format-line"),
            None,
            message("add-laser-line-with"),
        )
    elif laser.format == "line" and laser.line is not None:
        yield from _line_pattern(laser.line, source)
    else:
        yield from _settings(survey, source)


def _settings(survey: Survey, source: str) -> Iterator[UsageError]:
    try:
        laser_settings(survey.laser)
    except UsageError as refusal:
        yield _in_the_name_of(source, refusal)


def _in_the_name_of(source: str, refusal: UsageError) -> UsageError:
    where = str(refusal.where).replace("survey:", f"{source}:", 1)
    return UsageError(
        where, expected=refusal.expected, found=refusal.found, remedy=refusal.remedy
    )


def _line_pattern(line: LineSection, source: str) -> Iterator[UsageError]:
    try:
        groups = line_pattern(line.pattern, f"{source}: laser.line.pattern").groupindex
    except UsageError as refusal:
        yield refusal
        return
    if "position" not in groups:
        yield refuse(
            source, "laser.line.pattern", message("named-group-p-position"), line.pattern
        )
    for group in groups:
        if group not in _LINE_GROUPS:
            yield unknown_key(source, "laser.line.pattern", group, list(_LINE_GROUPS))
    if line.counter_modulus == 1:
        yield refuse(source, "laser.line.counter_modulus", message("modulus-of-counter"), 1)
    if line.scale == 0:
        yield refuse(source, "laser.line.scale", message("number-not-zero"), line.scale)


def _head(survey: Survey, source: str) -> Iterator[UsageError]:
    ports = {"laser.port": survey.laser.port}
    if survey.head is not None:
        ports["head.port"] = survey.head.port
    if survey.air_sensor is not None:
        ports["environment.sensor.port"] = survey.air_sensor.port
    if survey.plc.transport == "rtu":
        ports["plc.serial_port"] = survey.plc.serial_port
    for field, port in ports.items():
        yield from _port(field, port, source)
    for field, port in list(ports.items())[1:]:
        other = next(name for name, value in ports.items() if value == port)
        if other != field:
            yield refuse(source, field, message("another-port-than", other=other), port)
    for axis, run in zip(
        AXES,
        (survey.head.x, survey.head.y, survey.head.z) if survey.head is not None else (),
        strict=False,
    ):
        if run.beam[1] != axis:
            yield refuse(
                source, f"head.{axis}.beam", message("either-sign", axis=axis), run.beam
            )
        if {run.beam[1], run.detector_x[1], run.detector_y[1]} != set(AXES):
            found = [run.beam, run.detector_x, run.detector_y]
            yield refuse(source, f"head.{axis}", message("beam-detector-x-detector"), found)


def _air(survey: Survey, source: str) -> Iterator[UsageError]:
    sensor, source_of_air = survey.air_sensor, survey.environment.source
    if source_of_air == "sensor" and sensor is None:
        remedy = message("add-environment-sensor-with")
        yield refuse(
            source, "environment.sensor", message("table-for-source-sensor"), None, remedy
        )
    if survey.environment.sensor is not None and source_of_air not in ("sensor", "fixed"):
        remedy = message("nobody-would-listen-sensor")
        yield refuse(
            source,
            "environment.source",
            message("sensor-fixed-beside-environment"),
            source_of_air,
            remedy,
        )
    if source_of_air == "laser" and survey.laser.format not in _TELL_AIR:
        remedy = message("nobody-would-tell-air")
        yield refuse(
            source,
            "environment.source",
            message("laser-with-format-alone", names=list(_TELL_AIR)),
            survey.laser.format,
            remedy,
        )
    if sensor is None:
        return
    if (
        sensor.format == "ptu300"
        and not sensor.pattern
        and (sensor.temperature_unit, sensor.pressure_unit) != ("C", "hPa")
    ):
        found = message(
            "both-units",
            temperature_unit=sensor.temperature_unit,
            pressure_unit=sensor.pressure_unit,
        )
        remedy = message("its-lines-name-them")
        yield refuse(source, "environment.sensor", message("units-c-hpa-for"), found, remedy)
    if sensor.format == "line" and not sensor.pattern:
        yield refuse(
            source,
            "environment.sensor.pattern",
            message("pattern-line-for-format"),
            sensor.pattern,
        )
        return
    try:
        air_settings(sensor)
    except UsageError as refusal:
        yield _in_the_name_of(source, refusal)


def _port(field: str, port: str, source: str) -> Iterator[UsageError]:
    try:
        line = network_line(port, f"{source}: {field}")
    except UsageError as refusal:
        yield refusal
        return
    if line is not None and line.scheme == "rfc2217" and field == "plc.serial_port":
        remedy = message("set-line-up-at")
        yield refuse(source, field, message("serial-port-socket-host"), port, remedy)


def _plc(survey: Survey, source: str) -> Iterator[UsageError]:
    plc = survey.plc
    if plc.silent:
        yield from _silent(survey, source)
        return
    if plc.transport in _MAPS and not plc.signals:
        yield refuse(
            source,
            "plc.signals",
            _MAPS[plc.transport],
            [],
            message("stepdiag-setup-writes-them"),
        )
        return
    yield from _asked(plc, source)
    if wrong := [*_places(plc, source), *_expressions(plc, source)]:
        yield from wrong
        return
    if "stopped" not in plc.signal_names:
        remedy = message("every-other-signal-may")
        yield refuse(
            source,
            "plc.signals",
            message("at-least-signal-stopped"),
            list(plc.signal_names),
            remedy,
        )
    yield from _overlaps(
        {name: spec for name, spec in plc.signals.items() if name not in plc.inputs}, source
    )
    yield from _handshake(plc, source)
    if plc.transport == "rtu":
        yield from _line_time(plc, source)
    if plc.transport == "s7":
        yield from _one_telegram(plc, source)


def _asked(plc: Plc, source: str) -> Iterator[UsageError]:
    if plc.transport == "rtu" and not plc.serial_port:
        yield refuse(
            source,
            "plc.serial_port",
            message("serial-port-for-transport"),
            "",
            message("such-dev-ttyusb1"),
        )
    if plc.poll_hz > _MAX_POLL_HZ:
        yield refuse(
            source, "plc.poll_hz", message("at-most", value=_MAX_POLL_HZ), plc.poll_hz
        )


def _places(plc: Plc, source: str) -> Iterator[UsageError]:
    for name, spec in plc.own_signals.items():
        yield from _signal(name, spec, source)
    for field, specs in (("signals", plc.own_signals), ("inputs", plc.inputs)):
        for name, spec in specs.items():
            yield from _reachable(f"plc.{field}.{name}", spec, plc, source)


def _silent(survey: Survey, source: str) -> Iterator[UsageError]:
    plc, none = survey.plc, message("nothing-without-transport")
    for field, entries in (
        ("signals", plc.own_signals),
        ("inputs", plc.inputs),
        ("expressions", plc.expressions),
    ):
        if entries:
            yield refuse(source, f"plc.{field}", none, list(entries))
    if plc.handshake.enabled:
        yield refuse(
            source, "plc.handshake.enabled", message("false-or-none", none=none), True
        )
    if survey.environment.source == "plc":
        remedy = message("laser-where-its-own")
        yield refuse(
            source, "environment.source", message("fixed-with-transport-none"), "plc", remedy
        )
    for index, setup in enumerate(survey.plan.setups):
        if setup in FOURDOF_RUNS:
            yield refuse(source, f"plan.setups[{index}]", message("no-4-dof-run"), setup)


def _expressions(plc: Plc, source: str) -> Iterator[UsageError]:
    for name, spec in plc.inputs.items():
        if not _INPUT_NAME.match(name):
            yield refuse(
                source, f"plc.inputs.{name}", message("name-letters-digits-underscore"), name
            )
        if name in SIGNAL_NAMES:
            yield refuse(
                source,
                f"plc.inputs.{name}",
                message("name-no-signal-s"),
                name,
                message("signals-stand-plc-signals"),
            )
        yield from _signal_place(f"plc.inputs.{name}", spec, source)
    for name, text in plc.expressions.items():
        field, wanted = f"plc.expressions.{name}", "bit" if name in SWITCHED else "word"
        if name not in (*SWITCHED, *COUNTED):
            yield unknown_key(source, field, name, [*SWITCHED, *COUNTED])
        if name in plc.own_signals:
            yield refuse(
                source,
                field,
                message("either-expression-plc-signals", name=name),
                message("both"),
            )
        try:
            found = plc.expression(name, source)
        except UsageError as error:
            yield error
            continue
        if found.kind != wanted:
            yield refuse(
                source,
                field,
                message("yes-no-comparison") if wanted == "bit" else message("a-number"),
                text,
            )


def _signal(name: str, spec: SignalSpec, source: str) -> Iterator[UsageError]:
    field = f"plc.signals.{name}"
    if name not in SIGNAL_NAMES:
        yield unknown_key(source, field, name, list(SIGNAL_NAMES))
    yield from _signal_place(field, spec, source)
    if spec.type == "bit" and name not in (*SWITCHED, "heartbeat"):
        yield refuse(
            source,
            f"{field}.type",
            message("a-number"),
            spec.type,
            message("only-heartbeat-may-be", names=list(SWITCHED)),
        )
    if name in SWITCHED and spec.type != "bit" and (spec.scale != 1 or spec.offset != 0):
        yield refuse(source, f"{field}.scale", message("1-offset-0-signal"), spec.scale)


def _signal_place(field: str, spec: SignalSpec, source: str) -> Iterator[UsageError]:
    if spec.in_bit_table and spec.type != "bit":
        yield refuse(
            source, f"{field}.type", message("bit-table", table=spec.table), spec.type
        )
    if spec.in_bit_table and spec.bit:
        yield refuse(
            source,
            f"{field}.bit",
            message("0-table-where-address", table=spec.table),
            spec.bit,
        )
    if spec.scale == 0:
        yield refuse(source, f"{field}.scale", message("number-not-zero"), spec.scale)
    if spec.type == "bit" and (spec.scale != 1 or spec.offset != 0):
        yield refuse(source, f"{field}.scale", message("1-offset-0-signal"), spec.scale)
    if spec.address + spec.width > 65536:
        yield refuse(source, f"{field}.address", message("at-most-65534-for"), spec.address)


def _reachable(field: str, spec: SignalSpec, plc: Plc, source: str) -> Iterator[UsageError]:
    wanted, words = _TABLES[plc.transport]
    if not wanted.match(spec.table):
        yield refuse(source, f"{field}.table", words, spec.table)
    elif spec.in_byte_table and spec.bit > 7:
        yield refuse(
            source, f"{field}.bit", message("0-7-where-address", table=spec.table), spec.bit
        )
    elif spec.in_byte_table and spec.type != "bit" and spec.order != _ORDERS[plc.transport]:
        yield refuse(
            source,
            f"{field}.order",
            message("this-control-keeps-its", orders=_ORDERS[plc.transport]),
            spec.order,
        )


def _one_telegram(plc: Plc, source: str) -> Iterator[UsageError]:
    """Check that one request reads all signals of an S7, so that the values are from one moment
    (smallest PDU: 240 bytes).
    """
    ranges = plan_reads(plc.signals, ())
    asked, answered = 14 + 12 * len(ranges), 14 + sum(5 + each.byte_count for each in ranges)
    if max(asked, answered) > _S7_PDU:
        found = message(
            "ranges-bytes", ranges=len(ranges), value=sum(each.byte_count for each in ranges)
        )
        yield refuse(
            source,
            "plc.signals",
            message("what-one-telegram-bytes", s7_pdu=_S7_PDU),
            found,
            message("lay-them-closer-together"),
        )


def _overlaps(signals: SignalMap, source: str) -> Iterator[UsageError]:
    names = list(signals)
    for index, name in enumerate(names):
        for other in names[:index]:
            one, two = signals[name], signals[other]
            different_bits = (
                one.type == two.type == "bit" and not one.in_bit_table and one.bit != two.bit
            )
            if registers([one]) & registers([two]) and not different_bits:
                place = message(
                    "value-beside-other",
                    value=describe(one),
                    other=other,
                    value_2=describe(two),
                )
                yield UsageError(
                    f"{source}: plc.signals.{name}.address",
                    expected=message("place-its-own"),
                    found=place,
                )


def _handshake(plc: Plc, source: str) -> Iterator[UsageError]:
    if not plc.handshake.enabled:
        return
    if plc.transport == "lsv2":
        yield refuse(
            source, "plc.handshake.enabled", message("false-nothing-written-over"), True
        )
    wanted = "holding" if plc.transport != "s7" else plc.handshake.table
    if plc.handshake.table != wanted or not _TABLES[plc.transport][0].match(wanted):
        yield refuse(
            source,
            "plc.handshake.table",
            _TABLES[plc.transport][1] if plc.transport == "s7" else '"holding"',
            plc.handshake.table,
        )
    if "stop_count" not in plc.signal_names:
        yield refuse(
            source, "plc.handshake.enabled", message("signal-stop-count-which"), True
        )
    for name, spec in plc.signals.items():
        written = {
            (plc.handshake.table, plc.handshake.address + at)
            for at in range(2 if plc.transport == "s7" else 1)
        }
        if written & registers([spec]):
            yield refuse(
                source,
                "plc.handshake.address",
                message("register-not-read-there", name=name),
                plc.handshake.address,
            )


def rtu_poll_s(
    signals: SignalMap, baud: int, standing: Collection[str] = ("stopped",)
) -> float:
    """Return the time of one poll on the wire in seconds, without the device's own time
    (instruments.md 4.2).

    A request has 8 characters, an answer 5 characters and its data; 3.5 characters of silence
    precede each.
    """
    characters = sum(
        8 + 5 + asked.byte_count + 2 * 3.5 for asked in plan_reads(signals, standing)
    )
    return characters * _BITS_PER_CHARACTER / baud


def _line_time(plc: Plc, source: str) -> Iterator[UsageError]:
    wire_s = rtu_poll_s(plc.signals, plc.baud, plc.standing)
    if plc.poll_hz * wire_s > 1:
        limit = int(1 / wire_s)
        yield refuse(
            source,
            "plc.poll_hz",
            message("at-most-at-baud", limit=limit, baud=plc.baud, value=wire_s * 1000.0),
            plc.poll_hz,
        )
    if plc.timeout_s < wire_s:
        yield refuse(
            source,
            "plc.timeout_s",
            message("more-than-ms-one", value=wire_s * 1000.0),
            plc.timeout_s,
        )


def least_dwell_s(survey: Survey) -> float:
    """Return the shortest possible dwell in s. A standstill is certain only between its first and
    its last poll, so that dwell > settle + window + 2 polls (instruments.md 4.2).
    """
    return survey.stop.settle_s + survey.stop.min_window_s + 2.0 / survey.plc.poll_hz


def _dwell(survey: Survey, source: str) -> Iterator[UsageError]:
    needed, poll_s = least_dwell_s(survey), 1.0 / survey.plc.poll_hz
    if survey.plan.dwell_s < needed:
        parts = {
            "settle_s": survey.stop.settle_s,
            "window_s": survey.stop.min_window_s,
            "poll_s": poll_s,
        }
        yield refuse(
            source,
            "plan.dwell_s",
            message("at-least-s", needed=needed, **parts),
            survey.plan.dwell_s,
        )


def _page(survey: Survey, source: str) -> Iterator[UsageError]:
    ports = (
        survey.page.enabled,
        survey.metrics.enabled,
        survey.page.port == survey.metrics.port,
    )
    if all(ports):
        yield refuse(
            source, "metrics.port", message("another-port-than-page"), survey.metrics.port
        )
    if bool(survey.page.certificate) != bool(survey.page.key):
        yield refuse(
            source,
            "page.certificate",
            message("certificate-key-neither"),
            survey.page.certificate,
        )
