"""From what the links brought to words: what is wrong with laser, machine and register map, and what to do about it.

An error means that no survey can be recorded as things stand; a warning that a person has to look; a note what cannot be judged yet.
"""

from collections.abc import Iterator
from typing import Literal

from stepdiag.base.conditions.air import HALL
from stepdiag.base.findings import Finding, Severity, finding
from stepdiag.base.messages import Message, Words
from stepdiag.base.names import SETUP_NUMBERS
from stepdiag.base.setups import CODED_FROM
from stepdiag.checking.check import LinkSeen, MachineSeen, Observation, StreamSeen
from stepdiag.completion.foreseen import hidden_slip, hidden_waves
from stepdiag.daq.capture.conditions import needed_conditions
from stepdiag.daq.capture.remarks.stream_findings import STREAMS
from stepdiag.daq.capture.remarks.unchecked import WITHOUT, assumed, unchecked
from stepdiag.daq.formats.recognise import refused, senseless
from stepdiag.daq.formats.signals import describe
from stepdiag.daq.survey.bundle import compensation_findings
from stepdiag.daq.survey.models import Plc
from stepdiag.daq.timing.samples import Flag

HEARTBEAT_S = 1.0
"""The heartbeat changes at least once a second (contract 2)."""
JUDGED_AFTER_S = 2.5
"""What has to change or arrive is judged only after it had the time for it."""
GARBAGE_SHARE = 0.01
RATE_SHARE = 0.05
POLL_SHARE = 0.8
PLAUSIBLE = {
    "x_mm": (-50_000.0, 50_000.0),
    "y_mm": (-50_000.0, 50_000.0),
    "z_mm": (-50_000.0, 50_000.0),
    **HALL,
}
"""What a machine in a hall can say; anything else was read from the wrong place or with the wrong type, byte order or scale."""
_FLAG_WORDS = {
    Flag.HEAD_ERROR: "its head reports an error: no light, or not warm yet",
    Flag.SLEW: "the target moves faster than it can count",
    Flag.PHASE_ERROR: "its phase measurement fails",
    Flag.SATURATED: "its detector is saturated",
    Flag.OUT_OF_RANGE: "its readings are out of range",
    Flag.DEVICE_ERROR: "it reports an error",
}


def diagnose(seen: Observation) -> tuple[Finding, ...]:
    """Return all findings, in the order compensation, plan, laser, head, sensor of air, machine."""
    found = [*compensation_findings(seen.survey), *hidden_slip(seen.survey), *hidden_waves(seen.survey)]
    found += [finding for stream in seen.streams for finding in _stream(stream, seen.seconds)]
    found += _conditions(seen) if seen.sensor.samples else ()
    silent = seen.survey.plc.silent
    found += unchecked(seen.survey) if silent else assumed(seen.survey)
    found += () if silent else _machine(seen.machine, seen.survey.plc, seen.seconds, seen.air)
    if seen.laser.samples:
        text = "which way the laser counts (laser.sign) and its fold (laser.optics) show only when the machine moves: at the first step"
        found.append(_finding("sign-untold", "info", text))
    return tuple(found)


def _stream(stream: StreamSeen, seconds: float) -> Iterator[Finding]:
    if not stream.byte_count:
        yield _absent(stream.link, seconds)
    elif not stream.samples or (stream.refused == stream.samples and stream.counts["garbage"]):
        yield _finding("bytes-garbled", "error", _senseless(stream))
    else:
        yield from _instrument(stream, seconds)
    if stream.byte_count:
        yield from _lasting(stream.link)


def _conditions(seen: Observation) -> Iterator[Finding]:
    """Yield what is wrong with what the laser or a sensor tells of air and material."""
    for name in sorted(seen.air):
        value = seen.sensor.told.get(name)
        if value is None:
            yield _missing_condition(seen, name)
        elif not HALL[name][0] < value <= HALL[name][1]:
            text = f"{name} reads {value:g}, which no hall has ({HALL[name][0]:g} to {HALL[name][1]:g}): check the sensor and its units"
            yield _finding("conditions-held", "warning", text)


