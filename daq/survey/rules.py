"""What a survey file must fulfil beyond the limits of its single fields."""

import re
from collections.abc import Collection, Iterator

from stepdiag.base.errors import UsageError
from stepdiag.base.messages import message
from stepdiag.base.names import AXES, BODY_DIAGONALS, FOURDOF_RUNS, LINEAR_RUNS
from stepdiag.base.settings import refuse, unknown_key
from stepdiag.base.setups import setup_of
from stepdiag.base.volume import reads_like_metres
from stepdiag.daq.formats.instruments.line import line_pattern
from stepdiag.daq.formats.signals import COUNTED, SIGNAL_NAMES, SWITCHED, SignalMap, SignalSpec, describe, plan_reads, registers
from stepdiag.daq.links.ports.address import can_be_host, network_line
from stepdiag.daq.survey.formats import air_settings, laser_settings
from stepdiag.daq.survey.models import Head, LineSection, Plc, Survey

_SETUP_NAMES = (*BODY_DIAGONALS, *LINEAR_RUNS, *FOURDOF_RUNS)
_INPUT_NAME = re.compile(r"[A-Za-z]\w{0,31}\Z", re.ASCII)
_LINE_GROUPS = ("position", "counter", "beam")
_MAX_POLL_HZ = 1000.0
_S7_PDU = 240
_MODBUS = (re.compile(r"coil\Z|discrete\Z|holding\Z|input\Z"), '"coil", "discrete", "holding" or "input" over Modbus')
_TABLES = {
    "tcp": _MODBUS,
    "rtu": _MODBUS,
    "s7": (re.compile(r"db\d+\Z"), 'a data block, such as "db4900", over S7'),
    "lsv2": (re.compile(r"[BMIO]\Z"), '"B" (bytes, words and double words), "M", "I" or "O" over LSV2'),
}
_ORDERS = {"s7": "ABCD", "lsv2": "DCBA"}
_MAPS = {"s7": "the words of the program and the axes' exact stop", "lsv2": "the numbers of FN 19 and the axes in position"}
LONGEST_PATH, LONGEST_NAME = 2000, 255
"""Of a folder, in bytes: what file systems and the kernel take (PATH_MAX 4096, NAME_MAX 255), with room for what is put below."""
MOST_SHOWN = 100
_TELL_AIR = ("ids3010", "lasertex")
"""Formats of lasers whose own sensors of air and material are read."""
_BITS_PER_CHARACTER = 11
"""Start, eight data, parity or a second stop bit, stop (Modbus over serial line V1.02, 2.5.1)."""


def check(survey: Survey, source: str) -> None:
    """Raise UsageError for the first contradiction in the file, in the order of its sections."""
    for rule in (_named_well, _volume, _plan, _machine, _laser, _head, _air, _plc, _dwell, _page):
        for refusal in rule(survey, source):
            raise refusal


def _volume(survey: Survey, source: str) -> Iterator[UsageError]:
    if reads_like_metres(survey.box.size_mm):
        yield refuse(source, "volume.size_mm", "lengths in mm", list(survey.box.size_mm), "this reads like metres: times 1000")


def _plan(survey: Survey, source: str) -> Iterator[UsageError]:
    setups = survey.plan.setups
    if not setups:
        yield refuse(source, "plan.setups", "at least one setup", [])
    for index, setup in enumerate(setups):
        field = f"plan.setups[{index}]"
        if setup not in _SETUP_NAMES:
            yield unknown_key(source, field, setup, list(_SETUP_NAMES))
        if setup in setups[:index]:
            yield refuse(source, field, "every setup once", setup, "use plan.repeats to drive every setup more than once")
        if setup in FOURDOF_RUNS and survey.head is None:
            yield refuse(source, field, "a [head] section for a 4-DOF run", setup)
        if setup in FOURDOF_RUNS and survey.head is not None and survey.head.angular:
            yield from _turns(survey.head, setup, source)
        elif setup in FOURDOF_RUNS and survey.head is not None and not (survey.head.id and survey.head.calibration):
            remedy = "`stepdiag fourdof calibrate` writes the calibration file of a head"
            yield refuse(source, "head.calibration", "the head's id and calibration file, for a 4-DOF run", survey.head.calibration, remedy)
    for index, offset in enumerate(survey.plan.beam_offset):
        if not any(offset.offset_mm):
            field = f"plan.beam_offset[{index}].offset_mm"
            yield refuse(source, field, "a beam that is shifted", list(offset.offset_mm), "name the setup in plan.setups instead")


