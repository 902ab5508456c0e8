"""The service: links, recorder and session in one event loop, for one survey after another.

The process of the daemon only records. After the last pass a child (`daq.service.child_jobs`) runs
solver and exporters on the finished logs, and the next survey can begin at once.
"""

import asyncio
import signal
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import structlog

from stepdiag.base.errors import DataError, DeviceError, UsageError
from stepdiag.base.findings import Finding
from stepdiag.base.messages import Message, Words, message
from stepdiag.daq.capture.captured_stop import CapturedStop
from stepdiag.daq.capture.outcome import Ended, Outcome
from stepdiag.daq.log.recorder import Recorder, RecorderHealth
from stepdiag.daq.log.topics import log_note
from stepdiag.daq.passes.doubt import Doubt, places_of
from stepdiag.daq.recording.begun import BegunWords
from stepdiag.daq.recording.corrections import Change, Correction, compared, note_correction
from stepdiag.daq.recording.handshake import Handshake
from stepdiag.daq.recording.rounds import FolderLock, gone_on_with, latest_round, next_round
from stepdiag.daq.recording.session import Round, Session
from stepdiag.daq.recording.settled import Settled
from stepdiag.daq.recording.survey_links import SurveyLinks
from stepdiag.daq.recording.verdicts import verdicts_in
from stepdiag.daq.records.events import Event, LinkEvent, ModbusBlock
from stepdiag.daq.service.child_jobs import Commands, Finisher
from stepdiag.daq.service.live import forget_live, write_live
from stepdiag.daq.service.metrics import Tally
from stepdiag.daq.service.notify import Notifier
from stepdiag.daq.service.status_source import DaemonStatusSource, Working, found_now
from stepdiag.daq.service.supervision import Supervisor
from stepdiag.daq.survey.amended import extends
from stepdiag.daq.survey.bundle import compensation_findings, run_record
from stepdiag.daq.survey.file import load_survey, parse_survey, read_text
from stepdiag.daq.survey.models import Survey
from stepdiag.daq.timing.host_clock import now_ns, wall_offset_ns

PUBLISH_S = 0.1
"""Period of the snapshot in s."""
LOOK_S = 0.5
"""Period in s of the search for new verdicts while no event comes."""
LIVE_S = 1.0
"""Period in s of writing the file for `status`."""
_log = structlog.get_logger("daemon")


