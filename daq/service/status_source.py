"""The daemon's side of the page's interface: the state of the daemon, and the operator's
commands.
"""

import asyncio
import time
from collections.abc import Awaitable, Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import msgspec
import structlog

from stepdiag.base.errors import UsageError
from stepdiag.base.findings import finding
from stepdiag.base.messages import Message, Words, excerpt, joined, message, where
from stepdiag.daq.log.recorder import Recorder
from stepdiag.daq.recording.session import Session
from stepdiag.daq.recording.survey_links import SurveyLinks
from stepdiag.daq.recording.verdicts import accept, doubts_at
from stepdiag.daq.records.status import CommandName, Phase, Snapshot
from stepdiag.daq.service.child_jobs import Finisher
from stepdiag.daq.service.live import LiveStatus
from stepdiag.daq.service.metrics import Figures, Tally, disk_free_bytes
from stepdiag.daq.service.snapshot import expected_stop, snapshot
from stepdiag.daq.service.supervision import Supervisor
from stepdiag.daq.timing.host_clock import now_ns

_ARGUMENTS = ("setup", "operator", "workpiece", "place", "reason", "name")
LONGEST_NAME = 200
"""Largest number of characters of an argument of a command, so that a name or reason fits into one
line of page and log.
"""
_log = structlog.get_logger("daemon")


async def _nothing_to_correct(_name: str) -> None:
    raise UsageError(
        message("where-correct"),
        expected=message("expects-changed-file"),
        found=message("none"),
    )


@dataclass(slots=True, kw_only=True)
class Working:
    """The parts of the running daemon. The session ``session`` records the running survey. The page
    shows the survey of the session ``shown``: the finished survey, until the next survey begins.
    """

    session: Session
    shown: Session
    recorder: Recorder
    survey_links: SurveyLinks
    finisher: Finisher
    supervisor: Supervisor
    tally: Tally
    programs: Mapping[str, str] = field(default_factory=dict)
    alarms: Callable[[], Sequence[Words]] = tuple
    """Returns the messages of the urgent alarms."""
    corrects: tuple[str, ...] = ()
    """The changed lines of the survey file since the daemon read the file, if the driven passes
    remain valid.
    """
    correct: Callable[[str], Awaitable[None]] = _nothing_to_correct
    """Reads the logs again with the changed file. The argument is the name of the person who
    requests this. Raises UsageError if the logs cannot be read again now.
    """
    waits_in_vain: Callable[[], bool] = bool
    """Returns whether the machine waits too long for the handshake."""
    paused: bool = False


class DaemonStatusSource:
    """Answers the requests of the page and executes the operator's commands. ``news`` is called,
    also by the daemon, after every change that cannot wait for the next tick.
    """

    def __init__(self) -> None:
        self._working: Working | None = None
        self._changed = asyncio.Condition()
        self._sequence = self._published = 0

    def open(self, working: Working) -> None:
        self._working = working

    def news(self) -> None:
        self._sequence += 1

    @property
    def has_news(self) -> bool:
        return self._sequence != self._published

    async def publish(self) -> None:
        """Request a new snapshot, and wake the waiting readers."""
        if self._sequence == self._published:
            self._sequence += 1
        self._published = self._sequence
        async with self._changed:
            self._changed.notify_all()

    @property
    def _at_work(self) -> Working:
        if self._working is None:
            raise RuntimeError("the daemon is not up yet")
        return self._working

    def phase(self) -> Phase:
        working = self._at_work
        if working.paused:
            return "paused"
        if working.session.capture is not None:
            return "dwelling" if working.session.capture.at_stop else "waiting-stop"
        return (
            working.finisher.phase
            if working.shown is not working.session
            else "waiting-program"
        )

    def waits_for(self) -> Words:
        """Return the event for which the daemon waits."""
        if refused := _refused(self._at_work.recorder):
            return refused
        phase = self.phase()
        setup, stop, count, axis = expected_stop(self._at_work.session)
        if phase == "solving":
            return message("waits-solving")
        if phase == "dwelling":
            return message("waits-taking", setup=setup, stop=stop, last=count - 1)
        if phase == "waiting-stop" and axis:
            return message(
                "waits-move", setup=setup, stop=stop, last=count - 1, axis=axis.upper()
            )
        if phase == "waiting-stop":
            return message("waits-machine", setup=setup, stop=stop, last=count - 1)
        return _idle(self._at_work.session, setup)

    def live(self) -> LiveStatus:
        laser, plc, head, air = self._at_work.survey_links.statuses()
        words = {"waits_for": self.waits_for(), "message": _message(self._at_work)}
        return LiveStatus(
            time_s=time.time(),
            **words,
            conditions=self._at_work.session.conditions(),
            laser=laser,
            plc=plc,
            head=head,
            air=air,
        )

    def snapshot(self) -> Snapshot:
        working = self._at_work
        shown = snapshot(
            working.shown,
            sequence=self._sequence,
            phase=self.phase(),
            links=working.survey_links.statuses(),
            result_ready=working.finisher.result is not None,
            programs=working.programs,
            waits_in_vain=working.waits_in_vain(),
            notice=_message(working),
        )
        return msgspec.structs.replace(
            shown,
            ahead=working.finisher.ahead.while_open(shown.to_drive),
            corrects=working.corrects,
            proof=working.finisher.proof,
        )

    def figures(self) -> Figures:
        working = self._at_work
        names = ("laser", "machine", "head", "air")
        health, session = working.recorder.health, working.session
        return Figures(
            tally=working.tally,
            samples=working.tally.samples_before + session.samples,
            links={
                name: link
                for name, link in zip(names, working.survey_links.statuses(), strict=True)
                if link is not None
            },
            recording=session.recording,
            recorder_blocked=health.state == "blocked",
            backlog_bytes=health.backlog_bytes,
            lost_events=health.lost_events,
            disk_free_bytes=disk_free_bytes(session.folder.parent),
            watchdog_age_s=time.monotonic() - working.tally.fed_s,
        )

    async def changed(self, sequence: int) -> None:
        async with self._changed:
            await self._changed.wait_for(lambda: self._sequence != sequence)

    def result_file(self) -> Path | None:
        return self._at_work.finisher.result

    def folder(self) -> Path:
        return self._at_work.shown.folder

    def token_guessed(self, address: str, count: int) -> None:
        text = message("page-token-guessed", address=address, count=count)
        self._at_work.session.found(finding("warning", text))
        self.news()

    async def _accept(self, session: Session, arguments: Mapping[str, str]) -> None:
        doubts = doubts_at(session.book.doubts(), arguments.get("place", ""))
        given = {name: arguments.get(name, "") for name in ("reason", "name")}
        await asyncio.to_thread(accept, doubts, session.folder, time_s=time.time(), **given)

    def _certify(self, finisher: Finisher) -> None:
        if finisher.result is None:
            raise UsageError(
                message("where-certificate"),
                expected=message("expects-result"),
                found=message("none"),
            )
        finisher.certify(finisher.result.parent, self.news)

    def _take(self, working: Working) -> None:
        session = working.session
        if session.recording or not working.finisher.ahead.further:
            raise UsageError(
                message("where-take"),
                expected=message("expects-further"),
                found=found_now(session),
            )
        working.finisher.take(self.news)

    async def command(self, name: CommandName, arguments: Mapping[str, str]) -> None:
        _log.info("command", name=name, **_logged(arguments))
        working = self._at_work
        match name:
            case "accept":
                await self._accept(working.session, arguments)
            case "correct":
                await working.correct(_one_line("name", arguments.get("name", "")))
            case _:
                self._order(name, arguments)
        self.news()

    def _order(self, name: CommandName, arguments: Mapping[str, str]) -> None:
        working = self._at_work
        session = working.session
        match name:
            case "start":
                _start(working)
            case "pause":
                session.close(message("closed-paused"))
                working.paused = True
            case "abort-setup":
                _abort(session)
            case "choose-setup":
                session.book.preferred = _planned(session, arguments.get("setup", ""))
            case "zero":
                session.zero()
            case "certificate":
                self._certify(working.finisher)
            case "take":
                self._take(working)
            case "name":
                _name(session, arguments)