def _turns(head: Head, setup: str, source: str) -> Iterator[UsageError]:
    """Judge which rotations an autocollimator or a level tells in a run."""
    axis = setup_of(setup).axis
    own = "ABC"[AXES.index(axis)]
    turns = head.angles.turns(axis)
    field, letters = f"head.angles.{axis}", [turn[1] for turn in turns]
    if not turns or len(turns) > 2 or len(set(letters)) != len(letters):
        remedy = 'such as ["+C", "+B"]: the first reading is the rotation about Z, the second that about Y'
        yield refuse(source, field, f"the rotation that each reading tells in {setup}, with its sign", list(turns), remedy)
    if head.format == "elcomat" and own in letters:
        yield refuse(source, field, f"no {own}: an autocollimator does not see the roll about its own beam", list(turns))


def _named_well(survey: Survey, source: str) -> Iterator[UsageError]:
    """Judge what would end the daemon later, with an error of Python's own: names of hosts and folders that no system takes."""
    for field, host in (("plc.host", survey.plc.host), ("page.host", survey.page.host), ("metrics.host", survey.metrics.host)):
        if not can_be_host(host):
            yield refuse(source, field, "a name or an address, 1 to 63 letters between two dots", host[:MOST_SHOWN])
    directory = survey.identity.directory
    if (
        "\0" in directory
        or len(directory.encode()) > LONGEST_PATH
        or any(len(part.encode()) > LONGEST_NAME for part in directory.split("/"))
    ):
        expected = f"a path of at most {LONGEST_PATH} bytes whose folders have names of at most {LONGEST_NAME}"
        yield refuse(source, "survey.directory", expected, directory[:MOST_SHOWN])


def _machine(survey: Survey, source: str) -> Iterator[UsageError]:
    letters = survey.machine.chain.upper().replace("F", "", 1)
    if "F" not in survey.machine.chain.upper() or sorted(letters.lower()) != sorted(AXES):
        yield refuse(source, "machine.chain", "F, X, Y and Z once each, from workpiece to tool, such as FXYZ", survey.machine.chain)
    machine = survey.machine
    if machine.compensation == "on":
        remedy = "back the active tables up from the control, or measure with the compensation off"
        if not machine.active:
            yield refuse(source, "machine.active", 'the files that are active, for compensation = "on"', [], remedy)
        if machine.active_date is None:
            yield refuse(source, "machine.active_date", "the day on which the active files were read out, such as 2026-01-31", None)
        if not machine.active_source.strip():
            yield refuse(source, "machine.active_source", "how the active files were read out of the control", machine.active_source)
    elif machine.compensation == "off" and machine.active:
        yield refuse(source, "machine.active", 'no file for compensation = "off"', list(machine.active))


def _laser(survey: Survey, source: str) -> Iterator[UsageError]:
    laser = survey.laser
    if laser.format == "frames" and laser.frames is None:
        yield refuse(source, "laser.frames", 'a table for format = "frames"', None, "add [laser.frames] with the layout of a frame")
    elif laser.format == "line" and laser.line is None:
        yield refuse(source, "laser.line", 'a table for format = "line"', None, "add [laser.line] with the pattern of a line")
    elif laser.format == "line" and laser.line is not None:
        yield from _line(laser.line, source)
    else:
        yield from _settings(survey, source)


def _settings(survey: Survey, source: str) -> Iterator[UsageError]:
    """Yield what the settings of the format itself refuse, in the name of the file."""
    try:
        laser_settings(survey.laser)
    except UsageError as refusal:
        yield _in_the_name_of(source, refusal)


def _in_the_name_of(source: str, refusal: UsageError) -> UsageError:
    where = str(refusal.where).replace("survey:", f"{source}:", 1)
    return UsageError(where, expected=refusal.expected, found=refusal.found, remedy=refusal.remedy)