class Daemon:
    """Records surveys until it is stopped.

    ``completion`` is the command that processes the folder of a survey after its last pass.
    ``archiving`` is the command that compresses finished surveys. Its arguments are the folder with
    all rounds of the survey and the folder's limit in GB. ``ahead`` is the command that computes
    the next passes after a setup. ``programs`` returns the NC program of each setup of a survey, by
    its name at the control. ``status_source`` answers the page.
    """

    def __init__(
        self,
        survey_file: Path,
        completion: Sequence[str],
        archiving: Sequence[str] = (),
        ahead: Sequence[str] = (),
        programs: Callable[[Survey], Mapping[str, str]] = lambda _: {},
    ) -> None:
        self._file = survey_file
        self.survey = load_survey(survey_file)
        self.status_source = DaemonStatusSource()
        self._text = read_text(survey_file)
        self._run_record = run_record(self.survey, survey_file)
        self._folder = self.survey.folder(survey_file)
        self._commands = Commands(
            completion=completion,
            archiving=archiving,
            ahead=ahead if self.survey.plan.propose_next else (),
            max_gb=self.survey.recording.max_gb,
        )
        self._programs = programs
        self._looked = (_modified_ns(survey_file), False)
        self._notifier = Notifier()
        self._tally = Tally()
        self._stop = asyncio.Event()
        self._announced = ""
        self._blocked = False
        self._working: Working
        self._lock: FolderLock
        self._taken = False
        self._handshake: Handshake | None = None
        self._settled = Settled()
        self._live_s = 0.0
        self._begun = BegunWords(self._folder)
        self._writing: asyncio.Task[None] | None = None

    async def run(self) -> None:
        """Record until SIGTERM, SIGINT or `stop`; then close the open log.

        Raises UsageError if another daemon has locked the folder, RuntimeError if a worker died,
        DeviceError if the disk refused data to the end.
        """
        self.take_folder()
        loop = self._loop = asyncio.get_running_loop()
        for number in (signal.SIGTERM, signal.SIGINT):
            loop.add_signal_handler(number, self.stop)
        recorder = Recorder(self._recorder_changed)
        try:
            await self._serve(recorder)
        finally:
            for number in (signal.SIGTERM, signal.SIGINT):
                loop.remove_signal_handler(number)
            self._notifier.stopping()
            whole = recorder.stop()
            self._lock.release()
        if not whole:
            raise _unwritten(recorder.health)

    def take_folder(self) -> None:
        """Lock the survey's folder before anything else is opened. Raises UsageError if another
        daemon has locked the folder.
        """
        if not self._taken:
            self._lock, self._taken = FolderLock.take(self._folder), True

    def stop(self) -> None:
        self._stop.set()

    async def _serve(self, recorder: Recorder) -> None:
        self._working = working = self._set_up(
            recorder, latest_round(self._folder, self._text, self._run_record)
        )
        self.status_source.open(working)
        self._settled.know(working.session)
        if working.session.book.complete():
            working.session.unsolved = ""  # the reason for a missing result may be gone
        self._complete_if_settled()
        workers: list[asyncio.Task[Any]] = [
            asyncio.create_task(working.survey_links.run(), name="links"),
            asyncio.create_task(self._publish(), name="publish"),
            asyncio.create_task(working.supervisor.watch(), name="watch"),
        ]
        stopping = asyncio.create_task(self._stop.wait(), name="stop")
        self._notifier.ready()
        _log.info(
            "ready",
            survey=self.survey.identity.name,
            folder=str(working.session.folder),
            waits_for=str(self.status_source.waits_for()),
        )
        try:
            done, _ = await asyncio.wait(
                [*workers, stopping], return_when=asyncio.FIRST_COMPLETED
            )
            for task in done - {stopping}:
                task.result()
                raise RuntimeError(f"the worker {task.get_name()} ended by itself")
        finally:
            await self._finish([*workers, stopping])

    def _set_up(self, recorder: Recorder, begun: Round) -> Working:
        session = self._session(recorder, begun)
        survey_links = SurveyLinks(self.survey, self._consume, self._written)
        if self.survey.plc.handshake.enabled:
            self._handshake = Handshake(
                survey_links.acknowledge, session.owed, self.survey.plan.dwell_s
            )

        def dead() -> list[str]:
            health = recorder.health
            return [
                *survey_links.dead(),
                *([f"recorder: {health.reason}"] if health.state == "dead" else []),
            ]

        return Working(
            session=session,
            shown=session,
            recorder=recorder,
            survey_links=survey_links,
            finisher=Finisher(self._commands, self._tally, self._solved),
            supervisor=Supervisor(
                self._notifier,
                dead,
                self._remark,
                self._tally,
                self._lock.require_folder,
                self._folder,
                self.survey.recording.min_free_gb,
            ),
            tally=self._tally,
            programs=self._programs(self.survey),
            correct=self._correct,
            alarms=self._alarms,
            waits_in_vain=lambda: self._handshake is not None and bool(self._handshake.alarm),
        )

    def _alarms(self) -> list[Words]:
        waits = self._handshake.alarm if self._handshake is not None else ""
        return [words for words in (waits, self._working.session.unsolved) if words]

    def _remark(self, what: Message) -> None:
        self._working.session.remark(what)

    async def _finish(self, tasks: Sequence[asyncio.Task[Any]]) -> None:
        for task in tasks:
            task.cancel()
        await asyncio.gather(*tasks, return_exceptions=True)
        self._working.session.close(message("closed-stopped"))
        await self._working.finisher.close()
        if self._writing is not None:
            await self._writing
        forget_live(self._folder)
        _log.info("stopped", recording=str(self._working.session.folder))

    # received data

    def _consume(self, event: Event) -> None:
        working = self._working
        session = working.session
        if isinstance(event, LinkEvent):
            self.status_source.news()
        if working.paused and not session.recording:
            return
        session.consume(event)
        if self._handshake is not None and isinstance(event, ModbusBlock):
            self._look_at_handshake(self._handshake, event)
        if working.session.recording and working.shown is not working.session:
            working.shown = working.session
            working.finisher.forget()

    def _look_at_handshake(self, handshake: Handshake, block: ModbusBlock) -> None:
        session = self._working.session
        if session.machine_waits:
            self._working.survey_links.hurry()
        # only after a complete survey, which is shown until a pass is recorded
        if session.runs_on and self._working.shown is not session:
            handshake.let_go(session.signals, session.owed, block.recv_ns)
        if waits := handshake.look(
            session.signals, block.recv_ns, self.status_source.waits_for
        ):
            session.say(waits)

    def _written(self, refused: Words) -> None:
        if self._handshake is not None and (refusal := self._handshake.written(refused)):
            self._working.session.say(refusal)

    def _heed(self, outcome: Outcome) -> None:
        if isinstance(outcome, CapturedStop):
            self._loop.call_soon_threadsafe(self._captured, outcome)
            return
        self.status_source.news()
        if isinstance(outcome, Finding):
            self._tally.findings[outcome.code] += 1
            say = {"info": _log.info, "warning": _log.warning, "error": _log.error}[
                outcome.severity
            ]
            say(
                "finding",
                code=outcome.code,
                severity=outcome.severity,
                text=str(outcome.words),
            )
        else:
            self._ended(outcome)

    def _captured(self, stop: CapturedStop) -> None:
        """Answer the machine as soon as a stop is safe in the log, so that the machine may move;
        all other work follows the answer.
        """
        if self._handshake is not None:
            self._handshake.captured(stop)
        self._loop.call_soon(self._report, stop)

    def _report(self, stop: CapturedStop) -> None:
        self.status_source.news()
        self._tally.stops += 1
        book = (
            self._working.session.book
            if self._working.session.book.stops
            else self._working.shown.book
        )
        reading, deviation = book.deviation(stop)
        _log.info(
            "stop",
            setup=stop.setup,
            outward=stop.outward,
            stop=stop.stop,
            of=book.last_stop(stop),
            reading_mm=reading,
            deviation_um=deviation,
            u_um=round(stop.u_um, 4),
            doubtful=str(stop.why()),
            waits_for=str(self.status_source.waits_for()),
        )

    def _ended(self, ended: Ended) -> None:
        """Report the end of a pass after the reports of its stops: the last captured stop must
        first be safe in the log.
        """
        note = log_note(now_ns(), "info", str(ended.reason), "daemon")
        # A stop is reported one turn of the loop after its answer.
        # The end of the pass is delayed by one turn, too, and so follows the last stop.
        self._working.recorder.promise(
            note,
            lambda: self._loop.call_soon_threadsafe(self._loop.call_soon, _say_ended, ended),
        )
        self._loop.call_soon(self._complete_if_settled)
        # starting a process stops the loop for 10 ms; in this time the machine would wait
        # for the answer to its last stop
        self._loop.call_later(PUBLISH_S, self._look_ahead)

    # one survey after another

    def _session(self, recorder: Recorder, begun: Round, *, armed: bool = True) -> Session:
        session = Session(
            self.survey,
            self._text,
            begun,
            recorder,
            on_outcome=self._heed,
            wall_offset_ns=wall_offset_ns,
            armed=armed,
        )
        for finding in compensation_findings(self.survey):
            session.found(finding)
        return session

    def _complete_if_settled(self) -> None:
        session = self._working.session
        settled = self._settled.of(session)
        if settled == "complete":
            self._complete()
        elif settled == "doubted":
            still = session.book.doubts()
            self._working.finisher.tabulate(
                session.folder, lambda: self._say_open(session, still)
            )

    def _say_open(self, session: Session, still: Sequence[Doubt]) -> None:
        if session is not self._working.session or session.book.doubts() != still:
            return
        places, reason = (
            places_of(still),
            "; ".join(dict.fromkeys(str(doubt.words) for doubt in still)),
        )
        facts = {"folder": str(session.folder), "doubted": places, "reason": reason}
        self._write_live(lambda: _log.warning("survey-open", **facts))

    def _complete(self) -> None:
        working = self._working
        whole = working.session
        working.finisher.finish(whole.folder)
        working.tally.samples_before += whole.samples
        working.session = self._session(
            working.recorder, next_round(whole.round, whole.book.last), armed=False
        )
        working.shown = whole

    def _solved(self, folder: Path, solved: bool) -> None:
        working = self._working
        self.status_source.news()
        begun = working.session.recording or bool(working.session.book.passes)
        if solved or begun or working.shown.folder != folder:
            return
        working.session = self._session(
            working.recorder, working.shown.as_round(verdicts_in(folder)), armed=False
        )
        if not working.session.book.doubts():
            working.session.unsolved = working.session.unsolved or working.finisher.message
        working.shown = working.session
        self._settled.know(working.session)

    def _look_at_verdicts(self) -> None:
        session = self._working.session
        heard = self._settled.heard(session)
        if heard:
            self.status_source.news()
        if heard or self._settled.due(session):
            self._complete_if_settled()

    def _look_ahead(self) -> None:
        shown = self._working.shown
        last = shown.book.last
        if last is not None and not shown.book.open_passes(last.setup):
            self._working.finisher.look_ahead(shown.folder, self.status_source.news)

    def _look_at_survey(self) -> None:
        working = self._working
        begun = working.shown is not working.session and working.session.book.passes
        # before the first stop a change has no effect, so the file is examined again
        # at the first stop
        looked = (_modified_ns(self._file), bool(working.shown.book.stops))
        if looked == self._looked or working.finisher.phase == "solving" or begun:
            return
        touched = looked[0] != self._looked[0]
        self._looked = looked
        try:
            text = read_text(self._file)
            before = working.corrects
            working.corrects = tuple(map(str, self._corrections(text)))
            if text == self._text or not extends(text, self._text):
                if touched or working.corrects != before:
                    _log.info("survey-changed", changes=list(working.corrects))
                    self.status_source.news()
                return
            folder = gone_on_with(working.shown.folder, text)
        except (UsageError, DataError, OSError) as refused:
            _log.warning("survey-file-not-taken", detail=str(refused))
            return
        self._go_on(
            text,
            replace(working.shown.as_round(verdicts_in(working.shown.folder)), folder=folder),
        )
        _log.info(
            "survey-goes-on", setups=list(self.survey.plan.all_setups), folder=str(folder)
        )

    def _go_on(self, text: str, begun: Round) -> None:
        working = self._working
        self._text, self.survey = text, parse_survey(text, self._file.name)
        working.programs = self._programs(self.survey)
        working.session = working.shown = self._session(working.recorder, begun, armed=False)
        working.corrects = ()
        working.finisher.forget()
        self._settled.know(working.session)
        self.status_source.news()

    def _corrections(self, text: str) -> list[Change]:
        changed = compared(self._text, text) or []
        solved = (
            self._working.finisher.result is not None or not self._working.shown.book.stops
        )
        return [] if solved or any(each.begins_round for each in changed) else changed

    async def _correct(self, name: str) -> None:
        working, text = self._working, read_text(self._file)
        changed = self._corrections(text)
        if working.session.recording or not changed:
            found = found_now(working.session)
            raise UsageError(
                message("where-correct"),
                expected=message("expects-changed-file"),
                found=found,
            )
        correction = Correction(
            time_s=time.time(), name=name, changes=tuple(map(str, changed)), survey_text=text
        )
        paused, working.paused = (
            working.paused,
            True,
        )  # no pass may begin while the logs of the previous passes are read
        try:
            await asyncio.to_thread(note_correction, working.shown.folder, correction)
            begun = await asyncio.to_thread(
                latest_round, self._folder, text, self._run_record
            )
        finally:
            working.paused = paused
        self._go_on(text, begun)
        _log.info(
            "survey-corrected",
            changes=list(correction.changes),
            given_name=name,
            folder=str(begun.folder),
        )
        self._complete_if_settled()

    def _look_at_begun(self) -> None:
        for word in self._begun.news():
            try:
                self._working.session.begin(word.setup, now_ns())
            except UsageError as refused:
                _log.warning(
                    "begin-refused",
                    setup=word.setup,
                    given_name=word.name,
                    detail=str(refused),
                )
            else:
                _log.info("begun", setup=word.setup, given_name=word.name)
            self.status_source.news()

    # sent data

    def _recorder_changed(self, health: RecorderHealth) -> None:
        self._loop.call_soon_threadsafe(self._recorder_is, health.state in ("idle", "dead"))
        fields = {
            "state": health.state,
            "reason": str(health.reason),
            "path": str(health.path),
            "lost_events": health.lost_events,
        }
        if health.state in ("blocked", "dead"):
            _log.error("recorder", **fields)
        elif self._blocked:
            _log.info("recorder", **fields)
        self._blocked = health.state == "blocked"

    def _recorder_is(self, idle: bool) -> None:
        self._working.finisher.recorder_is(idle=idle)

    async def _publish(self) -> None:
        """Make a new snapshot, and examine the files beside the logs. The period `PUBLISH_S` is
        long, so that this work rarely delays the arrival stamps.
        """
        looked_s = 0.0
        while True:
            await asyncio.sleep(PUBLISH_S)
            self._working.survey_links.collect()
            self._look_at_begun()
            if self.status_source.has_news or time.monotonic() - looked_s >= LOOK_S:
                looked_s = time.monotonic()
                self._announce(str(self.status_source.waits_for()))
                self._look_at_verdicts()
            if time.monotonic() - self._live_s >= LIVE_S and (
                self._writing is None or self._writing.done()
            ):
                self._write_live()
                if not self._working.session.recording:
                    self._look_at_survey()
            await self.status_source.publish()

    def _write_live(self, then: Callable[[], object] | None = None) -> None:
        self._live_s = time.monotonic()
        self._writing = asyncio.create_task(
            self._written_live(self._writing, then), name="live"
        )

    async def _written_live(
        self, before: asyncio.Task[None] | None, then: Callable[[], object] | None
    ) -> None:
        if before is not None:
            await before
        await asyncio.to_thread(write_live, self._folder, self.status_source.live())
        if then is not None:
            then()

    def _announce(self, waits_for: str) -> None:
        self._notifier.status(waits_for)
        if waits_for != self._announced and not self._working.session.recording:
            _log.info("waiting", what=waits_for)
        self._announced = waits_for


def _modified_ns(file: Path) -> int:
    try:
        return file.stat().st_mtime_ns
    except OSError:
        return 0


def _say_ended(ended: Ended) -> None:
    _log.info("pass-ended", kind=ended.kind, reason=str(ended.reason))


def _unwritten(health: RecorderHealth) -> DeviceError:
    remedy = message("make-room")
    found = message(
        "bytes-lost",
        why=health.reason or message("disk-too-slow"),
        count=health.backlog_bytes,
    )
    return DeviceError(
        str(health.path), expected=message("disk-takes"), found=found, remedy=remedy
    )
