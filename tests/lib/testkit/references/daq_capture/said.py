"""What daq/capture says of sensors, of the machine and of its own streams, played from reference
files."""

from types import SimpleNamespace
from typing import Any

from stepdiag.base.errors import StepdiagError
from stepdiag.base.messages import message
from stepdiag.daq.capture.captured_stop import marked
from stepdiag.daq.capture.conditions import (
    Conditions,
    Credible,
    believed_before,
    condition_names,
    needed_conditions,
    with_air,
)
from stepdiag.daq.capture.log_start import start_of
from stepdiag.daq.capture.naming.walk import Path, Walk
from stepdiag.daq.capture.remarks.remarks import Alarm, Pulse, StreamRemarks, credible_of
from stepdiag.daq.capture.remarks.unchecked import places_known, unchecked
from stepdiag.daq.formats.signals import Signals
from stepdiag.daq.records.events import ModbusBlock
from stepdiag.daq.timing.samples import Notice
from testkit.references import plain
from testkit.references.daq_capture.place import route_of
from testkit.references.daq_capture.told import MS, brief, signals_of, stop_of, survey_of


def conditions(told: dict[str, Any]) -> Any:
    """Play what the sensors say, a change at a time, at stop after stop: what is believed, held,
    said and doubted."""
    survey = survey_of(told)
    credible = {name: Credible(**said) for name, said in told.get("credible", {}).items()}
    judges, found = Conditions(survey, credible), []
    for changed, time_s in told["stops"]:
        judged = judges.judge(signals_of(told["good"] | changed), time_s)
        believed = [getattr(judged.signals, name) for name in told["good"]]
        kept = [judges.credible[name] for name in told["good"] if name in judges.credible]
        words = [f"held {', '.join(judged.held)}"] * bool(judged.held) + [
            plain(each) for each in (*judged.remarks, *judged.doubted)
        ]
        found += [
            plain(
                [*believed, *(each.value for each in kept), *(each.time_s for each in kept)]
            ),
            *words,
        ]
    return {"needed": needed_conditions(survey), "stops": found}


def sensors(told: dict[str, Any]) -> Any:
    """Return what is believed of what a sensor told, and when."""
    said = {name: (value, time_ms * MS) for name, value, time_ms in told["told"]}
    sensor: Any = SimpleNamespace(
        conditions={name: value for name, (value, _) in said.items()},
        conditions_since=lambda since: {
            name: value for name, (value, time_ns) in said.items() if time_ns >= since
        },
    )
    found = []
    for each in told["surveys"]:
        survey = survey_of(each)
        found.append(condition_names(survey, sensor))
        for now_ms in told["now_ms"]:
            felt = with_air(
                survey, signals_of(told["signals"]), sensor, now_ms * MS, silent=float("nan")
            )
            before = believed_before(survey, sensor, now_ms * MS, 7_000_000_000, {})
            found.append(
                [
                    {name: value for name, value in plain(felt).items() if value is not None},
                    plain(before),
                ]
            )
    return found


def remarks(told: dict[str, Any]) -> Any:
    """Play heartbeats, alarms, and what streams say."""
    pulse, beats = Pulse(), []
    for value, send_ms, recv_ns in told["beats"]:
        said = pulse.take(
            Signals(heartbeat=value), ModbusBlock(send_ms * MS, recv_ns, (), ())
        )
        beats.append(plain([said, pulse.still, pulse.beat_ns, pulse.for_s(recv_ns)]))
    alarms: list[Any] = []
    for route, expected in told["walks"]:
        alarm, follows = (
            Alarm(told["wall_ns"]),
            Walk((route_of(route),), Path(stop=expected - 1)),
        )
        for act, *rest in told["alarms"]:
            if act == "look":
                alarms.append(
                    brief(
                        list(
                            alarm.look(
                                follows, Signals(alarm=rest[0]), rest[1] * MS, waiting=rest[2]
                            )
                        )
                    )
                )
            else:
                alarms.append(plain(alarm.doubts(stop_of({"window_to_ns": rest[0] * MS}))))
    heard: list[Notice] = []
    stream: Any = SimpleNamespace(heard=lambda: tuple(heard))
    says, lists = StreamRemarks({"laser": stream, "head": stream}), []
    for now_ms, code, text in told["notices"]:
        outcomes: list[Any] = []
        heard[:] = [Notice(code=code, index=0, why=text)]
        says.listen_now_and_then(now_ms * MS, outcomes)
        lists.append(brief(outcomes))
    for where in told["lost"]:
        outcomes = []
        says.lost("machine", where.split("; "), outcomes)
        lists.append(brief(outcomes))
    stops = [stop_of(each) for each in told["stops"]]
    again = [marked(stop, message("other-side")) for stop in stops]
    return {
        "pulse": beats,
        "alarm": alarms,
        "streams": lists,
        "credible": [plain(credible_of(stop)) for stop in stops],
        "marked": [plain(stop.doubts) for stop in again],
    }


def unsaid(told: list[dict[str, Any]]) -> Any:
    """Return what nobody can check in surveys."""
    found = []
    for each in told:
        survey = survey_of(each)
        found.append(
            [
                places_known(survey),
                brief(unchecked(survey)),
                brief(unchecked(survey, each["without"])) if "without" in each else None,
            ]
        )
    return found


def starts(told: list[Any]) -> Any:
    """Read the start records of logs."""
    found = []
    for said in told:
        try:
            found.append(plain(start_of(said, "log.mcap")))
        except StepdiagError as refusal:
            found.append(f"{type(refusal).__name__}: {plain(refusal.message)}")
    return found