def _line(line: LineSection, source: str) -> Iterator[UsageError]:
    try:
        groups = line_pattern(line.pattern, f"{source}: laser.line.pattern").groupindex
    except UsageError as refusal:
        yield refusal
        return
    if "position" not in groups:
        yield refuse(source, "laser.line.pattern", "a named group (?P<position>...)", line.pattern)
    for group in groups:
        if group not in _LINE_GROUPS:
            yield unknown_key(source, "laser.line.pattern", group, list(_LINE_GROUPS))
    if line.counter_modulus == 1:
        yield refuse(source, "laser.line.counter_modulus", "0 (it never repeats) or 2 and more", 1)
    if line.scale == 0:
        yield refuse(source, "laser.line.scale", "a number other than 0", line.scale)


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
            yield refuse(source, field, f"another port than {other}", port)
    for axis, run in zip(AXES, (survey.head.x, survey.head.y, survey.head.z) if survey.head is not None else (), strict=False):
        if run.beam[1] != axis:
            yield refuse(source, f"head.{axis}.beam", f"+{axis} or -{axis}", run.beam)
        if {run.beam[1], run.detector_x[1], run.detector_y[1]} != set(AXES):
            found = [run.beam, run.detector_x, run.detector_y]
            yield refuse(source, f"head.{axis}", "beam, detector_x and detector_y along three different axes", found)


def _air(survey: Survey, source: str) -> Iterator[UsageError]:
    sensor, source_of_air = survey.air_sensor, survey.environment.source
    if source_of_air == "sensor" and sensor is None:
        remedy = "add [environment.sensor] with its port and what its lines look like"
        yield refuse(source, "environment.sensor", 'a table for source = "sensor"', None, remedy)
    if survey.environment.sensor is not None and source_of_air not in ("sensor", "fixed"):
        remedy = "nobody would listen to the sensor; take its table out where the air comes from elsewhere"
        yield refuse(source, "environment.source", '"sensor" or "fixed" beside [environment.sensor]', source_of_air, remedy)
    if source_of_air == "laser" and survey.laser.format not in _TELL_AIR:
        remedy = "nobody would tell air and material, and the values of [environment] would count without a word"
        yield refuse(source, "environment.source", f'"laser" with format = {" or ".join(_TELL_AIR)} alone', survey.laser.format, remedy)
    if sensor is None:
        return
    if sensor.format == "ptu300" and not sensor.pattern and (sensor.temperature_unit, sensor.pressure_unit) != ("C", "hPa"):
        found = f"{sensor.temperature_unit} and {sensor.pressure_unit}"
        remedy = "its lines name them; one that is set to other units needs a pattern of its own"
        yield refuse(source, "environment.sensor", 'the units "C" and "hPa" for format = "ptu300"', found, remedy)
    if sensor.format == "line" and not sensor.pattern:
        yield refuse(source, "environment.sensor.pattern", 'the pattern of a line for format = "line"', sensor.pattern)
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
        remedy = "set the line up at the terminal server and name it socket://"
        yield refuse(source, field, "a serial port or socket://host:port", port, remedy)


def _plc(survey: Survey, source: str) -> Iterator[UsageError]:
    plc = survey.plc
    if plc.silent:
        yield from _silent(survey, source)
        return
    if plc.transport in _MAPS and not plc.signals:
        yield refuse(source, "plc.signals", _MAPS[plc.transport], [], "`stepdiag setup` writes them; docs/controls.md shows them")
        return
    yield from _asked(plc, source)
    if wrong := [*_places(plc, source), *_expressions(plc, source)]:
        yield from wrong
        return
    if "stopped" not in plc.signal_names:
        remedy = "every other signal may be absent; it may be made of others in [plc.expressions]"
        yield refuse(source, "plc.signals", "at least the signal stopped", list(plc.signal_names), remedy)
    yield from _overlaps({name: spec for name, spec in plc.signals.items() if name not in plc.inputs}, source)
    yield from _handshake(plc, source)
    if plc.transport == "rtu":
        yield from _line_time(plc, source)
    if plc.transport == "s7":
        yield from _one_telegram(plc, source)


def _asked(plc: Plc, source: str) -> Iterator[UsageError]:
    if plc.transport == "rtu" and not plc.serial_port:
        yield refuse(source, "plc.serial_port", 'a serial port for transport = "rtu"', "", "such as /dev/ttyUSB1")
    if plc.poll_hz > _MAX_POLL_HZ:
        yield refuse(source, "plc.poll_hz", message("at-most", value=_MAX_POLL_HZ), plc.poll_hz)


def _places(plc: Plc, source: str) -> Iterator[UsageError]:
    for name, spec in plc.own_signals.items():
        yield from _signal(name, spec, source)
    for field, specs in (("signals", plc.own_signals), ("inputs", plc.inputs)):
        for name, spec in specs.items():
            yield from _reachable(f"plc.{field}.{name}", spec, plc, source)