def _missing_condition(seen: Observation, name: str) -> Finding:
    """Return the finding of a condition that the instrument should measure and does not: a warning where no reading depends on it."""
    if seen.survey.air_sensor is not None:
        text = f"the sensor does not tell {name}, which its pattern names: look at its display and at environment.sensor.pattern"
        return _finding("conditions-held", "error", text)
    severity: Literal["error", "warning"] = "error" if name in needed_conditions(seen.survey) else "warning"
    stated = getattr(seen.survey.environment, name)
    text = f"the laser does not tell {name}, so {stated:g} of [environment] would count: connect its sensor, or state the conditions with"
    return _finding("conditions-held", severity, f'{text} environment.source = "fixed"')


def _senseless(stream: StreamSeen) -> Message:
    """Return what a stream sends that makes no sense."""
    remark = stream.remarks.get("garbage") or stream.remarks.get("device") or ""
    return senseless(STREAMS[stream.link.name], stream.heard, stream.byte_count, remark)


def _instrument(stream: StreamSeen, seconds: float) -> Iterator[Finding]:
    """Yield the findings about an instrument that is understood."""
    name = stream.link.name
    if stream.counts["garbage"] > GARBAGE_SHARE * stream.samples:
        text = (
            f"{stream.counts['garbage']} of {stream.samples} lines of the {name} make no sense ({stream.remarks['garbage']}): bad cable, or"
        )
        yield _finding("bytes-garbled", "warning", f"{text} settings that only nearly fit")
    if stream.counts["gap"]:
        yield _finding("samples-missing", "warning", f"{name}: {stream.remarks['gap']} ({stream.counts['gap']} times)")
    if stream.counts["restart"]:
        yield _finding("instrument-restart", "warning", f"{name}: {stream.remarks['restart']}: look at its power supply")
    if stream.refused == stream.samples:
        yield _finding("instrument-reports", "error", refused(STREAMS[name], stream.remarks.get("device", "")))
        return
    if "device" in stream.remarks:
        yield _finding("instrument-reports", "info", f"the {name} says: {stream.remarks['device']}")
    yield from _light(stream)
    nominal, rate = stream.decoder.nominal_rate_hz, stream.rate_hz
    if nominal is not None and rate is not None and seconds > JUDGED_AFTER_S and abs(rate / nominal - 1) > RATE_SHARE:
        text = f"the {name} should give {nominal:.1f} samples a second and gives {rate:.1f}: a slow line, or a wrong rate in the survey"
        yield _finding(f"{name}-rate", "warning", text)


def _light(stream: StreamSeen) -> Iterator[Finding]:
    """Yield what the last sample says about the beam and the device."""
    name, flags = stream.link.name, stream.last_flags
    strength = "" if stream.beam is None else f" ({100 * stream.beam:.0f} %)"
    if flags & Flag.BEAM_LOST:
        yield _finding("beam-lost", "warning", f"{name}: no beam comes back{strength}: align the mirror, look for something in its path")
    elif flags & Flag.WEAK_BEAM:
        yield _finding("beam-weak", "warning", f"{name}: the beam is weak{strength}: align the mirror, clean the optics")
    for flag, words in _FLAG_WORDS.items():
        if flags & flag and not (flags & Flag.BEAM_LOST and flag is Flag.HEAD_ERROR):
            yield _finding("instrument-reports", "warning", f"the {name} gives no usable reading: {words}")


def _machine(machine: MachineSeen, plc: Plc, seconds: float, air: frozenset[str]) -> Iterator[Finding]:
    if machine.trouble:
        yield _finding("machine-answer", "error", machine.trouble)
    if not machine.polls:
        if not machine.trouble:
            yield _absent(machine.link, seconds)
        return
    yield from _lasting(machine.link)
    yield from _map(machine, plc, air)
    yield from _frozen(machine, plc)
    rate = machine.rate_hz
    if rate is not None and seconds > JUDGED_AFTER_S and rate < POLL_SHARE * plc.poll_hz:
        text = f"{rate:.0f} polls a second are answered instead of {plc.poll_hz:g} (slowest {1e3 * machine.slowest_s:.0f} ms)"
        yield _finding("machine-slow", "warning", f"{text}: lower plc.poll_hz, or lengthen plan.dwell_s")


