"""The stage of the work (set up, align, drive, trouble, done), and the most important sentence of
the page.

A sentence is a key of the section ``page`` of the catalogue with its values. A value that is a list
contains sentences. Stops are counted from 1. The browser shows the sentences in the language of its
user.
"""

from dataclasses import dataclass, field
from typing import Literal

from stepdiag.base.setups import setup_of
from stepdiag.daq.records.status import DriveStatus, Snapshot

Stage = Literal["set-up", "align", "drive", "trouble", "done"]
WEAK = 0.4
"""Share of the full beam strength below which dust or chips can cause the loss of a stop."""
GONE = frozenset({"silent", "lost"})


@dataclass(frozen=True, slots=True)
class Say:
    """A sentence of the page: its key in the catalogue and its values."""

    key: str
    values: dict[str, "str | int | list[Say]"] = field(default_factory=dict)


@dataclass(frozen=True, slots=True, kw_only=True)
class Headline:
    """The contents of the large card on the page. With ``alarm``, the whole page shows an alarm.

    ``watching`` replaces the advice for a viewer without the right to give commands. The field
    ``watching`` is None if the advice contains no command.
    """

    stage: Stage
    lead: Say
    advice: Say
    alarm: bool = False
    watching: Say | None = None


def headline(now: Snapshot) -> Headline:
    """Return the stage of the work and the sentence for a snapshot; an obstacle has priority over
    the next step."""
    return _trouble(now) or _quiet(now)


def is_running(now: Snapshot) -> bool:
    return now.phase in ("waiting-stop", "dwelling")


def _trouble(now: Snapshot) -> Headline | None:
    for link, state in (
        ("laser", now.laser.state),
        ("plc", now.plc.state),
        ("head", now.head.state if now.head else "connected"),
    ):
        if state in GONE:
            return _alarm(f"alarm_{link}", Say(f"do_{link}"))
    if now.alarm:
        return _alarm("alarm_machine", Say("do_machine"))
    if now.waits_in_vain:
        return _alarm("alarm_waits", Say("do_waits"))
    if now.phase == "failed":
        return _alarm("phase_failed", Say("do_failed"))
    if is_running(now):
        if now.counts_to is not None and not now.driven_out:
            return _alarm(
                "alarm_go_back" if now.beam_lost else "alarm_count",
                Say("do_go_back", {"stop": now.counts_to + 1}),
                {"stop": now.counts_to + 1},
            )
        if now.beam_lost and not now.driven_out:
            return _alarm("alarm_beam", Say("do_beam"))
        if not now.recording:
            return _alarm("not_recording", Say("do_recording"))
    again = (
        None
        if is_running(now) or now.phase in ("paused", "solving", "complete")
        else _again(now)
    )
    return None if again is None else _repeat(now, again)


def _alarm(
    key: str, advice: Say, values: "dict[str, str | int | list[Say]] | None" = None
) -> Headline:
    return Headline(stage="trouble", alarm=True, lead=Say(key, values or {}), advice=advice)


def _again(now: Snapshot) -> DriveStatus | None:
    return next((drive for drive in now.to_drive if drive.again), None)


def _repeat(now: Snapshot, drive: DriveStatus) -> Headline:
    """Return the card with the advice to repeat passes. The stage is trouble, but without an alarm,
    because the repetition is not urgent."""
    return Headline(
        stage="trouble",
        lead=_repeated(drive),
        advice=Say("do_again", {"program": [_program(now, drive.setup)]}),
    )


def _repeated(drive: DriveStatus) -> Say:
    key = "again_whole" if drive.from_stop == 0 else "again_from"
    about = _pass(drive.setup, drive.pass_number)
    return Say(key, {**about, "stop": drive.from_stop + 1})


def _pass(setup: str, number: int) -> "dict[str, str | int | list[Say]]":
    return {
        "setup": setup,
        "pass": number,
        "way": [Say("outward" if number % 2 else "return")],
    }


def _quiet(now: Snapshot) -> Headline:
    if now.phase == "complete" and now.proof is not None:
        return Headline(
            stage="done", lead=Say(f"proof_{now.proof}"), advice=Say("do_complete")
        )
    if now.phase in ("solving", "complete"):
        return Headline(
            stage="done", lead=Say(f"phase_{now.phase}"), advice=Say(f"do_{now.phase}")
        )
    if is_running(now):
        return _underway(now)
    if now.phase == "paused":
        return Headline(
            stage="set-up",
            lead=Say("phase_paused"),
            advice=Say("do_paused"),
            watching=Say("do_paused_watching"),
        )
    if now.phase == "starting":
        return Headline(stage="set-up", lead=Say("phase_starting"), advice=Say("do_starting"))
    aligned = not now.beam_lost and (now.beam is None or now.beam >= WEAK)
    watching = None if now.expects_setup else Say("do_any_watching")
    return Headline(
        stage="align" if aligned else "set-up",
        lead=_prepare(now, aligned=aligned),
        advice=_set_up(now),
        watching=watching,
    )


def _underway(now: Snapshot) -> Headline:
    """Return the card with the present pass and the further passes of its setup, which the operator
    must complete before the setup is removed."""
    owed = next(
        (drive for drive in now.to_drive if drive.again and drive.setup == now.expects_setup),
        None,
    )
    if owed is None:
        return Headline(stage="drive", lead=_driving(now), advice=_way(now))
    return Headline(
        stage="trouble",
        lead=_driving(now),
        advice=Say("do_running_owed", {"way": [_way(now)], "again": [_repeated(owed)]}),
    )


def _driving(now: Snapshot) -> Say:
    key = "phase_dwelling" if now.phase == "dwelling" else "phase_waiting_stop"
    about = _pass(now.expects_setup, now.expects_pass)
    return Say(key, {**about, "stop": now.expects_stop + 1, "last": now.stops_in_pass})


def _way(now: Snapshot) -> Say:
    values = _pass(now.expects_setup, now.expects_pass)
    if now.moving_axis:
        return Say("do_running_axis", {**values, "axis": now.moving_axis.upper()})
    return Say("do_running", values)


def _prepare(now: Snapshot, *, aligned: bool) -> Say:
    if not now.expects_setup:
        return Say("phase_waiting_any")
    if aligned:
        return Say("phase_start", {"program": [_program(now, now.expects_setup)]})
    return Say("phase_set_up", {"setup": now.expects_setup})


def _set_up(now: Snapshot) -> Say:
    setup = now.expects_setup
    if not setup:
        return Say("do_any")
    travel = setup_of(setup)
    return Say(
        f"do_{travel.kind if travel.axis else 'body'}",
        {"setup": setup, "axis": travel.axis.upper(), "program": [_program(now, setup)]},
    )


def _program(now: Snapshot, setup: str) -> Say:
    named = now.program if setup == now.expects_setup else ""
    return (
        Say("program_named", {"name": named})
        if named
        else Say("program_of", {"setup": setup})
    )