def _silent(survey: Survey, source: str) -> Iterator[UsageError]:
    """Yield what a machine without signals cannot give."""
    plc, none = survey.plc, 'nothing with transport = "none"'
    for field, entries in (("signals", plc.own_signals), ("inputs", plc.inputs), ("expressions", plc.expressions)):
        if entries:
            yield refuse(source, f"plc.{field}", none, list(entries))
    if plc.handshake.enabled:
        yield refuse(source, "plc.handshake.enabled", f"false, {none}", True)
    if survey.environment.source == "plc":
        remedy = 'or "laser", where its own sensors tell, or "sensor"'
        yield refuse(source, "environment.source", '"fixed" with transport = "none": nobody tells air and material', "plc", remedy)
    for index, setup in enumerate(survey.plan.setups):
        if setup in FOURDOF_RUNS:
            yield refuse(source, f"plan.setups[{index}]", 'no 4-DOF run with transport = "none": the head sees no travel', setup)


def _expressions(plc: Plc, source: str) -> Iterator[UsageError]:
    for name, spec in plc.inputs.items():
        if not _INPUT_NAME.match(name):
            yield refuse(source, f"plc.inputs.{name}", "a name of letters, digits and underscore, a letter first, at most 32", name)
        if name in SIGNAL_NAMES:
            yield refuse(source, f"plc.inputs.{name}", "a name that is no signal's", name, "signals stand in [plc.signals]")
        yield from _place(f"plc.inputs.{name}", spec, source)
    for name, text in plc.expressions.items():
        field, wanted = f"plc.expressions.{name}", "bit" if name in SWITCHED else "word"
        if name not in (*SWITCHED, *COUNTED):
            yield unknown_key(source, field, name, [*SWITCHED, *COUNTED])
        if name in plc.own_signals:
            yield refuse(source, field, f"either an expression or [plc.signals.{name}]", "both")
        try:
            found = plc.expression(name, source)
        except UsageError as error:
            yield error
            continue
        if found.kind != wanted:
            yield refuse(source, field, "yes or no (a comparison)" if wanted == "bit" else "a number", text)


def _signal(name: str, spec: SignalSpec, source: str) -> Iterator[UsageError]:
    field = f"plc.signals.{name}"
    if name not in SIGNAL_NAMES:
        yield unknown_key(source, field, name, list(SIGNAL_NAMES))
    yield from _place(field, spec, source)
    if spec.type == "bit" and name not in (*SWITCHED, "heartbeat"):
        yield refuse(source, f"{field}.type", "a number", spec.type, f"only {', '.join(SWITCHED)} and heartbeat may be bits")
    if name in SWITCHED and spec.type != "bit" and (spec.scale != 1 or spec.offset != 0):
        yield refuse(source, f"{field}.scale", "1 and offset 0: the signal is yes or no", spec.scale)


def _place(field: str, spec: SignalSpec, source: str) -> Iterator[UsageError]:
    """Judge where a signal or an input lies and how it is read."""
    if spec.in_bit_table and spec.type != "bit":
        yield refuse(source, f"{field}.type", f'"bit" in table {spec.table}', spec.type)
    if spec.in_bit_table and spec.bit:
        yield refuse(source, f"{field}.bit", f"0 in table {spec.table}, where an address is one bit", spec.bit)
    if spec.scale == 0:
        yield refuse(source, f"{field}.scale", "a number other than 0", spec.scale)
    if spec.type == "bit" and (spec.scale != 1 or spec.offset != 0):
        yield refuse(source, f"{field}.scale", "1 and offset 0: the signal is yes or no", spec.scale)
    if spec.address + spec.width > 65536:
        yield refuse(source, f"{field}.address", "at most 65534 for a number of two registers", spec.address)


def _reachable(field: str, spec: SignalSpec, plc: Plc, source: str) -> Iterator[UsageError]:
    """Judge whether the control's protocol reaches a table, and whether the number is read as that control keeps it."""
    wanted, words = _TABLES[plc.transport]
    if not wanted.match(spec.table):
        yield refuse(source, f"{field}.table", words, spec.table)
    elif spec.in_byte_table and spec.bit > 7:
        yield refuse(source, f"{field}.bit", f"0 to 7 in {spec.table}, where an address is a byte", spec.bit)
    elif spec.in_byte_table and spec.type != "bit" and spec.order != _ORDERS[plc.transport]:
        yield refuse(source, f"{field}.order", f'"{_ORDERS[plc.transport]}", as this control keeps its numbers', spec.order)