def _map(machine: MachineSeen, plc: Plc, air: frozenset[str]) -> Iterator[Finding]:
    """Yield what speaks against the register map, and what an absent signal takes away; ``air`` comes from the laser itself."""
    for name in plc.signal_names:
        if getattr(machine.signals, name) is None:
            severity: Literal["error", "warning"] = "error" if name == "stopped" else "warning"
            field = f"plc.expressions.{name}" if name in plc.expressions else f"plc.signals.{name}"
            text = f"{name} at {plc.place(name)} is not served by the control ({machine.link.detail}): check {field}"
            yield _finding("signal-refused", severity, text)
    for name in machine.unanswered:
        if name in plc.inputs:
            text = f"{name} at {describe(plc.inputs[name])} is not served by the control ({machine.link.detail}): check plc.inputs.{name}"
            yield _finding("signal-refused", "error" if name in plc.standing else "warning", text)
    for name, (low, high) in PLAUSIBLE.items():
        value = getattr(machine.signals, name)
        if value is not None and not low < value <= high:
            spec = plc.signals[name]
            text = f"{name} reads {value:g} at {describe(spec)} as {spec.type} {spec.order}: check address, type, order and scale"
            yield _finding("signal-implausible", "warning", f"{text} (plc.signals.{name}), or give the machine the sensor")
    setup = machine.signals.setup
    if setup is not None and setup != 0 and setup not in SETUP_NUMBERS and setup <= CODED_FROM:
        codes = ", ".join(map(str, (*SETUP_NUMBERS, f"{CODED_FROM} + k")))
        text = f"setup reads {setup}, which is no setup (0, {codes}): the register map does not fit the control"
        yield _finding("signal-implausible", "warning", text)
    for name, lost in WITHOUT.items():
        if name not in plc.signal_names and name not in air:
            yield _finding("signal-not-mapped", "info", f"{name} is not mapped: {lost}")


def _frozen(machine: MachineSeen, plc: Plc) -> Iterator[Finding]:
    """Yield what is wrong with the heartbeat."""
    if "heartbeat" not in plc.signal_names or machine.signals.heartbeat is None or machine.heard_s < JUDGED_AFTER_S:
        return
    expected = machine.heard_s / HEARTBEAT_S
    if machine.changes["heartbeat"] == 0:
        where = f"{plc.place('heartbeat')} stays at {machine.signals.heartbeat}"
        text = f"the heartbeat does not change ({where} for {machine.heard_s:.0f} s)"
        yield _finding("heartbeat-still", "error", f"{text}: the PLC's program does not run, or it is another register")
    elif machine.changes["heartbeat"] < expected / 2:
        text = f"the heartbeat changed {machine.changes['heartbeat']} times in {machine.heard_s:.0f} s, it should at least once a second"
        yield _finding("heartbeat-slow", "warning", text)


def _absent(link: LinkSeen, seconds: float) -> Finding:
    """Return the finding for a link that never gave anything, open or not."""
    if link.state == "connected":
        text = f"{link.detail or link.address}: open, and nothing came in {seconds:g} s: power, cable, rate, or another instrument"
        return _finding(f"{link.name}-silent", "error", text)
    kind = "silent" if link.was_silent else "unreachable"
    return _finding(f"{link.name}-{kind}", "error", link.detail or f"{link.address}: no connection came about")


def _lasting(link: LinkSeen) -> Iterator[Finding]:
    """Yield what is wrong with a link that was there."""
    if link.state in ("lost", "silent"):
        yield _finding(f"{link.name}-silent", "error", f"it was there and is no more: {link.detail}")
    elif link.losses:
        yield _finding(f"{link.name}-unsteady", "warning", f"{link.address}: the link was lost {link.losses} times: cable, plug, supply")


def _finding(code: str, severity: Severity, said: Words) -> Finding:
    """Return a finding of a message, or of a text that is not one yet."""
    if isinstance(said, Message):
        return finding(severity, said, code=code)
    return Finding(code=code, severity=severity, text=said)