def _logged(arguments: Mapping[str, str]) -> dict[str, str]:
    return {
        f"given_{key}" if key == "name" else key: arguments[key]
        for key in _ARGUMENTS
        if key in arguments
    }


def found_now(session: Session) -> Message:
    """Return the reason why a command between two passes is refused: a pass is being recorded, or
    there is nothing to do.
    """
    return (
        message("found-being-recorded", name=session.book.next_setup())
        if session.recording
        else message("none")
    )


def _start(working: Working) -> None:
    if not working.paused and working.session.survey.plc.silent:
        working.session.begin(working.session.book.next_setup(), now_ns())
    working.paused = False


def _name(session: Session, arguments: Mapping[str, str]) -> None:
    for key in ("operator", "workpiece"):
        if key in arguments:
            session.round.run[key] = _one_line(key, arguments[key])


def _abort(session: Session) -> None:
    if not session.recording:
        raise UsageError(
            message("where-abort"),
            expected=message("expects-recorded"),
            found=message("none"),
        )
    session.close(message("closed-aborted"))


def _idle(session: Session, setup: str) -> Message:
    if session.unsolved:
        return message("waits-unsolved", why=session.unsolved)
    if session.book.wrong_line:
        return message("waits-corrected", line=session.book.wrong_line)
    if session.book.whole() and setup:
        places = list(dict.fromkeys(where(doubt.at) for doubt in session.book.doubts()))
        return message("waits-doubted", places=places, setup=setup)
    if session.survey.plc.silent and setup:
        return message("waits-begin", setup=setup)
    return message("waits-program", setup=setup) if setup else message("waits-complete")


def _message(working: Working) -> Words:
    return joined(
        list(
            dict.fromkeys(each for each in (*working.alarms(), _of_service(working)) if each)
        )
    )


def _of_service(working: Working) -> Words:
    return (
        _refused(working.recorder)
        or working.supervisor.disk
        or working.finisher.message
        or working.recorder.health.reason
    )


def _refused(recorder: Recorder) -> Words:
    health = recorder.health
    return message("disk-refuses", why=health.reason) if health.state == "blocked" else ""


def _planned(session: Session, setup: str) -> str:
    planned = session.survey.plan.all_setups
    if setup not in planned:
        raise UsageError(
            message("where-choose"),
            expected=message("one-of", names=planned),
            found=repr(setup),
        )
    return setup


def _one_line(name: str, text: str) -> str:
    if len(text) > LONGEST_NAME or not (text.isprintable() or not text):
        raise UsageError(
            name,
            expected=message("expects-line", count=LONGEST_NAME),
            found=ascii(excerpt(text)),
        )
    return text