def _one_telegram(plc: Plc, source: str) -> Iterator[UsageError]:
    """What tells of one moment has to be asked for at once: as much as the smallest telegram of an S7 holds (PDU of 240 bytes)."""
    ranges = plan_reads(plc.signals, ())
    asked, answered = 14 + 12 * len(ranges), 14 + sum(5 + each.byte_count for each in ranges)
    if max(asked, answered) > _S7_PDU:
        found = f"{len(ranges)} ranges of {sum(each.byte_count for each in ranges)} bytes"
        yield refuse(
            source, "plc.signals", f"what one telegram of {_S7_PDU} bytes can ask for and answer", found, "lay them closer together"
        )


def _overlaps(signals: SignalMap, source: str) -> Iterator[UsageError]:
    """Two signals may share a register only as different bits of it."""
    names = list(signals)
    for index, name in enumerate(names):
        for other in names[:index]:
            one, two = signals[name], signals[other]
            different_bits = one.type == two.type == "bit" and not one.in_bit_table and one.bit != two.bit
            if registers([one]) & registers([two]) and not different_bits:
                place = f"{describe(one)}, where {other} is ({describe(two)})"
                yield UsageError(f"{source}: plc.signals.{name}.address", expected="a place of its own", found=place)


def _handshake(plc: Plc, source: str) -> Iterator[UsageError]:
    if not plc.handshake.enabled:
        return
    if plc.transport == "lsv2":
        yield refuse(source, "plc.handshake.enabled", "false: nothing is written over LSV2", True)
    wanted = "holding" if plc.transport != "s7" else plc.handshake.table
    if plc.handshake.table != wanted or not _TABLES[plc.transport][0].match(wanted):
        yield refuse(
            source, "plc.handshake.table", _TABLES[plc.transport][1] if plc.transport == "s7" else '"holding"', plc.handshake.table
        )
    if "stop_count" not in plc.signal_names:
        yield refuse(source, "plc.handshake.enabled", "the signal stop_count, which is what is written back", True)
    for name, spec in plc.signals.items():
        written = {(plc.handshake.table, plc.handshake.address + at) for at in range(2 if plc.transport == "s7" else 1)}
        if written & registers([spec]):
            yield refuse(source, "plc.handshake.address", f"a register that is not read: {name} is there", plc.handshake.address)


def rtu_poll_s(signals: SignalMap, baud: int, standing: Collection[str] = ("stopped",)) -> float:
    """Return the time one poll takes on the wire in seconds, device's own time not counted (instruments.md 4.2).

    A request is 8 characters, an answer 5 and its data; 3.5 characters of silence before each.
    """
    characters = sum(8 + 5 + asked.byte_count + 2 * 3.5 for asked in plan_reads(signals, standing))
    return characters * _BITS_PER_CHARACTER / baud


def _line_time(plc: Plc, source: str) -> Iterator[UsageError]:
    wire_s = rtu_poll_s(plc.signals, plc.baud, plc.standing)
    if plc.poll_hz * wire_s > 1:
        limit = int(1 / wire_s)
        yield refuse(source, "plc.poll_hz", f"at most {limit} at {plc.baud} baud: one poll takes {wire_s * 1e3:.1f} ms", plc.poll_hz)
    if plc.timeout_s < wire_s:
        yield refuse(source, "plc.timeout_s", f"more than the {wire_s * 1e3:.1f} ms that one poll takes", plc.timeout_s)


def _dwell(survey: Survey, source: str) -> Iterator[UsageError]:
    """A stop is certain only between the first and the last poll that saw it: dwell > settle + window + 2 polls (instruments.md 4.2)."""
    poll_s = 1.0 / survey.plc.poll_hz
    needed = survey.stop.settle_s + survey.stop.min_window_s + 2.0 * poll_s
    if survey.plan.dwell_s < needed:
        parts = f"settle {survey.stop.settle_s:g} + window {survey.stop.min_window_s:g} + two polls of {poll_s:.3g}"
        yield refuse(source, "plan.dwell_s", f"at least {needed:.3g} s ({parts})", survey.plan.dwell_s)


def _page(survey: Survey, source: str) -> Iterator[UsageError]:
    ports = (survey.page.enabled, survey.metrics.enabled, survey.page.port == survey.metrics.port)
    if all(ports):
        yield refuse(source, "metrics.port", "another port than page.port", survey.metrics.port)
    if bool(survey.page.certificate) != bool(survey.page.key):
        yield refuse(source, "page.certificate", "certificate and key, or neither", survey.page.certificate)
