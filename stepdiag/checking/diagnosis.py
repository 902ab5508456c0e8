"""Faults of laser, machine and register map, and their remedies, found in the data of the links.

An error means that no survey can be recorded. A warning means that the operator has to inspect
something. A note means that a check is not possible yet.
"""

from collections.abc import Iterator

from stepdiag.base.conditions.air import HALL
from stepdiag.base.findings import Finding, error, finding, info, warning
from stepdiag.base.messages import Message, message
from stepdiag.base.names import SETUP_NUMBERS
from stepdiag.base.setups import CODED_FROM
from stepdiag.checking.check import LinkSeen, MachineSeen, Observation, StreamSeen
from stepdiag.completion.foreseen import hidden_slip, hidden_waves
from stepdiag.daq.capture.conditions import needed_conditions
from stepdiag.daq.capture.remarks.remarks import STREAMS
from stepdiag.daq.capture.remarks.unchecked import WITHOUT, assumed, unchecked
from stepdiag.daq.formats.recognise import refused, senseless
from stepdiag.daq.formats.signals import describe
from stepdiag.daq.survey.bundle import compensation_findings
from stepdiag.daq.survey.models import Plc
from stepdiag.daq.timing.samples import Flag

HEARTBEAT_S = 1.0
"""Longest time in s between two changes of the heartbeat (contract 2)."""
JUDGED_AFTER_S = 2.5
"""Shortest time of observation in s: after less time, rates and the heartbeat are not judged."""
GARBAGE_SHARE = 0.01
"""Share of undecodable lines above which these lines are reported. Correct wiring also gives an
occasional disturbed line."""
RATE_SHARE = 0.05
"""Relative deviation from the nominal sample rate above which the rate is reported: the clocks of
instruments are more accurate."""
POLL_SHARE = 0.8
"""Share of answered polls below which the loss is reported: even a busy computer gets more
answers."""
PLAUSIBLE = {
    "x_mm": (-50_000.0, 50_000.0),
    "y_mm": (-50_000.0, 50_000.0),
    "z_mm": (-50_000.0, 50_000.0),
    **HALL,
}
"""Range of the possible values of each signal of a machine in a workshop. A value outside its range
comes from the wrong register, or was read with the wrong type, byte order or scale."""
_FLAG_WORDS = {
    Flag.HEAD_ERROR: message("check-head-error"),
    Flag.SLEW: message("check-slew"),
    Flag.PHASE_ERROR: message("check-phase-error"),
    Flag.SATURATED: message("check-saturated"),
    Flag.OUT_OF_RANGE: message("check-out-of-range"),
    Flag.DEVICE_ERROR: message("reports-error"),
}


def diagnose(seen: Observation) -> tuple[Finding, ...]:
    """Return all findings about the links in the order compensation, plan, laser, head, air sensor,
    machine."""
    found = [
        *compensation_findings(seen.survey),
        *hidden_slip(seen.survey),
        *hidden_waves(seen.survey),
    ]
    found += [finding for stream in seen.streams for finding in _stream(stream, seen.seconds)]
    found += _conditions(seen) if seen.sensor.samples else ()
    silent = seen.survey.plc.silent
    found += unchecked(seen.survey) if silent else assumed(seen.survey)
    found += () if silent else _machine(seen.machine, seen.survey.plc, seen.seconds, seen.air)
    if seen.laser.samples:
        found.append(info("wrong-laser-sign.unseen"))
    return tuple(found)


def _stream(stream: StreamSeen, seconds: float) -> Iterator[Finding]:
    if not stream.byte_count:
        yield _absent(stream.link, seconds)
    elif not stream.samples or (
        stream.refused == stream.samples and stream.counts["garbage"]
    ):
        yield finding("error", _senseless(stream), code="bytes-garbled")
    else:
        yield from _instrument(stream, seconds)
    if stream.byte_count:
        yield from _lasting(stream.link)


def _conditions(seen: Observation) -> Iterator[Finding]:
    for name in sorted(seen.air):
        value = seen.sensor.conditions.get(name)
        if value is None:
            yield _missing_condition(seen, name)
        elif not HALL[name][0] < value <= HALL[name][1]:
            low, high = HALL[name]
            yield warning(
                "conditions-held.no-hall", name=name, value=value, low=low, high=high
            )


def _missing_condition(seen: Observation, name: str) -> Finding:
    if seen.survey.air_sensor is not None:
        return error("conditions-held.sensor-silent", name=name)
    stated = getattr(seen.survey.environment, name)
    words = message("conditions-held.laser-silent", name=name, value=stated)
    return finding("error" if name in needed_conditions(seen.survey) else "warning", words)


def _senseless(stream: StreamSeen) -> Message:
    remark = stream.remarks.get("garbage") or stream.remarks.get("device") or ""
    return senseless(STREAMS[stream.link.name], stream.heard, stream.byte_count, remark)


def _instrument(stream: StreamSeen, seconds: float) -> Iterator[Finding]:
    name, counts = STREAMS[stream.link.name], stream.counts
    if counts["garbage"] > GARBAGE_SHARE * stream.samples:
        why = stream.remarks["garbage"]
        yield warning(
            "bytes-garbled.some",
            count=counts["garbage"],
            of=stream.samples,
            stream=name,
            why=why,
        )
    if counts["gap"]:
        yield warning(
            "samples-missing.times",
            stream=name,
            why=stream.remarks["gap"],
            count=counts["gap"],
        )
    if counts["restart"]:
        yield warning("instrument-restart.supply", stream=name, why=stream.remarks["restart"])
    if stream.refused == stream.samples:
        yield finding(
            "error",
            refused(name, stream.remarks.get("device", "")),
            code="instrument-reports",
        )
        return
    if "device" in stream.remarks:
        yield finding(
            "info",
            message("of-stream", stream=name, what=stream.remarks["device"]),
            code="instrument-reports",
        )
    yield from _light(stream)
    nominal, rate = stream.decoder.nominal_rate_hz, stream.rate_hz
    if (
        nominal is not None
        and rate is not None
        and seconds > JUDGED_AFTER_S
        and abs(rate / nominal - 1) > RATE_SHARE
    ):
        words = message("samples-missing.rate", stream=name, nominal_hz=nominal, rate_hz=rate)
        yield finding("warning", words)


def _light(stream: StreamSeen) -> Iterator[Finding]:
    name, flags = STREAMS[stream.link.name], stream.last_flags
    strength = "" if stream.beam is None else f" ({100 * stream.beam:.0f} %)"
    if flags & Flag.BEAM_LOST:
        yield warning("beam-lost.standing", stream=name, strength=strength)
    elif flags & Flag.WEAK_BEAM:
        yield warning("instrument-reports.weak-beam", stream=name, strength=strength)
    for flag, why in _FLAG_WORDS.items():
        if flags & flag and not (flags & Flag.BEAM_LOST and flag is Flag.HEAD_ERROR):
            yield warning("instrument-reports.unusable", stream=name, why=why)


def _machine(
    machine: MachineSeen, plc: Plc, seconds: float, air: frozenset[str]
) -> Iterator[Finding]:
    if machine.trouble:
        yield finding("error", machine.trouble, code="bytes-garbled")
    if not machine.polls:
        if not machine.trouble:
            yield _absent(machine.link, seconds)
        return
    yield from _lasting(machine.link)
    yield from _map(machine, plc, air)
    yield from _frozen(machine, plc)
    rate = machine.rate_hz
    if rate is not None and seconds > JUDGED_AFTER_S and rate < POLL_SHARE * plc.poll_hz:
        words = message(
            "samples-missing.polls",
            rate_hz=rate,
            poll_hz=plc.poll_hz,
            slowest_ms=1e3 * machine.slowest_s,
        )
        yield finding("warning", words)


def _map(machine: MachineSeen, plc: Plc, air: frozenset[str]) -> Iterator[Finding]:
    """Yield the contradictions of the register map, and the checks that are impossible without the
    absent signals. The signals in ``air`` come from the laser or a sensor, so the register map does
    not need these signals.
    """
    why = machine.link.detail
    for name in plc.signal_names:
        if getattr(machine.signals, name) is None:
            field = (
                f"plc.expressions.{name}"
                if name in plc.expressions
                else f"plc.signals.{name}"
            )
            words = message(
                "signals-absent.refused",
                name=name,
                place=plc.place(name),
                why=why,
                field=field,
            )
            yield finding("error" if name == "stopped" else "warning", words)
    for name in machine.unanswered:
        if name in plc.inputs:
            words = message(
                "signals-absent.refused",
                name=name,
                place=describe(plc.inputs[name]),
                why=why,
                field=f"plc.inputs.{name}",
            )
            yield finding("error" if name in plc.standing else "warning", words)
    for name, (low, high) in PLAUSIBLE.items():
        value = getattr(machine.signals, name)
        if value is not None and not low < value <= high:
            spec = plc.signals[name]
            words = message(
                "signals-absent.implausible",
                name=name,
                value=value,
                place=describe(spec),
                type=spec.type,
                order=spec.order,
            )
            yield finding("warning", words)
    setup = machine.signals.setup
    if (
        setup is not None
        and setup != 0
        and setup not in SETUP_NUMBERS
        and setup <= CODED_FROM
    ):
        known = [*map(str, SETUP_NUMBERS), f"{CODED_FROM} + k"]
        yield warning("signals-absent.setup-number", setup=setup, known=known)
    for name, lost in WITHOUT.items():
        if name not in plc.signal_names and name not in air:
            yield finding("info", lost, code="signals-absent")


def _frozen(machine: MachineSeen, plc: Plc) -> Iterator[Finding]:
    if (
        "heartbeat" not in plc.signal_names
        or machine.signals.heartbeat is None
        or machine.heard_s < JUDGED_AFTER_S
    ):
        return
    changes, heard_s = machine.changes["heartbeat"], machine.heard_s
    if changes == 0:
        where, value = plc.place("heartbeat"), machine.signals.heartbeat
        yield error("heartbeat-still.register", place=where, value=value, heard_s=heard_s)
    elif changes < heard_s / HEARTBEAT_S / 2:
        yield warning("heartbeat-still.slow", count=changes, heard_s=heard_s)


def _absent(link: LinkSeen, seconds: float) -> Finding:
    """Return the finding for a link that never delivered data, with or without a connection."""
    if link.state == "connected":
        words = message(
            "check-nothing-came", link=link.detail or link.address, seconds_s=seconds
        )
        return finding("error", words, code=f"{link.name}-silent")
    kind = "silent" if link.was_silent else "unreachable"
    unreached = (
        message("check-as-is", what=link.detail)
        if link.detail
        else message("check-no-connection", link=link.address)
    )
    return finding("error", unreached, code=f"{link.name}-{kind}")


def _lasting(link: LinkSeen) -> Iterator[Finding]:
    if link.state in ("lost", "silent"):
        yield finding(
            "error", message("check-gone", why=link.detail), code=f"{link.name}-silent"
        )
    elif link.losses:
        yield finding(
            "warning",
            message("check-unsteady", link=link.address, count=link.losses),
            code=f"{link.name}-unsteady",
        )
